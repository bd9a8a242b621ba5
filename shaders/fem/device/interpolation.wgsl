// Interpolation between the nodes of two levels and its transpose, the same weights for x, y and z,
// float32 (gpusim/fem/device/interpolation.py has twin and driver). One thread per row and load case.
#import lib/numeric/index
#import lib/numeric/texel

struct Params {
    rows: u32,     // nodes of the level written to
    columns: u32,  // nodes of the level read from
    cases: u32,
}

const BLOCK: u32 = 64u;

@group(0) @binding(0) var info: texture_2d<u32>;    // per row: first pair, pairs of weights, free
// (node, bits of its weight), two of them
@group(0) @binding(1) var weight: texture_storage_2d<rgba32uint, read>;
@group(0) @binding(2) var v_in: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var x_in: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var x_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: Params;

fn total(row: vec4u, base: u32) -> vec3f {
    var sum = vec3f(0.0);
    for (var k = row.x; k < row.x + row.y; k++) {
        let two = textureLoad(weight, texel(k));
        sum += bitcast<f32>(two.y) * textureLoad(v_in, texel(base + two.x)).xyz;
        sum += bitcast<f32>(two.w) * textureLoad(v_in, texel(base + two.z)).xyz;
    }
    let free = (vec3u(row.z) >> vec3u(0u, 1u, 2u)) & vec3u(1u);
    return select(vec3f(0.0), sum, free == vec3u(1u));
}

@compute @workgroup_size(64)
fn apply(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = row_and_case(linear_id(gid, groups, BLOCK), params.cases, BLOCK);
    if (here.x >= params.rows) { return; }
    let own = here.y * (params.rows + 1u) + here.x;
    let row = textureLoad(info, texel(here.x), 0);
    textureStore(x_out, texel(own), vec4f(total(row, here.y * (params.columns + 1u)), 0.0));
}

// x_out = x_in + what is interpolated
@compute @workgroup_size(64)
fn add(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let here = row_and_case(linear_id(gid, groups, BLOCK), params.cases, BLOCK);
    if (here.x >= params.rows) { return; }
    let own = here.y * (params.rows + 1u) + here.x;
    let row = textureLoad(info, texel(here.x), 0);
    let x = textureLoad(x_in, texel(own)).xyz + total(row, here.y * (params.columns + 1u));
    textureStore(x_out, texel(own), vec4f(x, 0.0));
}
