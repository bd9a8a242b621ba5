// Digital numbers from linear radiance: scaled, rounded to nearest and packed, 4 or 2 a word. Rows
// begin with a word. The NumPy form is gpusim/optics/sensor/digital_numbers.py.
override bits: u32;

struct Params {
    width: u32,
    rows: u32,
    stride: u32,
    first_word: u32,
    scale: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> radiance: array<f32>;
@group(0) @binding(2) var<storage, read_write> words: array<u32>;

// Round half to even, as NumPy does; NaN and infinities become full scale by their bits, so that
// they can't pass for a dark pixel.
fn digital(first: u32, column: u32, full: f32) -> u32 {
    let value = radiance[first + min(column, params.width - 1u)];
    let number = u32(clamp(round(value * params.scale), 0.0, full));
    let finite = (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
    return select(u32(full), number, finite);
}

@compute @workgroup_size(64, 4)
fn main(@builtin(global_invocation_id) gid: vec3u) {
    let per_word = select(2u, 4u, bits <= 8u);
    let columns = (params.width + per_word - 1u) / per_word;
    if (gid.x >= columns || gid.y >= params.rows) { return; }
    let first = gid.y * params.stride;
    let place = params.first_word + gid.y * columns + gid.x;
    let full = f32((1u << bits) - 1u);
    let column = per_word * gid.x;
    if (bits <= 8u) {
        words[place] = digital(first, column, full) | (digital(first, column + 1u, full) << 8u)
            | (digital(first, column + 2u, full) << 16u)
            | (digital(first, column + 3u, full) << 24u);
    } else {
        words[place] = digital(first, column, full) | (digital(first, column + 1u, full) << 16u);
    }
}
