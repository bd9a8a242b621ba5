// Single values into an image: out[places[i]] = values[i].
// The NumPy form is gpusim/optics/frame.py.
struct Params {
    count: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// (place, bits of the value)
@group(0) @binding(1) var<storage, read> entries: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> radiance: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = gid.y * (groups.x * 64u) + gid.x;
    if (i >= params.count) { return; }
    radiance[entries[i].x] = bitcast<f32>(entries[i].y);
}
