// Vector and scalar steps of preconditioned conjugate gradients (gpusim/fem/krylov/cg.py has the twin).
// q = K p and r are pairs of float32 textures (high, low), one texel a node; p and z are float32,
// and so is r for the preconditioner: its high half.
// Sums are trees of fixed shape: the same bits on every run. Grid y is the load case.
#import lib/numeric/real
#import lib/numeric/texel

const GROUPS: u32 = 128u;   // partial sums per load case
const WIDTH: u32 = 64u;

struct Params {
    nodes: u32,
    capacity: u32,   // iterations that fit in the history
}

@group(0) @binding(0) var p_in: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var q_high: texture_storage_2d<rgba32float, read>;   // K p
@group(0) @binding(3) var q_low: texture_2d<f32>;
@group(0) @binding(4) var r_high_in: texture_2d<f32>;
@group(0) @binding(5) var r_low_in: texture_2d<f32>;
@group(0) @binding(6) var z_in: texture_storage_2d<rgba32float, read>;
@group(0) @binding(7) var high_out: texture_storage_2d<rgba32float, write>;  // new p or r
@group(0) @binding(8) var low_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var<storage, read_write> solution: array<real>;  // three numbers a node
@group(0) @binding(10) var<storage, read_write> partial: array<real>;  // GROUPS per case
@group(0) @binding(11) var<storage, read_write> scalars: array<real>;  // r.z, alpha, beta, p.q
@group(0) @binding(12) var<storage, read_write> history: array<real>;  // the same, per iteration
@group(0) @binding(13) var<storage, read_write> state: array<u32>;     // active, iteration per case
@group(0) @binding(14) var<uniform> params: Params;

var<workgroup> sums: array<real, 64>;

struct Vec {
    x: real,
    y: real,
    z: real,
}

fn load_p(at: vec2u) -> Vec {
    let p = textureLoad(p_in, at);
    return Vec(r_f32(p.x), r_f32(p.y), r_f32(p.z));
}

fn load_q(at: vec2u) -> Vec {
    let high = textureLoad(q_high, at);
    let low = textureLoad(q_low, at, 0);
    return Vec(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z));
}

fn load_r(at: vec2u) -> Vec {
    let high = textureLoad(r_high_in, at, 0);
    let low = textureLoad(r_low_in, at, 0);
    return Vec(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z));
}

fn store(at: vec2u, value: Vec) {
    textureStore(high_out, at, vec4f(r_high(value.x), r_high(value.y), r_high(value.z), 0.0));
    textureStore(low_out, at, vec4f(r_low(value.x), r_low(value.y), r_low(value.z), 0.0));
}

// texel of a node of this load case
fn place(case_: u32, node: u32) -> vec2u { return texel(case_ * (params.nodes + 1u) + node); }

fn tree(lane: u32) {
    for (var half = WIDTH / 2u; half > 0u; half = half / 2u) {
        workgroupBarrier();
        if (lane < half) { sums[lane] = r_add(sums[lane], sums[lane + half]); }
    }
}

@compute @workgroup_size(64)
fn dot_pq(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    var sum = r_f32(0.0);
    for (var i = group.x * WIDTH + lane; i < params.nodes; i += GROUPS * WIDTH) {
        let p = load_p(place(group.y, i));
        let q = load_q(place(group.y, i));
        sum = r_fma(p.x, q.x, r_fma(p.y, q.y, r_fma(p.z, q.z, sum)));
    }
    sums[lane] = sum;
    tree(lane);
    if (lane == 0u) { partial[group.y * GROUPS + group.x] = sums[0]; }
}

@compute @workgroup_size(64)
fn dot_rz(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    var sum = r_f32(0.0);
    for (var i = group.x * WIDTH + lane; i < params.nodes; i += GROUPS * WIDTH) {
        let z = textureLoad(z_in, place(group.y, i));
        let r = load_r(place(group.y, i));
        sum = r_fma(r_f32(z.x), r.x, r_fma(r_f32(z.y), r.y, r_fma(r_f32(z.z), r.z, sum)));
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

// x += alpha p, new r = r - alpha q
@compute @workgroup_size(64)
fn advance(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3u) {
    let length_ = scalars[4u * group.y + 1u];
    let back = r_neg(length_);
    let base = group.y * params.nodes;
    for (var i = group.x * WIDTH + lane; i < params.nodes; i += groups.x * WIDTH) {
        let here = place(group.y, i);
        let p = load_p(here);
        let at = 3u * (base + i);
        solution[at] = r_fma(length_, p.x, solution[at]);
        solution[at + 1u] = r_fma(length_, p.y, solution[at + 1u]);
        solution[at + 2u] = r_fma(length_, p.z, solution[at + 2u]);
        let q = load_q(here);
        let r = load_r(here);
        store(here, Vec(r_fma(back, q.x, r.x), r_fma(back, q.y, r.y), r_fma(back, q.z, r.z)));
    }
}

// new p = z + beta p, to the nearest float32
@compute @workgroup_size(64)
fn turn(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3u) {
    let ratio = scalars[4u * group.y + 2u];
    for (var i = group.x * WIDTH + lane; i < params.nodes; i += groups.x * WIDTH) {
        let here = place(group.y, i);
        let z = textureLoad(z_in, here);
        let before = load_p(here);
        let p = Vec(r_fma(ratio, before.x, r_f32(z.x)), r_fma(ratio, before.y, r_f32(z.y)),
            r_fma(ratio, before.z, r_f32(z.z)));
        textureStore(high_out, here, vec4f(r_high(p.x), r_high(p.y), r_high(p.z), 0.0));
    }
}
