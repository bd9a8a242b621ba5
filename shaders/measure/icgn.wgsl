// Match one subset per workgroup: inverse-compositional Gauss-Newton with ZNSSD.
// Same steps as correlate_numpy in gpusim/measure/icgn.py; see the formulas there.
//
// float32 is enough because everything it touches is small: grey values have range 1, positions
// are offsets from whole pixels, and the sums are taken over f - scale (g - offset), not over g.

#import common/spline
#import common/warp
#import common/normal

const THREADS = 64u;
const VECTORS = 4u;     // of four sums each, that one reduction carries
const FLOATS_IN = 14u;  // per subset: fraction of its point x, y; 12 start coefficients
const FLOATS_OUT = 16u; // per subset: 12 coefficients, zncc, iterations, status, sigma
const MIN_CONTRAST = 5e-4;
const MIN_WEIGHT = 0.3;

// gpusim.measure.icgn.Status
const OK = 0.0;
const OUTSIDE = 1.0;
const NO_TEXTURE = 2.0;
const NOT_CONVERGED = 3.0;

struct Params {
    count: u32,
    half: u32,
    reference_width: u32,
    deformed_width: u32,
    // whole-pixel box of the deformed crop, in its padded coordinates, in which samples may lie
    x0: i32,
    y0: i32,
    x1: i32,
    y1: i32,
    max_iterations: u32,
    tolerance: f32,
    max_move: f32,
    window_sum: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
// f, df/dx, df/dy, mask
@group(0) @binding(1) var<storage, read> reference: array<vec4f>;
// B-spline coefficients
@group(0) @binding(2) var<storage, read> deformed: array<f32>;
@group(0) @binding(3) var<storage, read> window: array<f32>;
// centre pixel in the reference crop; the pixel of the padded deformed crop it starts from
@group(0) @binding(4) var<storage, read> places: array<vec4i>;
@group(0) @binding(5) var<storage, read> starts: array<f32>;
@group(0) @binding(6) var<storage, read_write> result: array<f32>;

var<workgroup> partial: array<vec4f, 256>; // THREADS * VECTORS
var<workgroup> total: array<f32, 16>;
var<workgroup> descent_sum: array<f32, 12>;
var<workgroup> descent_dot: array<f32, 12>;
var<workgroup> running: u32;
var<workgroup> level: f32;
var<workgroup> contrast: f32;

fn line(at: u32, w: Taps) -> f32 {
    return dot(w.a, vec3f(deformed[at], deformed[at + 1u], deformed[at + 2u]))
        + dot(w.b, vec3f(deformed[at + 3u], deformed[at + 4u], deformed[at + 5u]));
}

// Grey value at pixel (column, row) of the padded crop plus the fractions fx, fy in [0, 1).
fn sample(column: i32, row: i32, fx: f32, fy: f32) -> f32 {
    let wx = quintic(fx);
    let wy = quintic(fy);
    let pitch = params.deformed_width;
    let at = u32(row - 2) * pitch + u32(column - 2);
    return wy.a.x * line(at, wx)
        + wy.a.y * line(at + pitch, wx)
        + wy.a.z * line(at + 2u * pitch, wx)
        + wy.b.x * line(at + 3u * pitch, wx)
        + wy.b.y * line(at + 4u * pitch, wx)
        + wy.b.z * line(at + 5u * pitch, wx);
}

// Where a thread is in its walk over the subset: every 64th pixel, row by row, without divisions.
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
        at.index + THREADS,
        select(column, column - width, over),
        at.row + rows + select(0u, 1u, over),
    );
}

// Add up the first `count` vectors that every thread left in `partial`, always in the same order.
fn reduce(thread: u32, count: u32) {
    workgroupBarrier();
    if (thread < count) {
        var sum = vec4f(0.0);
        for (var t = 0u; t < THREADS; t++) {
            sum += partial[t * VECTORS + thread];
        }
        total[4u * thread] = sum.x;
        total[4u * thread + 1u] = sum.y;
        total[4u * thread + 2u] = sum.z;
        total[4u * thread + 3u] = sum.w;
    }
    workgroupBarrier();
}

