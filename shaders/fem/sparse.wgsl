// y = A x or y += A x for a matrix of 3x3 blocks in slices of 8 block rows (gpusim/fem/sparse.py
// has layout and twin). One thread per block row and load case.
#import common/index
#import common/real

struct Params {
    first: u32,    // first block row of this part
    rows: u32,     // block rows in this part
    height: u32,   // block rows in all
    width: u32,    // block columns in all
    cases: u32,
    add: u32,      // 1: add to y, 0: overwrite
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var<storage, read> slice_start: array<u32>;
@group(0) @binding(1) var<storage, read> row_length: array<u32>;
@group(0) @binding(2) var<storage, read> column: array<u32>;
@group(0) @binding(3) var<storage, read> value: array<real>;   // entry m of block at k: 9k + 8m
@group(0) @binding(4) var<storage, read> factor: array<real>;
@group(0) @binding(5) var<storage, read_write> product: array<real>;
@group(0) @binding(6) var<uniform> params: Params;

@compute @workgroup_size(64)
fn apply(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.rows * params.cases) { return; }
    let row = id % params.rows;
    let case_ = id / params.rows;
    let base = case_ * params.width;
    let lane = row % 8u;
    let count = row_length[row];
    var at = slice_start[row / 8u];
    var s0 = r_f32(0.0);
    var s1 = r_f32(0.0);
    var s2 = r_f32(0.0);
    for (var k = 0u; k < count; k++) {
        let other = 3u * (base + column[at + lane]);
        let f0 = factor[other];
        let f1 = factor[other + 1u];
        let f2 = factor[other + 2u];
        let v = 9u * at + lane;
        s0 = r_fma(value[v], f0, r_fma(value[v + 8u], f1, r_fma(value[v + 16u], f2, s0)));
        s1 = r_fma(value[v + 24u], f0, r_fma(value[v + 32u], f1, r_fma(value[v + 40u], f2, s1)));
        s2 = r_fma(value[v + 48u], f0, r_fma(value[v + 56u], f1, r_fma(value[v + 64u], f2, s2)));
        at += 8u;
    }
    let own = 3u * (case_ * params.height + params.first + row);
    if (params.add == 1u) {
        s0 = r_add(product[own], s0);
        s1 = r_add(product[own + 1u], s1);
        s2 = r_add(product[own + 2u], s2);
    }
    product[own] = s0;
    product[own + 1u] = s1;
    product[own + 2u] = s2;
}
