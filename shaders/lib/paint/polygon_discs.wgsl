// Speckle inside clipped pixels. The NumPy form is `polygon_cover` in gpusim/optics/paint/disc_coverage.py.
#import lib/raster/polygon_clipping
#import lib/paint/disc_coverage
#import lib/light/surface

// Share of a polygon (px from the pixel's centre) that speckle covers: triangles from its first
// corner, each of them in rows, which are exact where the edges are hard and sampled where soft.
// `corner` is that of the cell, relative to the triangle's own.
fn polygon_speckle(
    t: Triangle, d: vec2f, polygon: ptr<function, Polygon>, cell: u32, corner: vec2f, cuts: u32, kind: u32,
    hard_rows: u32,
) -> f32 {
    let list = textureLoad(speckles, texel(cell));
    let first = u32(list.x);
    let last = first + u32(list.y);
    let soft = speckle == 1u || (speckle == 3u && kind == 2u);
    let steps = select(hard_rows, 3u * cuts, soft);
    if (last == first) { return 0.0; }
    var sum = 0.0;
    var whole = 0.0;
    // tests come last: see feature_grid.wgsl
    var k = 1;
    loop {
        let a = polygon.p[k] - polygon.p[0];
        let b = polygon.p[k + 1] - polygon.p[0];
        let area = a.x * b.y - a.y * b.x;
        var j = 0u;
        loop {
            let row = row_step(j, steps, soft);
            let p0 = polygon.p[0] + row.x * a;
            let p1 = polygon.p[0] + row.x * b;
            var covered = 0.0;
            if (speckle != 2u && soft) {
                var i = 0u;
                loop {
                    let point = row_step(i, steps, soft);
                    let st = paint_position(t, d + mix(p0, p1, point.x)) - corner;
                    var open = 1.0;
                    var n = first;
                    loop {
                        let disc = textureLoad(speckles, texel(n));
                        let m = st - disc.xy;
                        open *= leaves(vec3f((disc.z * disc.z - dot(m, m)) * disc.w)).x;
                        n++;
                        if (n >= last) { break; }
                    }
                    covered += point.y * (1.0 - open);
                    i++;
                    if (i >= steps) { break; }
                }
            }
            if (speckle != 1u && !soft) {
                let start = paint_position(t, d + p0) - corner;
                let along = paint_position(t, d + p1) - corner - start;
                var rows = no_rows();
                var n = first;
                loop {
                    let disc = textureLoad(speckles, texel(n));
                    let m = start - disc.xy;
                    rows = cover_rows(rows, dot(along, along), vec4f(dot(m, along)),
                        vec4f(dot(m, m) - disc.z * disc.z));
                    n++;
                    if (n >= last) { break; }
                }
                covered = union_rows(rows).x;
            }
            sum += area * 2.0 * row.x * row.y * covered;
            j++;
            if (j >= steps) { break; }
        }
        whole += area;
        k++;
        if (k + 1 >= polygon.count) { break; }
    }
    if (whole == 0.0) { return 0.0; }
    return clamp(sum / whole, 0.0, 1.0);
}

// Position in 0 ... 1 and weight of step i: Gauss points, three to a piece, or midpoints.
fn row_step(i: u32, steps: u32, soft: bool) -> vec2f {
    if (!soft) { return vec2f((f32(i) + 0.5) / f32(steps), 1.0 / f32(steps)); }
    let pieces = f32(steps / 3u);
    let k = f32(i % 3u) - 1.0;
    let place = (f32(i / 3u) + 0.5 + k * GAUSS) / pieces;
    return vec2f(place, select(END, MIDDLE, k == 0.0) / pieces);
}
