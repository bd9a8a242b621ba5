// What the pixels of a triangle share, from its three vertices: affine functions of the offset from
// an anchor pixel, as lib/light/surface.wgsl reads them. Described in gpusim/optics/raster/triangle_records.py.
#import lib/numeric/index
#import lib/raster/planes
#import lib/numeric/texel
#import lib/raster/vertex

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
