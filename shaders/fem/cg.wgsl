// Vector and scalar steps of preconditioned conjugate gradients (gpusim/fem/cg.py has the twin).
// Sums are trees of fixed shape: the same bits on every run. Grid y is the load case.
#import common/real

const GROUPS: u32 = 128u;   // partial sums per load case
const WIDTH: u32 = 64u;

struct Params {
    unknowns: u32,
    capacity: u32,   // iterations that fit in the history
}

@group(0) @binding(0) var<storage, read> left: array<real>;
@group(0) @binding(1) var<storage, read> right: array<real>;
@group(0) @binding(2) var<storage, read_write> partial: array<real>;   // GROUPS per case
@group(0) @binding(3) var<storage, read_write> scalars: array<real>;   // r.z, alpha, beta, p.q
@group(0) @binding(4) var<storage, read_write> history: array<real>;   // the same, per iteration
@group(0) @binding(5) var<storage, read_write> state: array<u32>;      // active, iteration per case
@group(0) @binding(6) var<storage, read_write> solution: array<real>;
@group(0) @binding(7) var<storage, read_write> remainder: array<real>;
@group(0) @binding(8) var<uniform> params: Params;

var<workgroup> sums: array<real, 64>;

fn tree(lane: u32) {
    for (var half = WIDTH / 2u; half > 0u; half = half / 2u) {
        workgroupBarrier();
        if (lane < half) { sums[lane] = r_add(sums[lane], sums[lane + half]); }
    }
}

@compute @workgroup_size(64)
fn dot(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let base = group.y * params.unknowns;
    var sum = r_f32(0.0);
    for (var i = group.x * WIDTH + lane; i < params.unknowns; i += GROUPS * WIDTH) {
        sum = r_fma(left[base + i], right[base + i], sum);
    }
    sums[lane] = sum;
    tree(lane);
    if (lane == 0u) { partial[group.y * GROUPS + group.x] = sums[0]; }
}

fn total(case_: u32, lane: u32) -> real {
    let at = case_ * GROUPS + lane;
    sums[lane] = r_add(partial[at], partial[at + WIDTH]);
    tree(lane);
    workgroupBarrier();
    return sums[0];
}

fn positive(value: real) -> bool { return r_lt(r_f32(0.0), value); }

// first r.z of a run: no iteration done, direction starts afresh
@compute @workgroup_size(64)
fn start(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let rz = total(group.y, lane);
    if (lane != 0u) { return; }
    scalars[4u * group.y] = rz;
    scalars[4u * group.y + 1u] = r_f32(0.0);
    scalars[4u * group.y + 2u] = r_f32(0.0);
    scalars[4u * group.y + 3u] = r_f32(0.0);
}

// alpha = r.z / p.q; an inactive case, or one that broke down, takes no length_
@compute @workgroup_size(64)
fn alpha(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pq = total(group.y, lane);
    if (lane != 0u) { return; }
    let at = 4u * group.y;
    var length_ = r_f32(0.0);
    if (state[2u * group.y] == 1u && positive(pq)) { length_ = r_div(scalars[at], pq); }
    scalars[at + 1u] = length_;
    scalars[at + 3u] = pq;
}

// beta = new r.z / old r.z; one line of history: old r.z, alpha, beta, p.q
@compute @workgroup_size(64)
fn beta(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3u) {
    let rz = total(group.y, lane);
    if (lane != 0u) { return; }
    let at = 4u * group.y;
    let old = scalars[at];
    var ratio = r_f32(0.0);
    if (state[2u * group.y] == 1u && positive(old)) { ratio = r_div(rz, old); }
    let iteration = state[2u * group.y + 1u];
    if (iteration < params.capacity) {
        let line = 4u * (iteration * groups.y + group.y);
        history[line] = old;
        history[line + 1u] = scalars[at + 1u];
        history[line + 2u] = ratio;
        history[line + 3u] = scalars[at + 3u];
    }
    scalars[at] = rz;
    scalars[at + 2u] = ratio;
    state[2u * group.y + 1u] = iteration + 1u;
}

// x += alpha p, r -= alpha q, with left = p and right = q
@compute @workgroup_size(64)
fn advance(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3u) {
    let length_ = scalars[4u * group.y + 1u];
    let back = r_neg(length_);
    let base = group.y * params.unknowns;
    for (var i = group.x * WIDTH + lane; i < params.unknowns; i += groups.x * WIDTH) {
        solution[base + i] = r_fma(length_, left[base + i], solution[base + i]);
        remainder[base + i] = r_fma(back, right[base + i], remainder[base + i]);
    }
}

// p = z + beta p, with left = z and solution = p
@compute @workgroup_size(64)
fn turn(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3u) {
    let ratio = scalars[4u * group.y + 2u];
    let base = group.y * params.unknowns;
    for (var i = group.x * WIDTH + lane; i < params.unknowns; i += groups.x * WIDTH) {
        solution[base + i] = r_fma(ratio, solution[base + i], left[base + i]);
    }
}
