// One step of a Chebyshev smoother with block-diagonal scaling (gpusim/fem/smooth.py has the twin):
//   r_out = r_in - t;   d = keep d + gain D^-1 r_out;   x = hold x + d
// `relax` takes one unknown per thread and any block size, `relax3` one 3x3 block per thread;
// r is double-buffered because in the first form a block's threads all read the block's r.
#import common/index
#import common/real

struct Params {
    unknowns: u32,
    cases: u32,
    subtract: u32,  // 0: r_out = r_in (t is not read)
    keep: f32,
    gain: f32,
    hold: f32,
}

const BLOCK: u32 = 64u;
override size: u32 = 3u;    // unknowns per diagonal block

@group(0) @binding(0) var<storage, read> r_in: array<real>;
@group(0) @binding(1) var<storage, read> product: array<real>;
@group(0) @binding(2) var<storage, read> inverse: array<real>;
@group(0) @binding(3) var<storage, read_write> r_out: array<real>;
@group(0) @binding(4) var<storage, read_write> change: array<real>;
@group(0) @binding(5) var<storage, read_write> guess: array<real>;
@group(0) @binding(6) var<uniform> params: Params;

fn residual(at: u32) -> real {
    if (params.subtract == 0u) { return r_in[at]; }
    return r_sub(r_in[at], product[at]);
}

fn finish(id: u32, r: real, z: real) {
    r_out[id] = r;
    var delta = r_mul(r_f32(params.gain), z);
    if (params.keep != 0.0) { delta = r_fma(r_f32(params.keep), change[id], delta); }
    change[id] = delta;
    if (params.hold != 0.0) { delta = r_fma(r_f32(params.hold), guess[id], delta); }
    guess[id] = delta;
}

@compute @workgroup_size(64)
fn relax(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.unknowns * params.cases) { return; }
    let base = (id / params.unknowns) * params.unknowns;
    let row = id % params.unknowns;
    let first = base + (row / size) * size;
    var z = r_f32(0.0);
    for (var k = 0u; k < size; k++) {
        z = r_fma(inverse[row * size + k], residual(first + k), z);
    }
    finish(id, residual(id), z);
}

@compute @workgroup_size(64)
fn relax3(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = 3u * linear_id(gid, groups, BLOCK);
    if (id >= params.unknowns * params.cases) { return; }
    let at = 3u * (id % params.unknowns);
    let r0 = residual(id);
    let r1 = residual(id + 1u);
    let r2 = residual(id + 2u);
    finish(id, r0, r_fma(inverse[at], r0,
        r_fma(inverse[at + 1u], r1, r_mul(inverse[at + 2u], r2))));
    finish(id + 1u, r1, r_fma(inverse[at + 3u], r0,
        r_fma(inverse[at + 4u], r1, r_mul(inverse[at + 5u], r2))));
    finish(id + 2u, r2, r_fma(inverse[at + 6u], r0,
        r_fma(inverse[at + 7u], r1, r_mul(inverse[at + 8u], r2))));
}

@compute @workgroup_size(64)
fn difference(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.unknowns * params.cases) { return; }
    r_out[id] = residual(id);
}
