// y = K u with K as a table of distinct block rows (gpusim/fem/stiffness.py has layout and twin):
// (K u)_i = sum_j K_ij (u_j - u_i), the diagonal is not stored.
// `apply1` takes one node per thread; `apply4` takes four nodes with equal rows, which share the
// reads of the table: a read costs far more than the arithmetic that uses it.
#import common/index
#import common/real

struct Params {
    packs: u32,   // threads' worth of nodes in this part
    nodes: u32,   // nodes in all
    cases: u32,   // load cases
    stride: u32,  // distance of successive table entries of one row
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var<storage, read> slice_start: array<u32>;  // per 8 packs, into neighbour
@group(0) @binding(1) var<storage, read> neighbour: array<u32>;
@group(0) @binding(2) var<storage, read> node_of_pack: array<u32>; // padding repeats the first node
@group(0) @binding(3) var<storage, read> pack_info: array<u32>;    // (table start, degree) per pack
@group(0) @binding(4) var<storage, read> table: array<real>;
@group(0) @binding(5) var<storage, read> u_in: array<real>;
@group(0) @binding(6) var<storage, read_write> k_out: array<real>;
@group(0) @binding(7) var<uniform> params: Params;

struct Vec {
    x: real,
    y: real,
    z: real,
}

struct Block {
    row0: Vec,
    row1: Vec,
    row2: Vec,
}

fn load_u(node: u32) -> Vec {
    return Vec(u_in[3u * node], u_in[3u * node + 1u], u_in[3u * node + 2u]);
}

fn load_block(at: u32, s: u32) -> Block {
    return Block(
        Vec(table[at], table[at + s], table[at + 2u * s]),
        Vec(table[at + 3u * s], table[at + 4u * s], table[at + 5u * s]),
        Vec(table[at + 6u * s], table[at + 7u * s], table[at + 8u * s]));
}

fn fma_row(row: Vec, d: Vec, sum: real) -> real {
    return r_fma(row.x, d.x, r_fma(row.y, d.y, r_fma(row.z, d.z, sum)));
}

fn gather(b: Block, other: Vec, own: Vec, sum: Vec) -> Vec {
    let d = Vec(r_sub(other.x, own.x), r_sub(other.y, own.y), r_sub(other.z, own.z));
    return Vec(fma_row(b.row0, d, sum.x), fma_row(b.row1, d, sum.y), fma_row(b.row2, d, sum.z));
}

fn store(node: u32, value: Vec) {
    k_out[3u * node] = value.x;
    k_out[3u * node + 1u] = value.y;
    k_out[3u * node + 2u] = value.z;
}

@compute @workgroup_size(64)
fn apply1(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.packs * params.cases) { return; }
    let pack = id % params.packs;
    let base = (id / params.packs) * params.nodes;
    let node = base + node_of_pack[pack];
    let own = load_u(node);
    var at = slice_start[pack / 8u] + pack % 8u;
    var entry = pack_info[2u * pack];
    let degree = pack_info[2u * pack + 1u];
    var sum = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    for (var k = 0u; k < degree; k++) {
        let b = load_block(entry, params.stride);
        sum = gather(b, load_u(base + neighbour[at]), own, sum);
        entry += 9u * params.stride;
        at += 8u;
    }
    store(node, sum);
}

@compute @workgroup_size(64)
fn apply4(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.packs * params.cases) { return; }
    let pack = id % params.packs;
    let base = (id / params.packs) * params.nodes;
    let n0 = base + node_of_pack[4u * pack];
    let n1 = base + node_of_pack[4u * pack + 1u];
    let n2 = base + node_of_pack[4u * pack + 2u];
    let n3 = base + node_of_pack[4u * pack + 3u];
    let own0 = load_u(n0);
    let own1 = load_u(n1);
    let own2 = load_u(n2);
    let own3 = load_u(n3);
    var at = slice_start[pack / 8u] + pack % 8u;
    var entry = pack_info[2u * pack];
    let degree = pack_info[2u * pack + 1u];
    var sum0 = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    var sum1 = sum0;
    var sum2 = sum0;
    var sum3 = sum0;
    for (var k = 0u; k < degree; k++) {
        let b = load_block(entry, params.stride);
        sum0 = gather(b, load_u(base + neighbour[at]), own0, sum0);
        sum1 = gather(b, load_u(base + neighbour[at + 8u]), own1, sum1);
        sum2 = gather(b, load_u(base + neighbour[at + 16u]), own2, sum2);
        sum3 = gather(b, load_u(base + neighbour[at + 24u]), own3, sum3);
        entry += 9u * params.stride;
        at += 32u;
    }
    store(n0, sum0);
    if (n1 != n0) { store(n1, sum1); }
    if (n2 != n0) { store(n2, sum2); }
    if (n3 != n0) { store(n3, sum3); }
}
