// Match one subset per thread: inverse-compositional Gauss-Newton with ZNSSD.
// Same steps as `correlate_numpy` in gpusim/measure/correlation/icgn.py; see the formulas there.
//
// float32 is enough because everything it touches is small: grey values have range 1, positions
// are offsets from whole pixels, and the sums are taken over f - scale (g - offset), not over g, and
// line by line.
//
// Threads never wait for each other, and what a subset does once (normal equations, steps) costs a
// vector of eight subsets as much as one: with the threads of a workgroup in one subset it took
// more than half of the time of a small one on a CPU. But llvmpipe ends all loops of a thread after
// 65,535 turns in all, as if they were done: three pixels share a turn, and who isn't through before
// that is matched by the host (`affordable`).
#import lib/measure/spline
#import lib/measure/warp
#import lib/measure/normal_equations
#import lib/measure/moments

const FLOATS_IN = 14u;  // per subset: fraction of its point x, y; 12 start coefficients
const FLOATS_OUT = 17u; // per subset: 12 coefficients, zncc, iterations, status, sigma, residual
const MIN_CONTRAST = 5e-4;
const MIN_WEIGHT = 0.3;
const SLACK = 0.1;
const FASTEST = 0.03;
const MOST_NOISE = 0.75;
const MOST_STRETCH = 0.2; // see nine_values

// gpusim.measure.correlation.matching.Status
const OK = 0.0;
const OUTSIDE = 1.0;
const NO_TEXTURE = 2.0;
const NOT_CONVERGED = 3.0;
const PATIENCE = 20u;
const NEVER = -2.0; // zncc before the first iteration
const UNFINISHED = 100.0; // status in the output: the host goes on

// of a workgroup; on a CPU adapter the vector width
override threads: u32;
// 0: every pixel of the subset has the same weight, `window` isn't read
override windowed: u32;

struct Params {
    count: u32,
    half: u32,
    max_iterations: u32,
    affordable: u32, // iterations for which the driver's limit of turns of loops is sure to last
    tolerance: f32,
    max_move: f32,
    least_zncc: f32, // below, nothing has been found after PATIENCE iterations
    slope_noise: f32, // see Settings
    window_sum: f32,
    beyond: f32, // status of a subset that leaves the box
    // closed box of pixels of the deformed texture (lowest x, y, highest x, y) for samples
    box: vec4i,
}

@group(0) @binding(0) var<uniform> params: Params;
// f, df/dx, df/dy, mask
@group(0) @binding(1) var reference: texture_storage_2d<rgba32float, read>;
// B-spline coefficients, see spline_value
@group(0) @binding(2) var deformed: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var window: texture_storage_2d<r32float, read>;
// centre pixel in the reference texture; the pixel of the deformed texture it starts from
@group(0) @binding(4) var<storage, read> places: array<vec4i>;
@group(0) @binding(5) var<storage, read> starts: array<f32>;
@group(0) @binding(6) var<storage, read_write> result: array<f32>;

// Loops test at their end: software drivers pass over a body until no lane is left, so that a test
// at its beginning costs one pass more. The first turn runs in threads that have no pixel, too.
fn weight_of(pixel: vec2i, mask: f32) -> f32 {
    if (windowed == 0u) { return mask; }
    return textureLoad(window, pixel).x * mask;
}

// A pixel of the reference with its weight as the last component; none beyond the subset's width.
fn weighted(first: vec2i, pixel: vec2i, width: i32) -> vec4f {
    let r = textureLoad(reference, first + pixel);
    return vec4f(r.xyz, select(0.0, weight_of(pixel, r.w), pixel.x < width));
}

// What is still to go after a step, if steps go on shrinking by the ratio of the last two.
fn remaining(size: f32, before: f32) -> f32 {
    let ratio = max(size / max(before, 1e-30), FASTEST);
    return select(size, size * ratio / (1.0 - ratio), before > 0.0 && ratio < 0.5);
}

