// Match one subset per workgroup: inverse-compositional Gauss-Newton with ZNSSD.
// Same steps as `correlate_numpy` in gpusim/measure/correlation/icgn.py; see the formulas there.
//
// float32 is enough because everything it touches is small: grey values have range 1, positions
// are offsets from whole pixels, and the sums are taken over f - scale (g - offset), not over g.
//
// What concerns the subset as a whole is computed by every thread alike, so that all of them
// take the same branches; only the normal equations are left to one thread.
#import lib/measure/spline
#import lib/measure/warp
#import lib/measure/normal_equations
#import lib/measure/moments

const FLOATS_IN = 14u;  // per subset: fraction of its point x, y; 12 start coefficients
const FLOATS_OUT = 16u; // per subset: 12 coefficients, zncc, iterations, status, sigma
const MIN_CONTRAST = 5e-4;
const MIN_WEIGHT = 0.3;
const SLACK = 0.1;
const FASTEST = 0.03;
const MOST_NOISE = 0.75;

// gpusim.measure.correlation.matching.Status
const OK = 0.0;
const OUTSIDE = 1.0;
const NO_TEXTURE = 2.0;
const NOT_CONVERGED = 3.0;
const NEVER = -2.0; // zncc before the first iteration

// at most 32; on a CPU adapter the vector width, so that no lane waits for another vector
override threads: u32;
// 0: every pixel of the subset has the same weight, `window` isn't read
override windowed: u32;

