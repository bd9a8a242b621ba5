// Of each triangle of the view its plane and how far normals for shading lean from its own, from its record
// (lib/light/surface.wgsl). Its 1 / depth is n / d times the ray through a pixel, so that its changes in
// the image tell n / d. The NumPy form is gpusim/optics/shading/scene_buffers.py.
#import lib/numeric/index
#import lib/raster/undistortion_table
#import optics/shadow/plane_words

struct Params {
    // ray of unit depth through a pixel: x * column + y * row + one
    x: vec4f,
    y: vec4f,
    one: vec4f,
    // last pixel of the picture
    last: vec2f,
    count: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// three vertices per triangle, and these in 1/65536 px
@group(0) @binding(1) var<storage, read> corners: array<u32>;
@group(0) @binding(2) var<storage, read> screen: array<vec2i>;
// per triangle the occluder that it is part of, -1 for none
@group(0) @binding(3) var<storage, read> owners: array<i32>;
@group(0) @binding(4) var triangles: texture_storage_2d<rgba32uint, read>;
// see receiver.wgsl and plane_words.wgsl
@group(0) @binding(5) var planes: texture_storage_2d<rgba32uint, write>;

// Where a vertex lies in the ideal image, from a pixel's centre. Beside the picture its outermost tile's
// cubic goes on.
fn offset_from(anchor: vec2i, vertex: u32) -> vec2f {
    let at = screen[vertex];
    let pixel = vec2i(clamp(round(vec2f(at) / 65536.0), vec2f(0.0), params.last));
    return vec2f(pixel - anchor) + undistort(bend_at(pixel), vec2f(at - pixel * 65536) / 65536.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let n0 = bitcast<vec4f>(textureLoad(triangles, texel(7u * id)));
    let nx = bitcast<vec4f>(textureLoad(triangles, texel(7u * id + 1u)));
    let ny = bitcast<vec4f>(textureLoad(triangles, texel(7u * id + 2u)));
    let w = textureLoad(triangles, texel(7u * id + 3u));
    let slope = bitcast<vec2f>(w.xy);
    let anchor = bitcast<vec2i>(w.zw);

    let ray = params.one.xyz + f32(anchor.x) * params.x.xyz + f32(anchor.y) * params.y.xyz;
    let across = cross(params.y.xyz, ray);
    let n = slope.x * across + slope.y * cross(ray, params.x.xyz) + n0.w * cross(params.x.xyz, params.y.xyz);
    let plane = nx.w / dot(params.x.xyz, across) * n;

    let own = normalize(plane);
    var lean = 0.0;
    for (var k = 0u; k < 3u; k++) {
        let d = offset_from(anchor, corners[3u * id + k]);
        let shaded = normalize(n0.xyz + d.x * nx.xyz + d.y * ny.xyz);
        lean = max(lean, min(distance(shaded, own), distance(shaded, -own)));
    }
    let steps = select(0.0, min(ceil(lean * LEAN), 255.0), lean > 1e-4);
    textureStore(planes, texel(id), vec4u(bitcast<vec3u>(plane), (u32(owners[id]) & NO_OWNER) | (u32(steps) << 24u)));
}
