// What the pixels of a triangle share, from its three vertices: affine functions of the offset from
// an anchor pixel, as lib/light/surface.wgsl reads them. Described in gpusim/optics/shading/scene_buffers.py.
#import lib/numeric/index
#import lib/numeric/texel

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

const NEAR: u32 = 0x80000000u;

// per vertex three texels: (column, row in 1/65536 px, relative offset of 1 / depth, what places leave in
// 16 bits each), (cells of the pattern along s and t, s and t within the cell),
// (normal, side of a cell)
@group(0) @binding(3) var vertices: texture_storage_2d<rgba32uint, read>;

const PIXEL: f32 = 65536.0;

struct Vertex {
    at: vec2i,
    rest: vec2f,
    // of 1 / depth
    offset: f32,
    cell: vec2i,
    st: vec2f,
    normal: vec3f,
    side: f32,
}
fn vertex_at(number: u32) -> Vertex {
    let a = textureLoad(vertices, texel(3u * number));
    let b = textureLoad(vertices, texel(3u * number + 1u));
    let c = bitcast<vec4f>(textureLoad(vertices, texel(3u * number + 2u)));
    let rest = vec2f(vec2u(a.w & 65535u, a.w >> 16u)) / PIXEL;
    return Vertex(bitcast<vec2i>(a.xy), rest, bitcast<f32>(a.z), bitcast<vec2i>(b.xy),
        bitcast<vec2f>(b.zw), c.xyz, c.w);
}

// The pixel next to the middle of a triangle.
fn anchor_of(p: Vertex, q: Vertex, r: Vertex) -> vec2i {
    // no division of whole numbers, which is done one by one
    let middle = p.at + vec2i(vec2f(q.at - p.at + r.at - p.at) / 3.0);
    return (middle + vec2i(32768)) >> vec2u(16u);
}

// Where a vertex lies from a pixel's middle, px.
fn offset_from(pixel: vec2i, v: Vertex) -> vec2f {
    return (vec2f(v.at - pixel * 65536) + v.rest) / PIXEL;
}

// What is affine on a triangle in the image, from its three vertices: barycentric coordinates, depth and
// paint coordinates, as functions of the offset from an anchor pixel.
//
// Differences between vertices are taken in whole steps and their remainders, so that float32 keeps
// what matters however far from the image's or the paint's origin a triangle lies.
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

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let p = vertex_at(corners[3u * id]);
    let q = vertex_at(corners[3u * id + 1u]);
    let r = vertex_at(corners[3u * id + 2u]);
    let look = looks[id];
    let by_paint = textureLoad(traits, texel(look.y & ~NEAR), 0);

    let f = planes_of(p, q, r);
    let w = f.w;
    let k = f.k;

    let weighted = p.normal * (1.0 + k.x);
    let n1 = q.normal * (1.0 + k.y) - weighted;
    let n2 = r.normal * (1.0 + k.z) - weighted;
    let nx = plane(w, weighted.x, n1.x, n2.x);
    let ny = plane(w, weighted.y, n1.y, n2.y);
    let nz = plane(w, weighted.z, n1.z, n2.z);

    let near = f32(look.y >> 31u) * by_paint.x;
    let paint = f32(look.y & ~NEAR);
    store(id, 0u, vec4f(nx.x, ny.x, nz.x, f.depth.x));
    store(id, 1u, vec4f(nx.y, ny.y, nz.y, params.inverse_depth * (1.0 + f.mean)));
    store(id, 2u, vec4f(nx.z, ny.z, nz.z, bitcast<f32>(look.x)));
    store_bits(id, 3u, vec4u(bitcast<vec2u>(f.depth.yz), bitcast<vec2u>(f.anchor)));
    store(id, 4u, vec4f(f.s, f.t.x));
    store_bits(id, 5u, vec4u(bitcast<vec2u>(f.t.yz), bitcast<vec2u>(f.cell)));
    store(id, 6u, vec4f(paint, near, by_paint.yz));
}

fn store(id: u32, word: u32, value: vec4f) {
    store_bits(id, word, bitcast<vec4u>(value));
}
fn store_bits(id: u32, word: u32, bits: vec4u) {
    textureStore(triangles, texel(7u * id + word), bits);
}
