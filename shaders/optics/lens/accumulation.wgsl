// Weighted sums of images, and gains per pixel: out += weight * image, over rows of a larger image.
// The NumPy form is gpusim/optics/lens/convolution.py.
override scale_only: u32;  // 1: what is there is multiplied by the gain map instead

struct Params {
    columns: u32,
    rows: u32,
    stride: u32,      // of the image that is read, or of the map
    first_out: u32,
    stride_out: u32,
    weight: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64, 2)
fn main(@builtin(global_invocation_id) gid: vec3u) {
    if (gid.x >= params.columns || gid.y >= params.rows) { return; }
    let place = params.first_out + gid.y * params.stride_out + gid.x;
    let value = params.weight * values[gid.y * params.stride + gid.x];
    if (scale_only == 1u) {
        sums[place] *= value;
    } else {
        sums[place] += value;
    }
}
