// Normal matrix of a subset from moments of its gradient products.
//
// An unknown is a gradient component times a monomial of the local position (a, b), so every
// entry of the matrix is one of the sums over w (gx gx, gx gy, gy gy) a^i b^j: 1, 6 or 15 of
// them, numbered by degree, then j. One pass over the pixels gathers all.
#import lib/measure/normal_equations
#import lib/measure/warp

const MOMENTS = 21u;

// Sums over the subset; of the reference: w (gx gx, gx gy, gy gy, f f) times the monomials of
// degree 0 to 0, 2 or 4 (by shape), then w (gx, gy, f gx, f gy) times the basis functions
// 1, a, b, a^2/2, ab, b^2/2 (the first 1, 3 or 6).
var<private> total: array<vec4f, MOMENTS>;
var<private> descent_sum: array<f32, 12>; // sum of w d over the pixels, by unknown
var<private> descent_dot: array<f32, 12>; // sum of w f d

// The same over a line of pixels, of one b: times the powers of a.
struct Line {
    q0: vec4f, // w (gx gx, gx gy, gy gy, f f)
    q1: vec3f, // w (gx gx, gx gy, gy gy) a
    q2: vec3f,
    q3: vec3f,
    q4: vec3f,
    v0: vec4f, // w (gx, gy, f gx, f gy)
    v1: vec4f,
    v2: vec4f,
}

// Add a pixel: weight, grey value less its mean, gradient, local position along the line.
fn add_pixel(line: ptr<function, Line>, w: f32, f: f32, g: vec2f, a: f32) {
    let q = w * vec3f(g.x * g, g.y * g.y);
    let wg = w * g;
    let v = vec4f(wg, f * wg);
    (*line).q0 += vec4f(q, w * f * f);
    (*line).v0 += v;
    if (shape == 0u) { return; }
    let aa = a * a;
    (*line).q1 += a * q;
    (*line).q2 += aa * q;
    (*line).v1 += a * v;
    if (shape != 3u) { return; }
    (*line).q3 += aa * a * q;
    (*line).q4 += aa * aa * q;
    (*line).v2 += 0.5 * aa * v;
}

// Add the line at b to `total`.
fn add_line_moments(line: Line, b: f32) {
    total[0] += line.q0;
    if (shape == 0u) {
        total[1] += line.v0;
        return;
    }
    let q0 = vec4f(line.q0.xyz, 0.0);
    let q1 = vec4f(line.q1, 0.0);
    let q2 = vec4f(line.q2, 0.0);
    let bb = b * b;
    total[1] += q1;
    total[2] += b * q0;
    total[3] += q2;
    total[4] += b * q1;
    total[5] += bb * q0;
    if (shape != 3u) {
        total[6] += line.v0;
        total[7] += line.v1;
        total[8] += b * line.v0;
        return;
    }
    let q3 = vec4f(line.q3, 0.0);
    total[6] += q3;
    total[7] += b * q2;
    total[8] += bb * q1;
    total[9] += bb * b * q0;
    total[10] += vec4f(line.q4, 0.0);
    total[11] += b * q3;
    total[12] += bb * q2;
    total[13] += bb * b * q1;
    total[14] += bb * bb * q0;
    total[15] += line.v0;
    total[16] += line.v1;
    total[17] += b * line.v0;
    total[18] += line.v2;
    total[19] += b * line.v1;
    total[20] += 0.5 * bb * line.v0;
}

// Sums of each unknown's descent image, from `total`.
fn set_sums() {
    if (shape == 1u) {
        // the third unknown is the rotation gy a - gx b
        descent_sum[0] = total[6].x;
        descent_sum[1] = total[6].y;
        descent_sum[2] = total[7].y - total[8].x;
        descent_dot[0] = total[6].z;
        descent_dot[1] = total[6].w;
        descent_dot[2] = total[7].w - total[8].z;
        return;
    }
    let terms = unknowns / 2u;
    let first = select(select(1u, 6u, shape > 0u), 15u, shape > 2u);
    for (var k = 0u; k < terms; k++) {
        let sum = total[first + k];
        descent_sum[k] = sum.x;
        descent_sum[terms + k] = sum.y;
        descent_dot[k] = sum.z;
        descent_dot[terms + k] = sum.w;
    }
}

// Lower half of the normal matrix of the gradients alone.
fn set_matrix() {
    if (shape == 1u) {
        let o = total[0];
        let a = total[1];
        let b = total[2];
        factor[0] = o.x;
        factor[12] = o.y;
        factor[13] = o.z;
        factor[24] = a.y - b.x;
        factor[25] = a.z - b.y;
        factor[26] = total[3].z - 2.0 * total[4].y + total[5].x;
        return;
    }
    let terms = unknowns / 2u;
    for (var k = 0u; k < unknowns; k++) {
        for (var j = 0u; j <= k; j++) {
            let both = power(k % terms) + power(j % terms);
            let degree = both.x + both.y;
            let sums = total[(degree * (degree + 1u)) / 2u + both.y];
            let component = k / terms + j / terms;
            let sum = select(select(sums.z, sums.y, component == 1u), sums.x, component == 0u);
            factor[k * 12u + j] = sum * halved(k % terms) * halved(j % terms);
        }
    }
}

// Powers of a and b in the basis functions 1, a, b, a^2/2, ab, b^2/2.
fn power(term: u32) -> vec2u {
    let degree = select(select(0u, 1u, term > 0u), 2u, term > 2u);
    let b = term - (degree * (degree + 1u)) / 2u;
    return vec2u(degree - b, b);
}

fn halved(term: u32) -> f32 {
    return select(1.0, 0.5, term == 3u || term == 5u);
}

// Take what a change of offset and of gain explains out of the matrix.
fn project_matrix(weight: f32, energy: f32) {
    for (var k = 0u; k < unknowns; k++) {
        for (var j = 0u; j <= k; j++) {
            factor[k * 12u + j] -= descent_sum[k] * descent_sum[j] / weight
                + descent_dot[k] * descent_dot[j] / energy;
        }
    }
}
