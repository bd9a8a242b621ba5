// Weighted sums along one axis of an image: a kernel sampled at a fraction of a pixel, taken at every
// `factor`-th sample. Called along rows, then along columns, once per separable term.
//
// An invocation makes four neighbouring outputs, so that each value loaded counts for four; the
// table holds the four weights that a value has in them (a load at an address that differs from lane
// to lane is what costs on software devices).
#import lib/numeric/texel

override vertical: u32;
override add: u32;  // 1: the sums are added to what is there

struct Params {
    count: u32,      // outputs along the axis
    lines: u32,      // lines across it
    factor: u32,
    taps: u32,       // entries of the table
    step_in: u32,    // from a value to the next along the axis, and from line to line
    line_in: u32,
    first_out: u32,
    step_out: u32,
    line_out: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var table: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;

fn put(place: u32, value: f32) {
    if (add == 1u) {
        sums[place] += value;
    } else {
        sums[place] = value;
    }
}

@compute @workgroup_size(64, 2)
fn main(@builtin(global_invocation_id) gid: vec3u) {
    let block = select(gid.x, gid.y, vertical == 1u);
    let line = select(gid.y, gid.x, vertical == 1u);
    let first = 4u * block;
    if (first >= params.count || line >= params.lines) { return; }
    let outputs = min(4u, params.count - first);
    let taps = params.taps - (4u - outputs) * params.factor;  // beyond them lies nothing to load
    var sum = vec4f(0.0);
    var at = line * params.line_in + first * params.factor * params.step_in;
    for (var t = 0u; t < taps; t++) {
        sum += textureLoad(table, texel(t), 0) * values[at];
        at += params.step_in;
    }
    let place = params.first_out + line * params.line_out + first * params.step_out;
    put(place, sum.x);
    if (outputs > 1u) { put(place + params.step_out, sum.y); }
    if (outputs > 2u) { put(place + 2u * params.step_out, sum.z); }
    if (outputs > 3u) { put(place + 3u * params.step_out, sum.w); }
}
