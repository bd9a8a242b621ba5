// What is affine on a triangle in the image, from its three vertices: barycentric coordinates, depth and
// paint coordinates, as functions of the offset from an anchor pixel (gpusim/optics/raster/triangle_records.py).
//
// Differences between vertices are taken in whole steps and their remainders, so that float32 keeps
// what matters however far from the image's or the paint's origin a triangle lies.
#import lib/raster/vertex

// a.x b.y - a.y b.x, rounded once or twice: slivers leave a small difference of large products.
// Numbers below 2^26 in halves; where `a` and `b` have remainders, those add to it.
fn sides_cross(a: vec2i, b: vec2i) -> f32 {
    let ah = a >> vec2u(12u);
    let bh = b >> vec2u(12u);
    let al = a & vec2i(4095);
    let bl = b & vec2i(4095);
    let low = al.x * bl.y - al.y * bl.x;
    let middle = ah.x * bl.y + al.x * bh.y - ah.y * bl.x - al.y * bh.x + (low >> 12u);
    let high = ah.x * bh.y - ah.y * bh.x + (middle >> 12u);
    return f32(high) * 16777216.0 + f32((middle & 4095) * 4096 + (low & 4095));
}

// A number at the three corners as an affine function: (at the anchor, per column, per row).
struct Weights {
    one: vec3f,
    two: vec3f,
}
fn plane(w: Weights, first: f32, one: f32, two: f32) -> vec3f {
    return vec3f(first, 0.0, 0.0) + one * w.one + two * w.two;
}

struct Planes {
    anchor: vec2i,
    w: Weights,
    // relative 1 / depth of the corners and what it changes by, by its mean
    k: vec3f,
    mean: f32,
    depth: vec3f,
    // paint coordinates over depth, and the cell that they are relative to
    s: vec3f,
    t: vec3f,
    cell: vec2i,
}
fn planes_of(p: Vertex, q: Vertex, r: Vertex) -> Planes {
    // sides of the triangle in 1/65536 px
    let u = q.at - p.at;
    let v = r.at - p.at;
    let du = q.rest - p.rest;
    let dv = r.rest - p.rest;
    let fu = vec2f(u) + du;
    let fv = vec2f(v) + dv;
    let area = sides_cross(u, v)
        + (vec2f(u).x * dv.y - vec2f(u).y * dv.x + du.x * fv.y - du.y * fv.x);
    var scale = 0.0;
    if (area != 0.0) { scale = PIXEL / area; }
    let anchor = anchor_of(p, q, r);
    let d = -offset_from(anchor, p);
    // barycentric coordinates of the second and the third corner
    let one = vec2f(fv.y, -fv.x) * scale;
    let two = vec2f(-fu.y, fu.x) * scale;
    let w = Weights(vec3f(dot(one, d), one), vec3f(dot(two, d), two));

    // 1 / depth by its mean
    let mean = (p.offset + q.offset + r.offset) / 3.0;
    let k = vec3f(p.offset - mean, q.offset - mean, r.offset - mean) / (1.0 + mean);
    let k1 = k.y - k.x;
    let k2 = k.z - k.x;
    let depth = plane(w, 1.0 + k.x, k1, k2);

    // paint coordinates relative to the cell in which their mean lies
    let side = p.side;
    let su = vec2f(q.cell - p.cell) * side + (q.st - p.st);
    let sv = vec2f(r.cell - p.cell) * side + (r.st - p.st);
    let step = vec2i(floor((p.st + (su + sv) / 3.0) / side));
    let st = p.st - vec2f(step) * side;
    let s = plane(w, st.x * (1.0 + k.x), su.x * (1.0 + k.y) + st.x * k1,
        sv.x * (1.0 + k.z) + st.x * k2);
    let t = plane(w, st.y * (1.0 + k.x), su.y * (1.0 + k.y) + st.y * k1,
        sv.y * (1.0 + k.z) + st.y * k2);

    return Planes(anchor, w, k, mean, depth, s, t, p.cell + step);
}

// The cosine between a triangle's normal and the line of sight to its anchor. The reciprocal depth of a
// plane n . x = 1 is n . ray, so that its changes in the image tell n.
fn facing(f: Planes, x: vec3f, y: vec3f, one: vec3f) -> f32 {
    let ray = one + f32(f.anchor.x) * x + f32(f.anchor.y) * y;
    let change = f.depth.yz / f.depth.x;
    let across = cross(y, ray);
    let normal = (change.x * across + change.y * cross(ray, x) + cross(x, y)) / dot(x, across);
    return inverseSqrt(dot(normal, normal) * dot(ray, ray));
}