struct Params {
    count: u32,
    half: u32,
    max_iterations: u32,
    tolerance: f32,
    max_move: f32,
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

var<workgroup> partial: array<vec4f, 672>; // threads * MOMENTS at most
var<workgroup> solvable: u32;

// Sums over the threads of the first `count` vectors that each left in `partial`, into `total`;
// always in the same order. There are never more vectors than can be left, so that the first turn
// may run in every thread.
fn reduce(thread: u32, count: u32) {
    workgroupBarrier();
    var k = thread;
    loop {
        let first = min(k, count - 1u) * threads;
        var sum = partial[first];
        var t = 1u;
        loop {
            sum += partial[first + t];
            t++;
            if (t >= threads) { break; }
        }
        if (k < count) { total[k] = sum; }
        k += threads;
        if (k >= count) { break; }
    }
    workgroupBarrier();
}

// Where a thread is in its walk over the subset, row by row, without divisions.
struct Walk {
    index: u32,
    column: u32,
    row: u32,
}

fn walk_from(thread: u32, width: u32) -> Walk {
    return Walk(thread, thread % width, thread / width);
}

fn walk_on(at: Walk, width: u32, columns: u32, rows: u32) -> Walk {
    let column = at.column + columns;
    let over = column >= width;
    return Walk(
        at.index + threads,
        select(column, column - width, over),
        at.row + rows + select(0u, 1u, over),
    );
}

// Loops test at their end: software drivers pass over a body until no lane is left, so that a test
// at its beginning costs one pass more. The first turn runs in threads that have no pixel, too.
fn weight_of(pixel: vec2i, mask: f32) -> f32 {
    if (windowed == 0u) { return mask; }
    return textureLoad(window, pixel).x * mask;
}

// What is still to go after a step, if steps go on shrinking by the ratio of the last two.
fn remaining(size: f32, before: f32) -> f32 {
    let ratio = max(size / max(before, 1e-30), FASTEST);
    return select(size, size * ratio / (1.0 - ratio), before > 0.0 && ratio < 0.5);
}

struct Sums {
    head: vec4f, // w e, w e f, w e e, number of pixels beyond the box
    // w e (gx, gy) times 1 and a; b and a^2/2; ab and b^2/2
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

// Add a pixel whose deformed grey value, less the level and times the contrast, is `there`;
// `counted` is false for what a square of pixels has beyond the subset.
fn add_residual(
    own: ptr<function, Sums>, first: vec2i, pixel: vec2i, fraction: vec2f, half: f32, mean: f32,
    there: f32, inside: bool, counted: bool,
) {
    let r = textureLoad(reference, first + pixel);
    let w = select(0.0, weight_of(pixel, r.w), counted);
    let f = r.x - mean;
    let e = select(0.0, f - there, inside);
    let s = (vec2f(pixel) - half - fraction) / half;
    let we = w * e;
    let v = we * r.yz;
    (*own).head += vec4f(we, we * f, we * e, select(1.0, 0.0, inside || !counted));
    (*own).a += vec4f(v, s.x * v);
    (*own).b += vec4f(s.y * v, 0.5 * s.x * s.x * v);
    (*own).c += vec4f(s.x * s.y * v, 0.5 * s.y * s.y * v);
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

// The most that neighbouring pixels are apart along an axis after the warp, diagonal ones too.
fn spread(c: Warp, half: f32) -> f32 {
    // second derivatives act over the subset's half width and half a pixel
    let bend_x = abs(c.x.high.x) + 2.0 * abs(c.x.high.y) + abs(c.x.high.z);
    let bend_y = abs(c.y.high.x) + 2.0 * abs(c.y.high.y) + abs(c.y.high.z);
    return max(
        abs(1.0 + c.x.low.y / half) + abs(c.x.low.z / half) + 1.2 * bend_x / half,
        abs(1.0 + c.y.low.z / half) + abs(c.y.low.y / half) + 1.2 * bend_y / half,
    );
}

fn write(id: u32, c: Warp, zncc: f32, iterations: u32, status: f32, sigma: f32) {
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
// offset (lift) and of gain (along) explains.
fn set_right_side(lift: f32, gain: f32) {
    if (shape == 0u) {
        step[0] = total[1].x;
        step[1] = total[1].y;
    } else if (shape == 1u) {
        step[0] = total[1].x;
        step[1] = total[1].y;
        step[2] = total[1].w - total[2].x;
    } else {
        let terms = unknowns / 2u;
        step[0] = total[1].x;
        step[1] = total[1].z;
        step[2] = total[2].x;
        step[terms] = total[1].y;
        step[terms + 1u] = total[1].w;
        step[terms + 2u] = total[2].y;
        if (shape == 3u) {
            step[3] = total[2].z;
            step[4] = total[3].x;
            step[5] = total[3].z;
            step[9] = total[2].w;
            step[10] = total[3].y;
            step[11] = total[3].w;
        }
    }
    for (var k = 0u; k < unknowns; k++) {
        step[k] = lift * descent_sum[k] + gain * descent_dot[k] - step[k];
    }
}

@compute @workgroup_size(threads)
fn main(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let id = group.y * groups.x + group.x;
    if (id >= params.count) { return; }
    let place = places[id];
    let half = f32(params.half);
    let width = 2u * params.half + 1u;
    let pixels = width * width;
    let fraction = vec2f(starts[id * FLOATS_IN], starts[id * FLOATS_IN + 1u]);
    let columns = threads % width;
    let rows = threads / width;
    let across = params.half + 1u; // squares of 2x2 pixels
    let block_columns = threads % across;
    let block_rows = threads / across;
    let first = place.xy - vec2i(i32(params.half));
    let lowest = vec2f(params.box.xy - place.zw) - SLACK;
    let highest = vec2f(params.box.zw - place.zw) + SLACK;
    let begin = start_of(id);
    var c = begin;

    // reference: weight, mean
    var own = vec4f(0.0);
    var at = walk_from(thread, width);
    loop {
        let pixel = vec2i(i32(at.column), i32(at.row));
        let r = textureLoad(reference, first + pixel);
        let w = select(0.0, weight_of(pixel, r.w), at.index < pixels);
        own += vec4f(w, w * r.x, 0.0, 0.0);
        at = walk_on(at, width, columns, rows);
        if (at.index >= pixels) { break; }
    }
    partial[thread] = own;
    reduce(thread, 1u);
    let of_reference = workgroupUniformLoad(&total[0]);
    let weight = of_reference.x;
    let mean = of_reference.y / max(weight, 1e-30);
    let enough = weight >= MIN_WEIGHT * params.window_sum && weight > f32(unknowns) + 2.0;

    // reference: normal matrix
    var moments = array<vec4f, MOMENTS>();
    at = walk_from(thread, width);
    loop {
        let pixel = vec2i(i32(at.column), i32(at.row));
        let r = textureLoad(reference, first + pixel);
        let w = select(0.0, weight_of(pixel, r.w), at.index < pixels);
        add_pixel(&moments, w, r.x - mean, r.yz, (vec2f(pixel) - half - fraction) / half);
        at = walk_on(at, width, columns, rows);
        if (at.index >= pixels) { break; }
    }
    let vectors = select(select(2u, 9u, shape > 0u), MOMENTS, shape > 2u);
    for (var k = 0u; k < vectors; k++) {
        partial[k * threads + thread] = moments[k];
    }
    reduce(thread, vectors);
    let energy = workgroupUniformLoad(&total[0]).w;
    if (thread == 0u) {
        solvable = 0u;
        if (enough && energy > MIN_CONTRAST * MIN_CONTRAST * weight) {
            set_sums();
            set_matrix();
            project_matrix(weight, energy);
            solvable = select(0u, 1u, factorize());
        }
    }
    let possible = workgroupUniformLoad(&solvable) == 1u;

    var status = select(select(OUTSIDE, NO_TEXTURE, enough), NOT_CONVERGED, possible);
    var zncc = NEVER;
    var sigma = 0.0;
    var level = mean;
    var contrast = 1.0;
    var iteration = 0u;
    var before = 0.0;
    while (possible && iteration < params.max_iterations) {
        iteration++;
        // given explicitly: naga doesn't reset a variable of a loop body by itself
        var own = Sums(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
        let close = spread(c, half) < 1.99;
        let squares = select(0u, across * across, close);
        var at = walk_from(thread, across);
        loop {
            let has = at.index < squares;
            let pixel = 2 * vec2i(i32(at.column), i32(at.row));
            let x = vec4f(vec2f(pixel).xx + vec2f(0.0, 1.0), vec2f(pixel).xx + vec2f(0.0, 1.0)) - half;
            let y = vec4f(vec2f(pixel).yy, vec2f(pixel).yy + 1.0) - half;
            let d0 = displacement(c, (vec2f(x.x, y.x) - fraction) / half);
            let d1 = displacement(c, (vec2f(x.y, y.y) - fraction) / half);
            let d2 = displacement(c, (vec2f(x.z, y.z) - fraction) / half);
            let d3 = displacement(c, (vec2f(x.w, y.w) - fraction) / half);
            let x_there = x + vec4f(d0.x, d1.x, d2.x, d3.x);
            let y_there = y + vec4f(d0.y, d1.y, d2.y, d3.y);
            let g = spline_values(deformed, place.zw, x_there, y_there);
            let in_x = (x_there >= lowest.xxxx) & (x_there <= highest.xxxx);
            let inside = in_x & (y_there >= lowest.yyyy) & (y_there <= highest.yyyy);
            let e = contrast * (g - level);
            let more = (pixel + 1 < vec2i(i32(width))) & vec2(has);
            add_residual(&own, first, pixel, fraction, half, mean, e.x, inside.x, has);
            add_residual(&own, first, pixel + vec2i(1, 0), fraction, half, mean, e.y, inside.y, more.x);
            add_residual(&own, first, pixel + vec2i(0, 1), fraction, half, mean, e.z, inside.z, more.y);
            add_residual(&own, first, pixel + 1, fraction, half, mean, e.w, inside.w, all(more));
            at = walk_on(at, across, block_columns, block_rows);
            if (at.index >= squares) { break; }
        }
        // stretched so much that neighbours are further apart than two pixels
        let single = select(pixels, 0u, close);
        at = walk_from(thread, width);
        loop {
            let has = at.index < single;
            let pixel = vec2i(i32(at.column), i32(at.row));
            let offset = vec2f(pixel) - half;
            let x = offset + displacement(c, (offset - fraction) / half);
            let low = floor(x);
            let inside = all(x >= lowest) && all(x <= highest);
            let g = spline_value(deformed, place.zw + vec2i(low), x - low);
            add_residual(&own, first, pixel, fraction, half, mean, contrast * (g - level), inside, has);
            at = walk_on(at, width, columns, rows);
            if (at.index >= single) { break; }
        }
        partial[thread] = own.head;
        partial[threads + thread] = own.a;
        if (shape > 0u) { partial[2u * threads + thread] = own.b; }
        if (shape > 2u) { partial[3u * threads + thread] = own.c; }
        reduce(thread, select(select(2u, 3u, shape > 0u), 4u, shape > 2u));
        let head = workgroupUniformLoad(&total[0]);
        let lift = head.x / weight;
        let along = head.y;
        let rest = head.z - head.x * lift;
        let seen = energy - 2.0 * along + rest; // energy of contrast * g
        if (head.w > 0.0) {
            status = params.beyond;
            break;
        }
        if (!(seen > 1e-10 * energy)) { break; }
        zncc = (energy - along) / sqrt(energy * seen);
        level -= lift / contrast;
        contrast *= sqrt(energy / seen);
        if (thread == 0u) {
            set_right_side(lift, along / energy);
            solve();
        }
        let d = warp_of(workgroupUniformLoad(&step));
        c = compose_inverse(c, d, half);
        let moved = max(abs(c.x.low.x - begin.x.low.x), abs(c.y.low.x - begin.y.low.x));
        if (!(moved <= params.max_move)) { break; }
        let size = largest_move(d);
        let rest_of_way = remaining(size, before);
        before = size;
        if (rest_of_way <= params.tolerance) {
            status = OK;
            if (thread == 0u) {
                let left = max((energy * rest - along * along) / seen, 0.0)
                    / (weight - f32(unknowns) - 2.0);
                let second = select(unknowns / 2u, 1u, shape < 2u);
                let noise = params.slope_noise * (1.0 - zncc) * energy;
                let spread = widened(0u, noise);
                sigma = sqrt(left * max(spread, widened(second, noise)));
            }
            break;
        }
    }
    if (thread == 0u) { write(id, c, zncc, iteration, status, sigma); }
}
