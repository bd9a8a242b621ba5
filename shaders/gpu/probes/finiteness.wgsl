// Probe of the finiteness tests: bit 0 of the flag for an f32, bit 1 for a `real`.
#import lib/numeric/real
#import lib/numeric/index

struct Params {
    count: u32,
    scale: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> single: array<f32>;
@group(0) @binding(2) var<storage, read> wide: array<real>;
@group(0) @binding(3) var<storage, read_write> flags: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.count) { return; }
    let x = single[i] * params.scale;
    let y = r_mul(wide[i], r_f32(params.scale));
    flags[i] = select(0u, 1u, is_finite_f32(x)) | select(0u, 2u, r_is_finite(wide[i]))
        | select(0u, 4u, r_is_finite(y));
}
