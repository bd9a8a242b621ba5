// Between float32 texels, one per node, and float64 buffers, three numbers per node
// (gpusim/fem/exchange.py has twin and driver). One thread per node and load case.
#import common/index
#import common/texel
#import common/real

struct Params {
    nodes: u32,
    cases: u32,
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var x_in: texture_2d<f32>;
@group(0) @binding(1) var<storage, read> value_in: array<real>;
@group(0) @binding(2) var<storage, read_write> value_out: array<real>;
@group(0) @binding(3) var x_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Params;

// value_out = x_in
@compute @workgroup_size(64)
fn widen(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.nodes * params.cases) { return; }
    let x = textureLoad(x_in, texel(id + id / params.nodes), 0);
    value_out[3u * id] = r_f32(x.x);
    value_out[3u * id + 1u] = r_f32(x.y);
    value_out[3u * id + 2u] = r_f32(x.z);
}

// x_out = x_in + value_in
@compute @workgroup_size(64)
fn add(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.nodes * params.cases) { return; }
    let at = texel(id + id / params.nodes);
    let x = textureLoad(x_in, at, 0);
    textureStore(x_out, at, vec4f(
        r_high(r_add(r_f32(x.x), value_in[3u * id])),
        r_high(r_add(r_f32(x.y), value_in[3u * id + 1u])),
        r_high(r_add(r_f32(x.z), value_in[3u * id + 2u])), 0.0));
}

// x_out = value_in
@compute @workgroup_size(64)
fn narrow(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.nodes * params.cases) { return; }
    textureStore(x_out, texel(id + id / params.nodes), vec4f(
        r_high(value_in[3u * id]),
        r_high(value_in[3u * id + 1u]),
        r_high(value_in[3u * id + 2u]), 0.0));
}
