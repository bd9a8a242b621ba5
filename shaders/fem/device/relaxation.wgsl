// Steps of a Chebyshev smoother with block-diagonal scaling, float32 (gpusim/fem/device/relaxation.py has twin
// and driver, gpusim/fem/device/block_texels.py the matrix's layout):
//   x_out = x + keep (x - before) + gain D^-1 (b - A x),  (A x)_i = sum_j A_ij (x_j - x_i)
// One thread per node and load case; A x are forces of elements, which are summed up (the entries ending in _forces).
#import lib/numeric/index
#import lib/numeric/texel

struct Params {
    count: u32,   // nodes in this part
    nodes: u32,   // nodes in all
    cases: u32,   // load cases
    keep: f32,
    lag: f32,     // keep, or 0 where before is zero
    gain: f32,
    base: u32,    // texel of the first load case's first node
    stride: u32,  // texels from one of a row to its next one
}

const BLOCK: u32 = 64u;

// per node: first neighbours, fours of them, first blocks, the node;
// with forces: first texel of their list, texels of it, nothing, the node
@group(0) @binding(0) var info: texture_2d<u32>;
@group(0) @binding(1) var neighbour: texture_storage_2d<rgba32uint, read>;  // four a texel
@group(0) @binding(2) var blocks: texture_storage_2d<rgba32float, read>;     // nine texels per four blocks
// three texels per node: columns of D^-1 (xyz), whether it is free (w)
@group(0) @binding(3) var inverse: texture_2d<f32>;
@group(0) @binding(4) var x_in: texture_storage_2d<rgba32float, read>;
@group(0) @binding(5) var b_in: texture_2d<f32>;
@group(0) @binding(6) var before_in: texture_2d<f32>;
@group(0) @binding(7) var x_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var<uniform> params: Params;
@group(0) @binding(9) var lists: texture_storage_2d<rgba32uint, read>;   // twice the texel of a force, four a texel
@group(0) @binding(10) var forces: texture_storage_2d<rgba32float, read>;

fn place(gid: vec3u, groups: vec3u) -> vec3u {
    // number within this part, start of the load case, whether there is such a one
    let own = row_and_case(linear_id(gid, groups, BLOCK), params.cases, BLOCK);
    return vec3u(own.x, params.base + own.y * (params.nodes + 1u), u32(own.x < params.count));
}

fn load_x(at: u32) -> vec3f { return textureLoad(x_in, texel(at)).xyz; }

fn load_four(at: u32) -> vec4f { return textureLoad(blocks, texel(at)); }

fn product(base: u32, row: vec4u, own: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    let stride = params.stride;
    var at = row.z;
    for (var k = 0u; k < row.y; k++) {
        let other = textureLoad(neighbour, texel(row.x + k * stride)) + vec4u(base);
        let a = load_four(at);
        let b = load_four(at + stride);
        let c = load_four(at + 2u * stride);
        let d0 = load_x(other.x) - own;
        sum += a.xyz * d0.x + vec3f(a.w, b.xy) * d0.y + vec3f(b.zw, c.x) * d0.z;
        let d = load_four(at + 3u * stride);
        let e = load_four(at + 4u * stride);
        let d1 = load_x(other.y) - own;
        sum += c.yzw * d1.x + d.xyz * d1.y + vec3f(d.w, e.xy) * d1.z;
        let f = load_four(at + 5u * stride);
        let g = load_four(at + 6u * stride);
        let d2 = load_x(other.z) - own;
        sum += vec3f(e.zw, f.x) * d2.x + f.yzw * d2.y + g.xyz * d2.z;
        let h = load_four(at + 7u * stride);
        let i = load_four(at + 8u * stride);
        let d3 = load_x(other.w) - own;
        sum += vec3f(g.w, h.xy) * d3.x + vec3f(h.zw, i.x) * d3.y + i.yzw * d3.z;
        at += 9u * stride;
    }
    return sum;
}

fn load_force(entry: u32) -> vec3f { return textureLoad(forces, texel(entry >> 1u)).xyz; }

fn summed(row: vec4u) -> vec3f {
    var sum = vec3f(0.0);
    for (var k = row.x; k < row.x + row.y; k++) {
        let list = textureLoad(lists, texel(k));
        sum += load_force(list.x) + load_force(list.y) + load_force(list.z) + load_force(list.w);
    }
    return sum;
}

fn scaled(at: u32, r: vec3f) -> vec3f {
    return textureLoad(inverse, texel(at), 0).xyz * r.x
        + textureLoad(inverse, texel(at + 1u), 0).xyz * r.y
        + textureLoad(inverse, texel(at + 2u), 0).xyz * r.z;
}

fn is_free(at: u32) -> vec3<bool> {
    return vec3f(textureLoad(inverse, texel(at), 0).w, textureLoad(inverse, texel(at + 1u), 0).w,
        textureLoad(inverse, texel(at + 2u), 0).w) != vec3f(0.0);
}

// one step of the node at texel ``node``, whose x is ``own`` and A x is t; ``at`` its D^-1
fn step(node: u32, at: u32, own: vec3f, t: vec3f) {
    let place = texel(node);
    let z = scaled(at, textureLoad(b_in, place, 0).xyz - t);
    let before = textureLoad(before_in, place, 0).xyz;
    let x = own + params.keep * own - params.lag * before + params.gain * z;
    textureStore(x_out, place, vec4f(x, 0.0));
}

fn leave(node: u32, at: u32, t: vec3f) {
    let r = textureLoad(b_in, texel(node), 0).xyz - t;
    textureStore(x_out, texel(node), vec4f(select(vec3f(0.0), r, is_free(at)), 0.0));
}

// from zero: x_out = gain D^-1 b
@compute @workgroup_size(64)
fn begin(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let row = textureLoad(info, texel(here.x), 0);
    let at = texel(here.y + row.w);
    let x = params.gain * scaled(3u * row.w, textureLoad(b_in, at, 0).xyz);
    textureStore(x_out, at, vec4f(x, 0.0));
}

// x_out = x + keep x - lag before + gain D^-1 (b - A x)
@compute @workgroup_size(64)
fn relax(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let row = textureLoad(info, texel(here.x), 0);
    let node = here.y + row.w;
    let own = load_x(node);
    step(node, 3u * row.w, own, product(here.y, row, own));
}

@compute @workgroup_size(64)
fn relax_forces(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let row = textureLoad(info, texel(here.x), 0);
    let node = here.y + row.w;
    step(node, 3u * row.w, load_x(node), summed(row));
}

// x_out = b - A x, zero on fixed unknowns
@compute @workgroup_size(64)
fn residual(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let row = textureLoad(info, texel(here.x), 0);
    let node = here.y + row.w;
    let own = load_x(node);
    leave(node, 3u * row.w, product(here.y, row, own));
}

@compute @workgroup_size(64)
fn residual_forces(@builtin(global_invocation_id) gid: vec3u,
    @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let row = textureLoad(info, texel(here.x), 0);
    leave(here.y + row.w, 3u * row.w, summed(row));
}
