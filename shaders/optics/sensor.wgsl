// Digital numbers from linear radiance: scaled, rounded to nearest and packed, 4 or 2 a word.
override bits: u32;

struct Params {
    count: u32,
    width: u32,
    stride: u32,
    scale: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> radiance: array<f32>;
@group(0) @binding(2) var<storage, read_write> words: array<u32>;

// Round half to even, as NumPy does; NaN and infinities become full scale by their bits, so that
// they can't pass for a dark pixel.
fn digital(i: u32, full: f32) -> u32 {
    if (i >= params.count) { return 0u; }
    let value = radiance[(i / params.width) * params.stride + i % params.width];
    if ((bitcast<u32>(value) & 0x7f800000u) == 0x7f800000u) { return u32(full); }
    return u32(clamp(round(value * params.scale), 0.0, full));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let word = gid.y * (groups.x * 64u) + gid.x;
    if (bits <= 8u) {
        if (4u * word >= params.count) { return; }
        let full = f32((1u << bits) - 1u);
        words[word] = digital(4u * word, full) | (digital(4u * word + 1u, full) << 8u)
            | (digital(4u * word + 2u, full) << 16u) | (digital(4u * word + 3u, full) << 24u);
    } else {
        if (2u * word >= params.count) { return; }
        let full = f32((1u << bits) - 1u);
        words[word] = digital(2u * word, full) | (digital(2u * word + 1u, full) << 16u);
    }
}
