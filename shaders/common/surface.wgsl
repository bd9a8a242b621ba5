// A triangle set up for shading, and the light that falls on it.
// The NumPy form is gpusim/optics/setup.py (records) and gpusim/optics/light.py.

// Affine functions of the offset (dx, dy) from the anchor pixel, scaled by the triangle's mean
// depth: st = (s0, sx, sy, t0), tw = (tx, ty, wx, wy), n0 = (normal at the anchor, w0),
// nx = (change per column, 1 / mean depth), ny = (change per row, paint),
// place = (anchor column, row, cell i, cell j), more = (ground albedo, 1 if a feature is near, -, -).
struct Triangle {
    st: vec4f,
    tw: vec4f,
    n0: vec4f,
    nx: vec4f,
    ny: vec4f,
    place: vec4i,
    more: vec4f,
}

// Per emitter two vectors: (position, axial intensity) and (axis, 1 if it follows Lambert's law);
// positions are relative to the camera's eye. They are uniform and their count is a constant: the
// loop unrolls and every lane shares the loads.
struct Lamps {
    ambient: vec4f,
    emitters: array<vec4f, 512>,
}
@group(0) @binding(5) var<uniform> lamps: Lamps;
override emitter_count: u32;

// The exact pixel area integral needs the attributes and how they change across the pixel.
struct Footprint {
    st: vec2f,
    ex: vec2f,
    ey: vec2f,
    q: vec2f,
}

fn weight(t: Triangle, d: vec2f) -> f32 {
    return t.n0.w + t.tw.z * d.x + t.tw.w * d.y;
}

fn paint_position(t: Triangle, d: vec2f) -> vec2f {
    let st = vec2f(t.st.x, t.st.w) + vec2f(t.st.y, t.tw.x) * d.x + vec2f(t.st.z, t.tw.y) * d.y;
    return st / weight(t, d);
}

fn footprint(t: Triangle, d: vec2f) -> Footprint {
    let w = 1.0 / weight(t, d);
    let st = paint_position(t, d);
    let ex = (vec2f(t.st.y, t.tw.x) - st * t.tw.z) * w;
    let ey = (vec2f(t.st.z, t.tw.y) - st * t.tw.w) * w;
    return Footprint(st, ex, ey, t.tw.zw * w);
}

// The footprint of a pixel whose sides the lens bends: columns of `change` are what a column and a
// row of the image are in pixels of the ideal image.
fn bent_footprint(f: Footprint, change: mat2x2f) -> Footprint {
    let turned = mat2x2f(f.ex, f.ey) * change;
    return Footprint(f.st, turned[0], turned[1], f.q * change);
}

// Irradiance from all emitters at camera-relative position x with unit normal n.
fn irradiance(x: vec3f, n: vec3f) -> f32 {
    var total = lamps.ambient.x;
    for (var i = 0u; i < emitter_count; i++) {
        let at = lamps.emitters[2u * i];
        let axis = lamps.emitters[2u * i + 1u];
        let to = at.xyz - x;
        let square = max(dot(to, to), 1e-30);
        let inverse = inverseSqrt(square);
        let falling = max(dot(to, n) * inverse, 0.0);
        let leaving = select(1.0, max(-dot(to, axis.xyz) * inverse, 0.0), axis.w != 0.0);
        total += at.w * leaving * falling * inverse * inverse;
    }
    return total;
}

// World-space ray of unit depth through a pixel: x * column + y * row + one.
struct Rays {
    x: vec4f,
    y: vec4f,
    one: vec4f,
}

// Irradiance / pi at image position p, which lies at offset d from the triangle's anchor: what a
// Lambert surface's albedo is multiplied by.
fn light_factor(t: Triangle, rays: Rays, p: vec2f, d: vec2f) -> f32 {
    let depth = 1.0 / (weight(t, d) * t.nx.w);
    let x = depth * (rays.x.xyz * p.x + rays.y.xyz * p.y + rays.one.xyz);
    let n = normalize(t.n0.xyz + t.nx.xyz * d.x + t.ny.xyz * d.y);
    return irradiance(x, n) * 0.3183098861837907;
}
