// Where a surface's vertices lie on the image, and what else a view's programs read of them.
// Described in gpusim/optics/series/project.py.
#import lib/numeric/index
#import lib/numeric/real
#import lib/numeric/texel

struct Params {
    count: u32,
    // 1 / depth that those of the vertices are relative to: its inverse is depth_high + depth_low
    depth_high: f32,
    depth_low: f32,
    // how much shorter or longer depths may be than that one
    times: f32,
    // px that may be in view or near: lowest column and row, highest
    low: vec2f,
    high: vec2f,
    // xyz: where places are taken from, as the camera's matrix does
    origin: vec4f,
    // rows of the camera's matrix and of the lens's, in two parts
    world_high: array<vec4f, 3>,
    world_low: array<vec4f, 3>,
    lens_high: array<vec4f, 2>,
    lens_low: array<vec4f, 2>,
}
@group(0) @binding(0) var<uniform> params: Params;
// three numbers a vertex
@group(0) @binding(1) var<storage, read> points: array<real>;
// as lib/raster/vertex.wgsl reads them
@group(0) @binding(2) var vertices: texture_storage_2d<rgba32uint, write>;
// column and row in 1/65536 px
@group(0) @binding(3) var<storage, read_write> screen: array<vec2i>;
// the last one: 1 if a vertex lies where it shouldn't
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>, 6>;

// A coordinate in the camera's system.
fn row(k: u32, x: real, y: real, z: real) -> real {
    let high = params.world_high[k];
    let low = params.world_low[k];
    let across = r_mul(r_pair(high.x, low.x), x);
    let down = r_fma(r_pair(high.y, low.y), y, across);
    return r_add(r_fma(r_pair(high.z, low.z), z, down), r_pair(high.w, low.w));
}

// A column or row, px, from shares of the depth.
fn place(k: u32, x: real, y: real) -> real {
    let high = params.lens_high[k];
    let low = params.lens_low[k];
    let across = r_mul(r_pair(high.x, low.x), x);
    return r_add(r_fma(r_pair(high.y, low.y), y, across), r_pair(high.z, low.z));
}

// In whole steps of 1/65536 px, and what is over in 1/65536 of one.
struct Fixed {
    whole: i32,
    rest: u32,
}
fn fixed(v: real) -> Fixed {
    let pixel = floor(r_high(v));
    let steps = r_mul(r_sub(v, r_f32(pixel)), r_f32(65536.0));
    let first = floor(r_high(steps));
    // the nearest float32 may lie above
    let over = r_to_f32(r_sub(steps, r_f32(first)));
    let below = floor(over);
    return Fixed(i32(pixel) * 65536 + i32(first) + i32(below),
        u32(clamp((over - below) * 65536.0, 0.0, 65535.0)));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let x = r_sub(points[3u * id], r_f32(params.origin.x));
    let y = r_sub(points[3u * id + 1u], r_f32(params.origin.y));
    let z = r_sub(points[3u * id + 2u], r_f32(params.origin.z));
    let depth = row(2u, x, y, z);
    let share = r_to_f32(depth) / params.depth_high;
    let ahead = share > 1.0 / params.times && share < params.times;
    let inverse = r_div(r_f32(1.0), depth);
    let h = r_mul(row(0u, x, y, z), inverse);
    let v = r_mul(row(1u, x, y, z), inverse);
    let column = place(0u, h, v);
    let line = place(1u, h, v);
    let at = vec2f(r_to_f32(column), r_to_f32(line));
    // also where there is no number
    if (!(ahead && all(at > params.low) && all(at < params.high))) {
        atomicStore(&counts[5], 1u);
        return;
    }
    let offset = r_sub(r_mul(r_pair(params.depth_high, params.depth_low), inverse), r_f32(1.0));
    let across = fixed(column);
    let down = fixed(line);
    let rest = across.rest | (down.rest << 16u);
    let whole = vec2i(across.whole, down.whole);
    textureStore(vertices, texel(3u * id),
        vec4u(bitcast<vec2u>(whole), bitcast<u32>(r_to_f32(offset)), rest));
    screen[id] = whole + vec2i(vec2u(across.rest, down.rest) >> vec2u(15u));
}

struct Filled {
    count: u32,
    // which of a vertex's three texels
    texel: u32,
}
@group(0) @binding(5) var<uniform> filled: Filled;
// per vertex that texel
@group(0) @binding(6) var<storage, read> words: array<vec4u>;

// What stays while vertices move.
@compute @workgroup_size(64)
fn fill(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id < filled.count) { textureStore(vertices, texel(3u * id + filled.texel), words[id]); }
}
