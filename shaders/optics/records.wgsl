// What the pixels of a triangle share, from its three vertices: affine functions of the offset from
// an anchor pixel, as common/surface.wgsl reads them. Described in gpusim/optics/records.py.
//
// Differences between vertices are taken in whole steps and their remainders, so that float32 keeps
// what matters however far from the image's or the paint's origin a triangle lies.
#import common/index
#import common/texel
#import common/vertex

struct Params {
    count: u32,
    // 1 / depth that those of the vertices are relative to
    inverse_depth: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
// three vertices per triangle
@group(0) @binding(1) var<storage, read> corners: array<u32>;
// per triangle (bits of its albedo, its paint, plus NEAR if it is near a feature)
@group(0) @binding(2) var<storage, read> looks: array<vec2u>;
// per paint (what nearness counts, GGX alpha, metallic, -)
@group(0) @binding(4) var traits: texture_2d<f32>;
@group(0) @binding(5) var triangles: texture_storage_2d<rgba32uint, write>;

// numbers + 1 of the triangles whose records are needed, if not of all; 0 where there is none
@group(0) @binding(6) var<storage, read> order: array<u32>;

const NEAR: u32 = 0x80000000u;

// a.x b.y - a.y b.x, rounded once or twice: slivers leave a small difference of large products.
// Numbers below 2^26 in halves; where `a` and `b` have remainders, those add to it.
fn cross_of(a: vec2i, b: vec2i) -> f32 {
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

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id < params.count) { make(id); }
}

@compute @workgroup_size(64)
fn listed(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.count) { return; }
    let number = order[i];
    if (number != 0u) { make(number - 1u); }
}

fn make(id: u32) {
    let p = vertex_at(corners[3u * id]);
    let q = vertex_at(corners[3u * id + 1u]);
    let r = vertex_at(corners[3u * id + 2u]);
    let look = looks[id];
    let by_paint = textureLoad(traits, texel(look.y & ~NEAR), 0);

    // sides of the triangle in 1/65536 px
    let u = q.at - p.at;
    let v = r.at - p.at;
    let du = q.rest - p.rest;
    let dv = r.rest - p.rest;
    let fu = vec2f(u) + du;
    let fv = vec2f(v) + dv;
    let area = cross_of(u, v)
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

    let weighted = p.normal * (1.0 + k.x);
    let n1 = q.normal * (1.0 + k.y) - weighted;
    let n2 = r.normal * (1.0 + k.z) - weighted;
    let nx = plane(w, weighted.x, n1.x, n2.x);
    let ny = plane(w, weighted.y, n1.y, n2.y);
    let nz = plane(w, weighted.z, n1.z, n2.z);

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

    let near = f32(look.y >> 31u) * by_paint.x;
    let paint = f32(look.y & ~NEAR);
    store(id, 0u, vec4f(nx.x, ny.x, nz.x, depth.x));
    store(id, 1u, vec4f(nx.y, ny.y, nz.y, params.inverse_depth * (1.0 + mean)));
    store(id, 2u, vec4f(nx.z, ny.z, nz.z, bitcast<f32>(look.x)));
    store_bits(id, 3u, vec4u(bitcast<vec2u>(depth.yz), bitcast<vec2u>(anchor)));
    store(id, 4u, vec4f(s, t.x));
    store_bits(id, 5u, vec4u(bitcast<vec2u>(t.yz), bitcast<vec2u>(p.cell + step)));
    store(id, 6u, vec4f(paint, near, by_paint.yz));
}

fn store(id: u32, word: u32, value: vec4f) {
    store_bits(id, word, bitcast<vec4u>(value));
}
fn store_bits(id: u32, word: u32, bits: vec4u) {
    textureStore(triangles, texel(7u * id + word), bits);
}