@compute @workgroup_size(64)
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
    let mine = thread * VECTORS;
    let columns = THREADS % width;
    let rows = THREADS / width;
    let vectors = 1u + (unknowns + 3u) / 4u;
    let pitch = params.reference_width;
    let first = u32(place.y - i32(params.half)) * pitch + u32(place.x - i32(params.half));

    // reference: weight, mean
    var sums = vec4f(0.0);
    for (var at = walk_from(thread, width); at.index < pixels;
        at = walk_on(at, width, columns, rows)) {
        let r = reference[first + at.row * pitch + at.column];
        let w = window[at.index] * r.w;
        sums += vec4f(w, w * r.x, 0.0, 0.0);
    }
    partial[mine] = sums;
    reduce(thread, 1u);
    let weight = total[0];
    let mean = total[1] / max(weight, 1e-30);
    workgroupBarrier();

    // normal matrix, one row at a time
    for (var k = 0u; k < unknowns; k++) {
        var head = vec4f(0.0);
        var products = Twelve(vec4f(0.0), vec4f(0.0), vec4f(0.0));
        for (var at = walk_from(thread, width); at.index < pixels;
            at = walk_on(at, width, columns, rows)) {
            let r = reference[first + at.row * pitch + at.column];
            let w = window[at.index] * r.w;
            let a = (f32(at.column) - half - fraction.x) / half;
            let b = (f32(at.row) - half - fraction.y) / half;
            let d = descent(r.y, r.z, a, b);
            let wd = w * pick(d, k);
            let f = r.x - mean;
            head += vec4f(wd, wd * f, w * f * f, 0.0);
            products.a += wd * d.a;
            products.b += wd * d.b;
            products.c += wd * d.c;
        }
        partial[mine] = head;
        partial[mine + 1u] = products.a;
        partial[mine + 2u] = products.b;
        partial[mine + 3u] = products.c;
        reduce(thread, vectors);
        if (thread == 0u) {
            descent_sum[k] = total[0];
            descent_dot[k] = total[1];
            for (var j = 0u; j <= k; j++) {
                factor[k * 12u + j] = total[4u + j];
            }
        }
    }
    let energy = total[2];
    let enough = weight >= MIN_WEIGHT * params.window_sum && weight > f32(unknowns) + 2.0;
    let textured = energy > MIN_CONTRAST * MIN_CONTRAST * weight;
    workgroupBarrier();

    var status = NOT_CONVERGED;
    var zncc = 0.0;
    var sigma = 0.0;
    var iterations = 0u;
    if (thread == 0u) {
        running = 0u;
        if (!enough) {
            status = OUTSIDE;
        } else if (!textured) {
            status = NO_TEXTURE;
        } else {
            for (var k = 0u; k < unknowns; k++) {
                for (var j = 0u; j <= k; j++) {
                    factor[k * 12u + j] -= descent_sum[k] * descent_sum[j] / weight
                        + descent_dot[k] * descent_dot[j] / energy;
                }
            }
            if (factorize()) {
                running = 1u;
            } else {
                status = NO_TEXTURE;
            }
        }
        for (var i = 0u; i < 12u; i++) {
            c[i] = starts[id * FLOATS_IN + 2u + i];
        }
        level = mean;
        contrast = 1.0;
    }

    for (var iteration = 1u; iteration <= params.max_iterations; iteration++) {
        if (workgroupUniformLoad(&running) == 0u) { break; }
        let gain = contrast;
        let offset = level;
        let x_a = vec3f(c[0], c[1], c[2]);
        let x_b = vec3f(c[3], c[4], c[5]);
        let y_a = vec3f(c[6], c[7], c[8]);
        let y_b = vec3f(c[9], c[10], c[11]);
        var head = vec4f(0.0);
        var products = Twelve(vec4f(0.0), vec4f(0.0), vec4f(0.0));
        for (var at = walk_from(thread, width); at.index < pixels;
            at = walk_on(at, width, columns, rows)) {
            let dx = f32(at.column) - half;
            let dy = f32(at.row) - half;
            let a = (dx - fraction.x) / half;
            let b = (dy - fraction.y) / half;
            var x = dx + dot(x_a, vec3f(1.0, a, b));
            var y = dy + dot(y_a, vec3f(1.0, a, b));
            if (shape == 3u) {
                let second = vec3f(0.5 * a * a, a * b, 0.5 * b * b);
                x += dot(x_b, second);
                y += dot(y_b, second);
            }
            let fx = floor(x);
            let fy = floor(y);
            let column = place.z + i32(fx);
            let row = place.w + i32(fy);
            let inside = column >= params.x0 && row >= params.y0
                && (column < params.x1 || (column == params.x1 && x == fx))
                && (row < params.y1 || (row == params.y1 && y == fy));
            if (inside) {
                let r = reference[first + at.row * pitch + at.column];
                let w = window[at.index] * r.w;
                let f = r.x - mean;
                let e = f - gain * (sample(column, row, x - fx, y - fy) - offset);
                let we = w * e;
                let d = descent(r.y, r.z, a, b);
                head += vec4f(we, we * f, we * e, 0.0);
                products.a += we * d.a;
                products.b += we * d.b;
                products.c += we * d.c;
            } else {
                head.w += 1.0;
            }
        }
        partial[mine] = head;
        partial[mine + 1u] = products.a;
        partial[mine + 2u] = products.b;
        partial[mine + 3u] = products.c;
        reduce(thread, vectors);
        if (thread == 0u) {
            iterations = iteration;
            let lift = total[0] / weight;
            let along = total[1];
            let rest = total[2] - total[0] * lift;
            let seen = energy - 2.0 * along + rest; // energy of gain * g
            let live = seen > 1e-10 * energy;
            if (total[3] > 0.0) {
                status = OUTSIDE;
                running = 0u;
            } else if (!live) {
                running = 0u;
            } else {
                zncc = (energy - along) / sqrt(energy * seen);
                level = offset - lift / gain;
                contrast = gain * sqrt(energy / seen);
                for (var k = 0u; k < unknowns; k++) {
                    step[k] = -(total[4u + k] - lift * descent_sum[k]
                        - along * descent_dot[k] / energy);
                }
                solve();
                let d = step_coefficients();
                compose(d, half);
                let size = max(
                    abs(d[0]) + abs(d[1]) + abs(d[2]) + abs(d[3]) + abs(d[4]) + abs(d[5]),
                    abs(d[6]) + abs(d[7]) + abs(d[8]) + abs(d[9]) + abs(d[10]) + abs(d[11]),
                );
                let moved = max(
                    abs(c[0] - starts[id * FLOATS_IN + 2u]),
                    abs(c[6] - starts[id * FLOATS_IN + 8u]),
                );
                if (!(moved <= params.max_move)) {
                    running = 0u;
                } else if (size <= params.tolerance) {
                    status = OK;
                    running = 0u;
                    let left = max((energy * rest - along * along) / seen, 0.0)
                        / (weight - f32(unknowns) - 2.0);
                    let second = select(unknowns / 2u, 1u, shape < 2u);
                    let spread = variance(0u);
                    sigma = sqrt(left * max(spread, variance(second)));
                }
            }
        }
    }
    if (thread == 0u) {
        for (var i = 0u; i < 12u; i++) {
            result[id * FLOATS_OUT + i] = c[i];
        }
        result[id * FLOATS_OUT + 12u] = zncc;
        result[id * FLOATS_OUT + 13u] = f32(iterations);
        result[id * FLOATS_OUT + 14u] = status;
        result[id * FLOATS_OUT + 15u] = sigma;
    }
}
