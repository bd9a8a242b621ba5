// What of a triangle lies within a pixel, as sums over its sides: no polygon is made, which takes
// software rasterisers ten times as long. The NumPy form is clip_square and moments of
// gpusim/optics/geometry/polygon_clipping.py.

// Integrals of c, c^2 / 2 and c y over dy along a side, from the centre of the pixel, where c is x,
// but no less than -1/2 and no more than 1/2, and y lies within the same. By Green's theorem their
// sums over the sides are the area, and the integrals of x and y, of what lies within.
fn side_within(start: vec2f, stop: vec2f) -> vec3f {
    // both triangles at a side find the same numbers
    let turned = stop.y < start.y || (stop.y == start.y && stop.x < start.x);
    let a = select(start, stop, turned);
    let b = select(stop, start, turned);
    let d = b - a;
    if (d.y == 0.0) { return vec3f(0.0); }
    let y = clamp(vec2f(a.y, b.y), vec2f(-0.5), vec2f(0.5));
    let x = a.x + (y - a.y) / d.y * d.x;
    let c = clamp(x, vec2f(-0.5), vec2f(0.5));
    // shares of the side before and up to where x lies within
    let run = x.y - x.x;
    let s = clamp((c - x.x) / select(run, 1.0, run == 0.0), vec2f(0.0), vec2f(1.0));
    let rise = y.y - y.x;
    let at = y.x + rise * s;
    let part = vec3f(s.x, s.y - s.x, 1.0 - s.y);
    let mean = 0.5 * (c.x + c.y);
    let squares = vec3f(c.x * c.x, (c.x * c.x + c.x * c.y + c.y * c.y) / 3.0, c.y * c.y);
    let heights = vec3f(c.x * 0.5 * (y.x + at.x),
        (mean * (at.x + at.y) + 0.5 * (c.x * at.x + c.y * at.y)) / 3.0,
        c.y * 0.5 * (at.y + y.y));
    let sums = vec3f(dot(part, vec3f(c.x, mean, c.y)), 0.5 * dot(part, squares), dot(part, heights));
    return select(rise, -rise, turned) * sums;
}

// Area and centroid: (area, x, y).
fn within_pixel(v0: vec2f, v1: vec2f, v2: vec2f) -> vec3f {
    let sums = side_within(v0, v1) + side_within(v1, v2) + side_within(v2, v0);
    let middle = sums.yz / select(sums.x, 1.0, sums.x == 0.0);
    return vec3f(abs(sums.x), clamp(middle, vec2f(-0.5), vec2f(0.5)));
}
