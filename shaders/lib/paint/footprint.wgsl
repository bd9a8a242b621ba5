// Where a pixel lies on a triangle's pattern, and how that changes across it, from affine functions of the
// offset d from the triangle's anchor: st = (s0, sx, sy, t0), tw = (tx, ty, wx, wy), and w0.

// The exact pixel area integral needs the attributes and how they change across the pixel.
struct Footprint {
    st: vec2f,
    ex: vec2f,
    ey: vec2f,
    q: vec2f,
}

fn weight_of(tw: vec4f, w0: f32, d: vec2f) -> f32 {
    return w0 + tw.z * d.x + tw.w * d.y;
}

fn paint_position_of(st: vec4f, tw: vec4f, w0: f32, d: vec2f) -> vec2f {
    let at = vec2f(st.x, st.w) + vec2f(st.y, tw.x) * d.x + vec2f(st.z, tw.y) * d.y;
    return at / weight_of(tw, w0, d);
}

fn footprint_of_planes(st: vec4f, tw: vec4f, w0: f32, d: vec2f) -> Footprint {
    let w = 1.0 / weight_of(tw, w0, d);
    let at = paint_position_of(st, tw, w0, d);
    let ex = (vec2f(st.y, tw.x) - at * tw.z) * w;
    let ey = (vec2f(st.z, tw.y) - at * tw.w) * w;
    return Footprint(at, ex, ey, tw.zw * w);
}

// The footprint of a pixel whose sides the lens bends: columns of `change` are what a column and a
// row of the image are in pixels of the ideal image.
fn bent_footprint(f: Footprint, change: mat2x2f) -> Footprint {
    let turned = mat2x2f(f.ex, f.ey) * change;
    return Footprint(f.st, turned[0], turned[1], f.q * change);
}
