// What single receivers see of the lamps that their tile sees in part. The NumPy form is
// `ShadowTiles.shares`; gpusim/optics/shares.py drives it.
#import common/occlusion

struct Params {
    count: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// per receiver its place relative to the eye (w: number of its tile among those in half shadow),
// its unit normal, and how the place changes over the pixel, twice; w of these is nothing
@group(0) @binding(1) var<storage, read> receivers: array<vec4f>;
// per receiver and lamp: the share, where the tile sees the lamp in part
@group(0) @binding(2) var<storage, read_write> shares: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = gid.y * (groups.x * 64u) + gid.x;
    if (i >= params.count) { return; }
    let place = receivers[4u * i];
    let n = receivers[4u * i + 1u].xyz;
    let dx = receivers[4u * i + 2u].xyz;
    let dy = receivers[4u * i + 3u].xyz;
    let first = bitcast<u32>(place.w) * shades.count;
    // tests come last, as in `lamp_share`
    var k = 0u;
    loop {
        let list = textureLoad(shadow_lists, texel(first + k), 0);
        shares[i * shades.count + list.z] = lamp_share(list, place.xyz, n, dx, dy);
        k++;
        if (k >= (list.w & 255u)) { break; }
    }
}
