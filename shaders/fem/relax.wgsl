// Steps of a Chebyshev smoother with block-diagonal scaling, float32, one thread per node and load
// case (gpusim/fem/relax.py has twin and driver, gpusim/fem/block_texels.py the matrix's layout):
//   r_out = r_in - A v;   d = keep v + gain D^-1 r_out;   x_out = x_in + d
// with (A v)_i = sum_j A_ij (v_j - v_i).
#import common/index
#import common/texel

struct Params {
    first: u32,   // first node of this part
    count: u32,   // nodes or packs in this part
    nodes: u32,   // nodes in all
    cases: u32,   // load cases
    keep: f32,
    gain: f32,
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var info: texture_2d<u32>;       // per node: neighbours, fours, blocks; or packs
@group(0) @binding(1) var neighbour: texture_2d<u32>;  // four a texel
@group(0) @binding(2) var blocks: texture_2d<f32>;     // nine texels per four blocks
@group(0) @binding(3) var inverse: texture_2d<f32>;    // three texels per node: columns of D^-1 (xyz)
// and whether the unknown is free (w)
@group(0) @binding(4) var v_in: texture_2d<f32>;
@group(0) @binding(5) var r_in: texture_2d<f32>;
@group(0) @binding(6) var x_in: texture_2d<f32>;
@group(0) @binding(7) var r_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var d_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var x_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var<uniform> params: Params;

fn place(gid: vec3u, groups: vec3u) -> vec3u {
    // number within this part, start of the load case, whether there is such a one
    let id = linear_id(gid, groups, BLOCK);
    return vec3u(id % params.count, (id / params.count) * (params.nodes + 1u),
        u32(id < params.count * params.cases));
}

fn load_v(at: u32) -> vec3f { return textureLoad(v_in, texel(at), 0).xyz; }

fn load_four(at: u32) -> vec4f { return textureLoad(blocks, texel(at), 0); }

fn product(base: u32, row: vec4u, own: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var at = row.z;
    for (var k = row.x; k < row.x + row.y; k++) {
        let other = textureLoad(neighbour, texel(k), 0) + vec4u(base);
        let a = load_four(at);
        let b = load_four(at + 1u);
        let c = load_four(at + 2u);
        let d0 = load_v(other.x) - own;
        sum += a.xyz * d0.x + vec3f(a.w, b.xy) * d0.y + vec3f(b.zw, c.x) * d0.z;
        let d = load_four(at + 3u);
        let e = load_four(at + 4u);
        let d1 = load_v(other.y) - own;
        sum += c.yzw * d1.x + d.xyz * d1.y + vec3f(d.w, e.xy) * d1.z;
        let f = load_four(at + 5u);
        let g = load_four(at + 6u);
        let d2 = load_v(other.z) - own;
        sum += vec3f(e.zw, f.x) * d2.x + f.yzw * d2.y + g.xyz * d2.z;
        let h = load_four(at + 7u);
        let i = load_four(at + 8u);
        let d3 = load_v(other.w) - own;
        sum += vec3f(g.w, h.xy) * d3.x + vec3f(h.zw, i.x) * d3.y + i.yzw * d3.z;
        at += 9u;
    }
    return sum;
}

// Four nodes in a row with equal rows of blocks: a pack is (first node, nodes, table, runs).
struct Sums {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    d: vec3f,
}

fn packed(base: u32, pack: vec4u) -> Sums {
    let own0 = load_v(base + pack.x);
    let own1 = load_v(base + pack.x + 1u);
    let own2 = load_v(base + pack.x + 2u);
    let own3 = load_v(base + pack.x + 3u);
    var at = pack.z;
    // what the rows lack to a sum of zero
    let rest0 = load_four(at).xyz;
    let rest1 = load_four(at + 1u).xyz;
    let rest2 = load_four(at + 2u).xyz;
    at += 3u;
    var sum = Sums(
        rest0 * own0.x + rest1 * own0.y + rest2 * own0.z,
        rest0 * own1.x + rest1 * own1.y + rest2 * own1.z,
        rest0 * own2.x + rest1 * own2.y + rest2 * own2.z,
        rest0 * own3.x + rest1 * own3.y + rest2 * own3.z);
    for (var run = 0u; run < pack.w; run++) {
        // three blocks for three nodes in a row, and how far they lie from the pack's
        let a = load_four(at);
        let b = load_four(at + 1u);
        let c = load_four(at + 2u);
        let d = load_four(at + 3u);
        let e = load_four(at + 4u);
        let f = load_four(at + 5u);
        let g = load_four(at + 6u);
        at += 7u;
        let first = base + pack.x + bitcast<u32>(i32(g.w));
        let u0 = load_v(first);
        let u1 = load_v(first + 1u);
        let u2 = load_v(first + 2u);
        let u3 = load_v(first + 3u);
        let u4 = load_v(first + 4u);
        let u5 = load_v(first + 5u);
        let k0 = a.xyz;
        let k1 = vec3f(a.w, b.xy);
        let k2 = vec3f(b.zw, c.x);
        let l0 = c.yzw;
        let l1 = d.xyz;
        let l2 = vec3f(d.w, e.xy);
        let m0 = vec3f(e.zw, f.x);
        let m1 = f.yzw;
        let m2 = g.xyz;
        var p = u0 - own0;
        var q = u1 - own0;
        var r = u2 - own0;
        sum.a += k0 * p.x + k1 * p.y + k2 * p.z + l0 * q.x + l1 * q.y + l2 * q.z
            + m0 * r.x + m1 * r.y + m2 * r.z;
        p = u1 - own1;
        q = u2 - own1;
        r = u3 - own1;
        sum.b += k0 * p.x + k1 * p.y + k2 * p.z + l0 * q.x + l1 * q.y + l2 * q.z
            + m0 * r.x + m1 * r.y + m2 * r.z;
        p = u2 - own2;
        q = u3 - own2;
        r = u4 - own2;
        sum.c += k0 * p.x + k1 * p.y + k2 * p.z + l0 * q.x + l1 * q.y + l2 * q.z
            + m0 * r.x + m1 * r.y + m2 * r.z;
        p = u3 - own3;
        q = u4 - own3;
        r = u5 - own3;
        sum.d += k0 * p.x + k1 * p.y + k2 * p.z + l0 * q.x + l1 * q.y + l2 * q.z
            + m0 * r.x + m1 * r.y + m2 * r.z;
    }
    return sum;
}

fn scaled(node: u32, r: vec3f) -> vec3f {
    return textureLoad(inverse, texel(3u * node), 0).xyz * r.x
        + textureLoad(inverse, texel(3u * node + 1u), 0).xyz * r.y
        + textureLoad(inverse, texel(3u * node + 2u), 0).xyz * r.z;
}

fn is_free(node: u32) -> vec3<bool> {
    return vec3f(textureLoad(inverse, texel(3u * node), 0).w,
        textureLoad(inverse, texel(3u * node + 1u), 0).w,
        textureLoad(inverse, texel(3u * node + 2u), 0).w) != vec3f(0.0);
}

// one step of one node, whose product is t
fn step(base: u32, node: u32, t: vec3f) {
    let at = texel(base + node);
    let r = textureLoad(r_in, at, 0).xyz - t;
    let d = params.keep * textureLoad(v_in, at, 0).xyz + params.gain * scaled(node, r);
    let x = textureLoad(x_in, at, 0).xyz + d;
    textureStore(r_out, at, vec4f(r, 0.0));
    textureStore(d_out, at, vec4f(d, 0.0));
    textureStore(x_out, at, vec4f(x, 0.0));
}

fn last_step(base: u32, node: u32, t: vec3f) {
    let at = texel(base + node);
    let r = textureLoad(r_in, at, 0).xyz - t;
    let d = params.keep * textureLoad(v_in, at, 0).xyz + params.gain * scaled(node, r);
    textureStore(x_out, at, vec4f(textureLoad(x_in, at, 0).xyz + d, 0.0));
}

fn leave(base: u32, node: u32, t: vec3f) {
    let at = texel(base + node);
    let r = textureLoad(r_in, at, 0).xyz - t;
    textureStore(r_out, at, vec4f(select(vec3f(0.0), r, is_free(node)), 0.0));
}

// from zero: d = gain D^-1 r
@compute @workgroup_size(64)
fn begin(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let at = texel(here.y + here.x);
    let d = params.gain * scaled(here.x, textureLoad(r_in, at, 0).xyz);
    textureStore(d_out, at, vec4f(d, 0.0));
}

// r_out, d and x_out
@compute @workgroup_size(64)
fn relax(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let node = params.first + here.x;
    let row = textureLoad(info, texel(here.x), 0);
    step(here.y, node, product(here.y, row, load_v(here.y + node)));
}

@compute @workgroup_size(64)
fn relax4(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let pack = textureLoad(info, texel(here.x), 0);
    let sum = packed(here.y, pack);
    step(here.y, pack.x, sum.a);
    if (pack.y > 1u) { step(here.y, pack.x + 1u, sum.b); }
    if (pack.y > 2u) { step(here.y, pack.x + 2u, sum.c); }
    if (pack.y > 3u) { step(here.y, pack.x + 3u, sum.d); }
}

// x_out alone
@compute @workgroup_size(64)
fn finish(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let node = params.first + here.x;
    let row = textureLoad(info, texel(here.x), 0);
    last_step(here.y, node, product(here.y, row, load_v(here.y + node)));
}

@compute @workgroup_size(64)
fn finish4(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let pack = textureLoad(info, texel(here.x), 0);
    let sum = packed(here.y, pack);
    last_step(here.y, pack.x, sum.a);
    if (pack.y > 1u) { last_step(here.y, pack.x + 1u, sum.b); }
    if (pack.y > 2u) { last_step(here.y, pack.x + 2u, sum.c); }
    if (pack.y > 3u) { last_step(here.y, pack.x + 3u, sum.d); }
}

// for the coarser level: r_out alone, zero on fixed unknowns
@compute @workgroup_size(64)
fn residual(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let node = params.first + here.x;
    let row = textureLoad(info, texel(here.x), 0);
    leave(here.y, node, product(here.y, row, load_v(here.y + node)));
}

@compute @workgroup_size(64)
fn residual4(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = place(gid, groups);
    if (here.z == 0u) { return; }
    let pack = textureLoad(info, texel(here.x), 0);
    let sum = packed(here.y, pack);
    leave(here.y, pack.x, sum.a);
    if (pack.y > 1u) { leave(here.y, pack.x + 1u, sum.b); }
    if (pack.y > 2u) { leave(here.y, pack.x + 2u, sum.c); }
    if (pack.y > 3u) { leave(here.y, pack.x + 3u, sum.d); }
}
