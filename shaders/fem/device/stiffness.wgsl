// y = K u in float64 with K in block texels (gpusim/fem/device/stiffness.py is the driver,
// gpusim/fem/device/block_texels.py has the layout): the NumPy form is `apply_stiffness` in
// gpusim/fem/sparse/stiffness_product.py. (K u)_i = sum_j K_ij (u_j - u_i), the diagonal is not
// stored. K and u are pairs of float32 textures (high, low); one thread per node and load case.
#import lib/numeric/index
#import lib/numeric/texel
#import lib/numeric/real

struct Params {
    count: u32,   // nodes in this part
    nodes: u32,   // nodes in all
    columns: u32, // nodes of u: the same for the stiffness
    cases: u32,   // load cases
    stride: u32,  // texels from one of a row to its next one
    low: u32,     // first texel of low halves
}

const BLOCK: u32 = 64u;
override plain: u32 = 0u;    // 1: sum_j A_ij u_j for any matrix
override rounded: u32 = 0u;  // 1: u is its high half

// per node: first neighbours, fours of them, first blocks, the node
@group(0) @binding(0) var info: texture_2d<u32>;
@group(0) @binding(1) var neighbour: texture_2d<u32>;  // four a texel
// nine texels per four blocks; the low halves of all of them behind the high ones
@group(0) @binding(2) var blocks: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var u_high: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var u_low: texture_2d<f32>;
@group(0) @binding(5) var k_high: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var k_low: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var<uniform> params: Params;

struct Vec {
    x: real,
    y: real,
    z: real,
}

struct Four {
    x: real,
    y: real,
    z: real,
    w: real,
}

fn load_u(at: u32) -> Vec {
    let high = textureLoad(u_high, texel(at));
    if (rounded == 1u) { return Vec(r_f32(high.x), r_f32(high.y), r_f32(high.z)); }
    let low = textureLoad(u_low, texel(at), 0);
    return Vec(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z));
}

fn load_four(at: u32) -> Four {
    let high = textureLoad(blocks, texel(at));
    let low = textureLoad(blocks, texel(params.low + at));
    return Four(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z),
        r_pair(high.w, low.w));
}

fn difference(at: u32, own: Vec) -> Vec {
    let u = load_u(at);
    return Vec(r_sub(u.x, own.x), r_sub(u.y, own.y), r_sub(u.z, own.z));
}

// sum + a column of a block times one component
fn add(sum: Vec, x: real, y: real, z: real, d: real) -> Vec {
    return Vec(r_fma(x, d, sum.x), r_fma(y, d, sum.y), r_fma(z, d, sum.z));
}

fn store(at: u32, sum: Vec) {
    textureStore(k_high, texel(at), vec4f(r_high(sum.x), r_high(sum.y), r_high(sum.z), 0.0));
    textureStore(k_low, texel(at), vec4f(r_low(sum.x), r_low(sum.y), r_low(sum.z), 0.0));
}

@compute @workgroup_size(64)
fn apply(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = row_and_case(linear_id(gid, groups, BLOCK), params.cases, BLOCK);
    if (here.x >= params.count) { return; }
    let base = here.y * (params.columns + 1u);
    let row = textureLoad(info, texel(here.x), 0);
    var own = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    if (plain == 0u) { own = load_u(base + row.w); }
    var sum = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    let stride = params.stride;
    var at = row.z;
    for (var k = 0u; k < row.y; k++) {
        let other = textureLoad(neighbour, texel(row.x + k * stride), 0) + vec4u(base);
        let a = load_four(at);
        let b = load_four(at + stride);
        let c = load_four(at + 2u * stride);
        let d0 = difference(other.x, own);
        sum = add(sum, a.x, a.y, a.z, d0.x);
        sum = add(sum, a.w, b.x, b.y, d0.y);
        sum = add(sum, b.z, b.w, c.x, d0.z);
        let d1 = difference(other.y, own);
        let d = load_four(at + 3u * stride);
        let e = load_four(at + 4u * stride);
        sum = add(sum, c.y, c.z, c.w, d1.x);
        sum = add(sum, d.x, d.y, d.z, d1.y);
        sum = add(sum, d.w, e.x, e.y, d1.z);
        let d2 = difference(other.z, own);
        let f = load_four(at + 5u * stride);
        let g = load_four(at + 6u * stride);
        sum = add(sum, e.z, e.w, f.x, d2.x);
        sum = add(sum, f.y, f.z, f.w, d2.y);
        sum = add(sum, g.x, g.y, g.z, d2.z);
        let d3 = difference(other.w, own);
        let h = load_four(at + 7u * stride);
        let i = load_four(at + 8u * stride);
        sum = add(sum, g.w, h.x, h.y, d3.x);
        sum = add(sum, h.z, h.w, i.x, d3.y);
        sum = add(sum, i.y, i.z, i.w, d3.z);
        at += 9u * stride;
    }
    store(here.y * (params.nodes + 1u) + row.w, sum);
}
