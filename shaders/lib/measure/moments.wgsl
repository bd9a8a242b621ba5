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
var<workgroup> total: array<vec4f, MOMENTS>;
var<workgroup> descent_sum: array<f32, 12>; // sum of w d over the pixels, by unknown
var<workgroup> descent_dot: array<f32, 12>; // sum of w f d

// Add a pixel: weight, grey value less its mean, gradient, local position.
fn add_pixel(m: ptr<function, array<vec4f, MOMENTS>>, w: f32, f: f32, g: vec2f, s: vec2f) {
    let q = w * vec4f(g.x * g, g.y * g.y, f * f);
    let v = w * vec4f(g, f * g);
    (*m)[0] += q;
    if (shape == 0u) {
        (*m)[1] += v;
        return;
    }
    let aa = s.x * s.x;
    let ab = s.x * s.y;
    let bb = s.y * s.y;
    (*m)[1] += s.x * q;
    (*m)[2] += s.y * q;
    (*m)[3] += aa * q;
    (*m)[4] += ab * q;
    (*m)[5] += bb * q;
    if (shape != 3u) {
        (*m)[6] += v;
        (*m)[7] += s.x * v;
        (*m)[8] += s.y * v;
        return;
    }
    (*m)[6] += aa * s.x * q;
    (*m)[7] += aa * s.y * q;
    (*m)[8] += bb * s.x * q;
    (*m)[9] += bb * s.y * q;
    (*m)[10] += aa * aa * q;
    (*m)[11] += aa * ab * q;
    (*m)[12] += aa * bb * q;
    (*m)[13] += ab * bb * q;
    (*m)[14] += bb * bb * q;
    (*m)[15] += v;
    (*m)[16] += s.x * v;
    (*m)[17] += s.y * v;
    (*m)[18] += 0.5 * aa * v;
    (*m)[19] += ab * v;
    (*m)[20] += 0.5 * bb * v;
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
