// The light on small matte triangles as affine functions of the pixel, and the pixels that read them.
// Described in gpusim/optics/glance.py.
#import common/index
#import common/surface
#import common/undistort
#import common/vertex

override lit: u32;

struct Params {
    rays: Rays,
    count: u32,
    width: u32,
    row0: i32,
    background: f32,
    // of the largest light at its corners, that a triangle's function may be off by
    tolerance: f32,
    // 1 / depth that those of the vertices are relative to
    inverse_depth: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
// the triangles to look at
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> corners: array<u32>;
// per triangle (bits of its albedo, its paint)
@group(0) @binding(11) var<storage, read> looks: array<vec2u>;
// per triangle radiance at an anchor, its change per column and per row, the anchor's column (lower
// half) and row
@group(0) @binding(6) var glances: texture_storage_2d<rgba32uint, write>;
// numbers + 1 of those whose light isn't affine, and the workgroups of 64 that they fill, 1, 1, their
// count
@group(0) @binding(7) var<storage, read_write> refused: array<u32>;
@group(0) @binding(8) var<storage, read_write> refusals: array<atomic<u32>, 4>;

// A place on a triangle: its offset from the anchor in the ideal image, px, relative 1 / depth, and
// the normal times that, which are affine in the image.
struct Place {
    at: vec2f,
    w: f32,
    normal: vec3f,
}
fn place_of(v: Vertex, anchor: vec2i) -> Place {
    let w = 1.0 + v.offset;
    return Place(offset_from(anchor, v), w, w * v.normal);
}
fn between(a: Place, b: Place) -> Place {
    return Place(0.5 * (a.at + b.at), 0.5 * (a.w + b.w), 0.5 * (a.normal + b.normal));
}

fn light_at(place: Place, anchor: vec2f) -> f32 {
    if (lit == 0u) { return 1.0; }
    let p = anchor + place.at;
    let depth = 1.0 / (place.w * params.inverse_depth);
    let ray = params.rays.x.xyz * p.x + params.rays.y.xyz * p.y + params.rays.one.xyz;
    return reflection(depth * ray, normalize(place.normal), Gloss(), 1.0, 0u).matte;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.count) { return; }
    let id = order[i];
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    let anchor = anchor_of(a, b, c);
    let origin = vec2f(anchor);
    let p = place_of(a, anchor);
    let q = place_of(b, anchor);
    let r = place_of(c, anchor);
    let light = vec3f(light_at(p, origin), light_at(q, origin), light_at(r, origin));
    let middle = vec3f(light_at(between(q, r), origin), light_at(between(r, p), origin),
        light_at(between(p, q), origin));
    let off = abs(middle - 0.5 * (light.yzx + light.zxy));
    let most = max(light.x, max(light.y, light.z));
    let u = q.at - p.at;
    let v = r.at - p.at;
    let area = u.x * v.y - u.y * v.x;
    let one = light.y - light.x;
    let two = light.z - light.x;
    let slope = vec2f(one * v.y - two * u.y, two * u.x - one * v.x)
        / select(area, 1.0, area == 0.0);
    let affine = max(off.x, max(off.y, off.z)) <= params.tolerance * most && area != 0.0;
    if (!affine) {
        let place = atomicAdd(&refusals[3], 1u);
        refused[place] = id + 1u;
        atomicMax(&refusals[0], place / 64u + 1u);
    }
    let radiance = bitcast<f32>(looks[id].x) * vec3f(light.x - dot(slope, p.at), slope);
    let place = (u32(anchor.y) << 16u) | (u32(anchor.x) & 65535u);
    textureStore(glances, texel(id), vec4u(bitcast<vec3u>(radiance), place));
}

// per pixel of the band what sight.wgsl found, the lower half first
@group(0) @binding(9) var<storage, read> nearest: array<vec2u>;
@group(0) @binding(10) var seen: texture_storage_2d<rgba32uint, read>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}
// Four pixels side by side: what a rasteriser does for one costs as much as what the pixel reads.
@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let four = vec2u(at.xy);
    let column = min(4u * four.x + vec4u(0u, 1u, 2u, 3u), vec4u(params.width - 1u));
    return vec4f(radiance_at(vec2u(column.x, four.y)), radiance_at(vec2u(column.y, four.y)),
        radiance_at(vec2u(column.z, four.y)), radiance_at(vec2u(column.w, four.y)));
}
fn radiance_at(at: vec2u) -> f32 {
    let number = 0u - nearest[at.y * params.width + at.x].x;
    let glance = textureLoad(seen, texel(max(number, 1u) - 1u));
    let pixel = vec2i(at) + vec2i(0, params.row0);
    let anchor = vec2i(i32(glance.w << 16u), i32(glance.w)) >> vec2u(16u);
    let d = vec2f(pixel - anchor) + undistort(bend_at(pixel), vec2f(0.0));
    let affine = bitcast<vec3f>(glance.xyz);
    return select(params.background, affine.x + dot(affine.yz, d), number > 0u);
}
