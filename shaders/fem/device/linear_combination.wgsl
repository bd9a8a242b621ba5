// out = a x + b before + c right + d product for vectors that are pairs of float32 textures, in
// float64 (gpusim/fem/device/linear_combination.py has twin and driver). One thread per texel.
#import lib/numeric/index
#import lib/numeric/texel
#import lib/numeric/real

struct Params {
    count: u32,
    x: f32,
    before: f32,
    right: f32,
    product: f32,
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var x_high: texture_2d<f32>;
@group(0) @binding(1) var x_low: texture_2d<f32>;
@group(0) @binding(2) var before_high: texture_2d<f32>;
@group(0) @binding(3) var before_low: texture_2d<f32>;
@group(0) @binding(4) var right_high: texture_2d<f32>;
@group(0) @binding(5) var right_low: texture_2d<f32>;
@group(0) @binding(6) var product_high: texture_2d<f32>;
@group(0) @binding(7) var product_low: texture_2d<f32>;
@group(0) @binding(8) var out_high: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var out_low: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var<uniform> params: Params;

struct Vec {
    x: real,
    y: real,
    z: real,
}

fn add(sum: Vec, factor: f32, high: vec4f, low: vec4f) -> Vec {
    let f = r_f32(factor);
    return Vec(r_fma(f, r_pair(high.x, low.x), sum.x), r_fma(f, r_pair(high.y, low.y), sum.y),
        r_fma(f, r_pair(high.z, low.z), sum.z));
}

@compute @workgroup_size(64)
fn combine(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.count) { return; }
    let at = texel(id);
    var sum = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    sum = add(sum, params.x, textureLoad(x_high, at, 0), textureLoad(x_low, at, 0));
    sum = add(sum, params.before, textureLoad(before_high, at, 0), textureLoad(before_low, at, 0));
    sum = add(sum, params.right, textureLoad(right_high, at, 0), textureLoad(right_low, at, 0));
    sum = add(sum, params.product, textureLoad(product_high, at, 0),
        textureLoad(product_low, at, 0));
    textureStore(out_high, at, vec4f(r_high(sum.x), r_high(sum.y), r_high(sum.z), 0.0));
    textureStore(out_low, at, vec4f(r_low(sum.x), r_low(sum.y), r_low(sum.z), 0.0));
}
