// The light on small matte triangles as affine functions of the pixel, and the pixels that read them.
// Described in gpusim/optics/glance.py.
#import common/index
#import common/surface
#import common/undistort

override lit: u32;

struct Params {
    rays: Rays,
    count: u32,
    width: u32,
    row0: i32,
    background: f32,
    // of the largest light at its corners, that a triangle's function may be off by
    tolerance: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
// the triangles to look at
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> corners: array<u32>;
// as records.wgsl reads them
@group(0) @binding(3) var vertices: texture_2d<u32>;
// per triangle radiance at an anchor, its change per column and per row, the anchor's column (lower
// half) and row
@group(0) @binding(6) var glances: texture_storage_2d<rgba32uint, write>;
// numbers + 1 of those whose light isn't affine, and the workgroups of 64 that they fill, 1, 1, their
// count
@group(0) @binding(7) var<storage, read_write> refused: array<u32>;
@group(0) @binding(8) var<storage, read_write> refusals: array<atomic<u32>, 4>;

// A corner's offset from the anchor in the ideal image, px.
fn offset_of(corner: u32, anchor: vec2i) -> vec2f {
    let at = textureLoad(vertices, texel(3u * corner), 0);
    let rest = vec2f(vec2u(at.z & 65535u, at.z >> 16u)) / 65536.0;
    return (vec2f(vec2i(at.xy) - anchor * 65536) + rest) / 65536.0;
}

fn light_at(t: Triangle, d: vec2f) -> f32 {
    if (lit == 0u) { return 1.0; }
    return reflection_at(t, params.rays, vec2f(t.place.xy) + d, d, 0u).matte;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.count) { return; }
    let id = order[i];
    let t = triangle_at(id);
    let anchor = t.place.xy;
    let p = offset_of(corners[3u * id], anchor);
    let q = offset_of(corners[3u * id + 1u], anchor);
    let r = offset_of(corners[3u * id + 2u], anchor);
    let light = vec3f(light_at(t, p), light_at(t, q), light_at(t, r));
    let middle = vec3f(
        light_at(t, 0.5 * (q + r)), light_at(t, 0.5 * (r + p)), light_at(t, 0.5 * (p + q)));
    let off = abs(middle - 0.5 * (light.yzx + light.zxy));
    let most = max(light.x, max(light.y, light.z));
    let u = q - p;
    let v = r - p;
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
    let radiance = t.more.x * vec3f(light.x - dot(slope, p), slope);
    let place = (u32(anchor.y) << 16u) | (u32(anchor.x) & 65535u);
    textureStore(glances, texel(id), vec4u(bitcast<vec3u>(radiance), place));
}

// per pixel of the band what sight.wgsl found, the lower half first
@group(0) @binding(9) var<storage, read> nearest: array<vec2u>;
@group(0) @binding(10) var seen: texture_2d<u32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}
@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) f32 {
    let column = vec2u(at.xy);
    let number = 0u - nearest[column.y * params.width + column.x].x;
    let glance = textureLoad(seen, texel(max(number, 1u) - 1u), 0);
    let pixel = vec2i(column) + vec2i(0, params.row0);
    let anchor = vec2i(i32(glance.w << 16u), i32(glance.w)) >> vec2u(16u);
    let d = vec2f(pixel - anchor) + undistort(bend_at(pixel), vec2f(0.0));
    let affine = bitcast<vec3f>(glance.xyz);
    return select(params.background, affine.x + dot(affine.yz, d), number > 0u);
}
