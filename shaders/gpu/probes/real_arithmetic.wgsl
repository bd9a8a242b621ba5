// Probe of the `real` arithmetic: six operations on two vectors.
#import lib/numeric/real
#import lib/numeric/index

struct Params {
    count: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> a: array<real>;
@group(0) @binding(2) var<storage, read> b: array<real>;
@group(0) @binding(3) var<storage, read_write> result: array<real>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    let n = params.count;
    if (i >= n) { return; }
    let x = a[i];
    let y = b[i];
    result[i] = r_add(x, y);
    result[n + i] = r_sub(x, y);
    result[2u * n + i] = r_mul(x, y);
    result[3u * n + i] = r_div(x, y);
    result[4u * n + i] = r_fma(x, y, x);
    if (r_lt(x, r_f32(0.0))) {
        result[5u * n + i] = r_sqrt(r_neg(x));
    } else {
        result[5u * n + i] = r_sqrt(x);
    }
}