// Sums over a line of pixels or over the subset.
struct Sums {
    head: vec4f, // w e, w e f, w e e, number of pixels beyond the box
    // w e (gx, gy) times 1 and a; b and a^2/2; ab and b^2/2 (the last three stay 0 in a line)
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

// Add a pixel of a line; its deformed grey value, less the level and times the contrast, is `there`.
fn add_residual(
    line: ptr<function, Sums>, at: vec2i, pixel: vec2i, a: f32, mean: f32, there: f32,
    inside: bool, counted: bool,
) {
    let r = textureLoad(reference, at);
    let w = select(0.0, weight_of(pixel, r.w), counted);
    let f = r.x - mean;
    let e = select(0.0, f - there, inside);
    let we = w * e;
    let v = we * r.yz;
    (*line).head += vec4f(we, we * f, we * e, select(1.0, 0.0, inside || !counted));
    (*line).a += vec4f(v, a * v);
    if (shape == 3u) { (*line).b += vec4f(vec2f(0.0), 0.5 * a * a * v); }
}

// The same for three neighbours.
fn add_three(
    line: ptr<function, Sums>, first: vec2i, pixel: vec2i, a: vec3f, mean: f32, there: vec3f,
    inside: vec3<bool>, counted: vec3<bool>,
) {
    let at = first + pixel;
    let one = vec2i(1, 0);
    add_residual(line, at, pixel, a.x, mean, there.x, inside.x, counted.x);
    add_residual(line, at + one, pixel + one, a.y, mean, there.y, inside.y, counted.y);
    add_residual(line, at + 2 * one, pixel + 2 * one, a.z, mean, there.z, inside.z, counted.z);
}

// Whether positions lie in a closed box.
fn inside(x: vec3f, y: vec3f, lowest: vec2f, highest: vec2f) -> vec3<bool> {
    let in_x = (x >= lowest.xxx) & (x <= highest.xxx);
    return in_x & (y >= lowest.yyy) & (y <= highest.yyy);
}

// Displacements of three pixels of the line at b.
struct Moves {
    x: vec3f,
    y: vec3f,
}

fn three_displacements(c: Warp, a: vec3f, b: f32) -> Moves {
    let p = displacement(c, vec2f(a.x, b));
    let q = displacement(c, vec2f(a.y, b));
    let r = displacement(c, vec2f(a.z, b));
    return Moves(vec3f(p.x, q.x, r.x), vec3f(p.y, q.y, r.y));
}

// The deformed grey value at a place that is counted from the pixel `origin`.
fn deformed_value(origin: vec2i, there: vec2f) -> f32 {
    let low = floor(there);
    return spline_value(deformed, origin + vec2i(low), there - low);
}

// Add the sums of the line at b to those of the subset.
fn add_line(own: ptr<function, Sums>, line: Sums, b: f32) {
    (*own).head += line.head;
    (*own).a += line.a;
    (*own).b += vec4f(b * line.a.xy, line.b.zw);
    if (shape == 3u) { (*own).c += vec4f(b * line.a.zw, 0.5 * b * b * line.a.xy); }
}

// Variance of a displacement; `noise` is what noise adds to the squared slopes it is told from.
fn widened(index: u32, noise: f32) -> f32 {
    var slopes = 0.0;
    for (var k = 0u; k <= index; k++) {
        let entry = factor[index * 12u + k];
        slopes += entry * entry;
    }
    let rest = 1.0 - clamp(noise / slopes, 0.0, MOST_NOISE);
    return variance(index) / (rest * rest);
}

// How much neighbouring pixels, diagonal ones too, are closer or further apart along an axis after
// the warp, px.
fn stretch(c: Warp, half: f32) -> f32 {
    // second derivatives act over the subset's half width and half a pixel
    let bend_x = abs(c.x.high.x) + 2.0 * abs(c.x.high.y) + abs(c.x.high.z);
    let bend_y = abs(c.y.high.x) + 2.0 * abs(c.y.high.y) + abs(c.y.high.z);
    return max(
        abs(c.x.low.y) + abs(c.x.low.z) + 1.2 * bend_x,
        abs(c.y.low.y) + abs(c.y.low.z) + 1.2 * bend_y,
    ) / half;
}

fn write(
    id: u32, c: Warp, zncc: f32, iterations: u32, status: f32, sigma: f32, residual: f32,
) {
    let at = id * FLOATS_OUT;
    result[at] = c.x.low.x;
    result[at + 1u] = c.x.low.y;
    result[at + 2u] = c.x.low.z;
    result[at + 3u] = c.x.high.x;
    result[at + 4u] = c.x.high.y;
    result[at + 5u] = c.x.high.z;
    result[at + 6u] = c.y.low.x;
    result[at + 7u] = c.y.low.y;
    result[at + 8u] = c.y.low.z;
    result[at + 9u] = c.y.high.x;
    result[at + 10u] = c.y.high.y;
    result[at + 11u] = c.y.high.z;
    result[at + 12u] = zncc;
    result[at + 13u] = f32(iterations);
    result[at + 14u] = status;
    result[at + 15u] = sigma;
    result[at + 16u] = residual;
}

fn start_of(id: u32) -> Warp {
    let at = id * FLOATS_IN + 2u;
    return Warp(
        Component(
            vec3f(starts[at], starts[at + 1u], starts[at + 2u]),
            vec3f(starts[at + 3u], starts[at + 4u], starts[at + 5u]),
        ),
        Component(
            vec3f(starts[at + 6u], starts[at + 7u], starts[at + 8u]),
            vec3f(starts[at + 9u], starts[at + 10u], starts[at + 11u]),
        ),
    );
}

// Right side of the normal equations, left in `step`: the sums by unknown, less what a change of
// offset (lift) and of gain explains.
fn set_right_side(sums: Sums, lift: f32, gain: f32) {
    step[0] = sums.a.x;
    if (shape == 0u) {
        step[1] = sums.a.y;
    } else if (shape == 1u) {
        step[1] = sums.a.y;
        step[2] = sums.a.w - sums.b.x;
    } else {
        let terms = unknowns / 2u;
        step[1] = sums.a.z;
        step[2] = sums.b.x;
        step[terms] = sums.a.y;
        step[terms + 1u] = sums.a.w;
        step[terms + 2u] = sums.b.y;
        if (shape == 3u) {
            step[3] = sums.b.z;
            step[4] = sums.c.x;
            step[5] = sums.c.z;
            step[9] = sums.b.w;
            step[10] = sums.c.y;
            step[11] = sums.c.w;
        }
    }
    for (var k = 0u; k < unknowns; k++) {
        step[k] = lift * descent_sum[k] + gain * descent_dot[k] - step[k];
    }
}

@compute @workgroup_size(threads)
fn main(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = thread.y * groups.x * threads + thread.x;
    if (id >= params.count) { return; }
    let place = places[id];
    let half = f32(params.half);
    let width = 2 * i32(params.half) + 1;
    let fraction = vec2f(starts[id * FLOATS_IN], starts[id * FLOATS_IN + 1u]);
    let first = place.xy - vec2i(i32(params.half));
    let lowest = vec2f(params.box.xy - place.zw) - SLACK;
    let highest = vec2f(params.box.zw - place.zw) + SLACK;
    let begin = start_of(id);
    var c = begin;

    // reference: weight, mean
    var weight = 0.0;
    var sum = 0.0;
    var y = 0;
    loop {
        var line = vec2f(0.0);
        var x = 0;
        loop {
            let p = weighted(first, vec2i(x, y), width);
            let q = weighted(first, vec2i(x + 1, y), width);
            let r = weighted(first, vec2i(x + 2, y), width);
            line += vec2f(p.w, p.w * p.x);
            line += vec2f(q.w, q.w * q.x);
            line += vec2f(r.w, r.w * r.x);
            x += 3;
            if (x >= width) { break; }
        }
        weight += line.x;
        sum += line.y;
        y++;
        if (y >= width) { break; }
    }
    let mean = sum / max(weight, 1e-30);
    let enough = weight >= MIN_WEIGHT * params.window_sum && weight > f32(unknowns) + 2.0;

    // reference: normal matrix
    total = array<vec4f, MOMENTS>();
    y = 0;
    loop {
        var line = Line();
        var x = 0;
        loop {
            let p = weighted(first, vec2i(x, y), width);
            let q = weighted(first, vec2i(x + 1, y), width);
            let r = weighted(first, vec2i(x + 2, y), width);
            let a = (vec3f(f32(x)) + vec3f(0.0, 1.0, 2.0) - half - fraction.x) / half;
            add_pixel(&line, p.w, p.x - mean, p.yz, a.x);
            add_pixel(&line, q.w, q.x - mean, q.yz, a.y);
            add_pixel(&line, r.w, r.x - mean, r.yz, a.z);
            x += 3;
            if (x >= width) { break; }
        }
        add_line_moments(line, (f32(y) - half - fraction.y) / half);
        y++;
        if (y >= width) { break; }
    }
    let energy = total[0].w;
    var possible = enough && energy > MIN_CONTRAST * MIN_CONTRAST * weight;
    if (possible) {
        set_sums();
        set_matrix();
        project_matrix(weight, energy);
        possible = factorize();
    }

    var status = select(select(OUTSIDE, NO_TEXTURE, enough), NOT_CONVERGED, possible);
    var zncc = NEVER;
    var sigma = 0.0;
    var residual = 0.0;
    var level = mean;
    var contrast = 1.0;
    var iteration = 0u;
    var before = 0.0;
    while (possible && iteration < params.max_iterations) {
        if (iteration >= params.affordable) {
            status = UNFINISHED;
            break;
        }
        iteration++;
        // given explicitly: naga doesn't reset a variable of a loop body by itself
        var own = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
        let close = stretch(c, half) < MOST_STRETCH;
        let together = select(0, width, close);
        y = 0;
        loop {
            var upper = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
            var middle = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
            var lower = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
            let lines = vec3f(f32(y)) + vec3f(0.0, 1.0, 2.0) - half;
            let b = (lines - fraction.y) / half;
            var x = 0;
            loop {
                let columns = vec3f(f32(x)) + vec3f(0.0, 1.0, 2.0) - half;
                let a = (columns - fraction.x) / half;
                let u = three_displacements(c, a, b.x);
                let v = three_displacements(c, a, b.y);
                let w = three_displacements(c, a, b.z);
                let x_there = mat3x3f(columns + u.x, columns + v.x, columns + w.x);
                let y_there = mat3x3f(lines.x + u.y, lines.y + v.y, lines.z + w.y);
                let g = nine_values(deformed, place.zw, x_there, y_there);
                let in_line = vec3i(x, x + 1, x + 2) < vec3i(together);
                let at = vec2i(x, y);
                add_three(&upper, first, at, a, mean, contrast * (g[0] - level),
                    inside(x_there[0], y_there[0], lowest, highest), in_line);
                add_three(&middle, first, at + vec2i(0, 1), a, mean, contrast * (g[1] - level),
                    inside(x_there[1], y_there[1], lowest, highest), in_line & vec3(y + 1 < width));
                add_three(&lower, first, at + vec2i(0, 2), a, mean, contrast * (g[2] - level),
                    inside(x_there[2], y_there[2], lowest, highest), in_line & vec3(y + 2 < width));
                x += 3;
                if (x >= together) { break; }
            }
            add_line(&own, upper, b.x);
            add_line(&own, middle, b.y);
            add_line(&own, lower, b.z);
            y += 3;
            if (y >= together) { break; }
        }
        // one by one
        let single = select(width, 0, close);
        y = 0;
        loop {
            var line = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
            let b = (f32(y) - half - fraction.y) / half;
            var x = 0;
            loop {
                let columns = vec3f(f32(x)) + vec3f(0.0, 1.0, 2.0) - half;
                let a = (columns - fraction.x) / half;
                let u = three_displacements(c, a, b);
                let x_there = columns + u.x;
                let y_there = f32(y) - half + u.y;
                let g = vec3f(
                    deformed_value(place.zw, vec2f(x_there.x, y_there.x)),
                    deformed_value(place.zw, vec2f(x_there.y, y_there.y)),
                    deformed_value(place.zw, vec2f(x_there.z, y_there.z)),
                );
                add_three(&line, first, vec2i(x, y), a, mean, contrast * (g - level),
                    inside(x_there, y_there, lowest, highest),
                    vec3i(x, x + 1, x + 2) < vec3i(single));
                x += 3;
                if (x >= single) { break; }
            }
            add_line(&own, line, b);
            y++;
            if (y >= single) { break; }
        }
        let lift = own.head.x / weight;
        let along = own.head.y;
        let rest = own.head.z - own.head.x * lift;
        let seen = energy - 2.0 * along + rest; // energy of contrast * g
        if (own.head.w > 0.0) {
            status = params.beyond;
            break;
        }
        if (!(seen > 1e-10 * energy)) { break; }
        zncc = (energy - along) / sqrt(energy * seen);
        if (iteration >= PATIENCE && zncc < params.least_zncc) { break; }
        level -= lift / contrast;
        contrast *= sqrt(energy / seen);
        set_right_side(own, lift, along / energy);
        solve();
        let d = warp_of(step);
        c = compose_inverse(c, d, half);
        let moved = max(abs(c.x.low.x - begin.x.low.x), abs(c.y.low.x - begin.y.low.x));
        if (!(moved <= params.max_move)) { break; }
        let size = largest_move(d);
        let rest_of_way = remaining(size, before);
        before = size;
        if (rest_of_way <= params.tolerance) {
            status = OK;
            residual = max((energy * rest - along * along) / seen, 0.0)
                / (weight - f32(unknowns) - 2.0);
            let second = select(unknowns / 2u, 1u, shape < 2u);
            let noise = params.slope_noise * (1.0 - zncc) * energy;
            let spread = widened(0u, noise);
            sigma = sqrt(residual * max(spread, widened(second, noise)));
            break;
        }
    }
    write(id, c, zncc, iteration, status, sigma, residual);
}
