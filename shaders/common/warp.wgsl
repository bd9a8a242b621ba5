// Shape functions of a subset, and what a step does to the warp; gpusim/measure/warp.py has the
// formulas and the NumPy form.

// 0 translation, 1 rigid, 2 affine, 3 quadratic; and its number of unknowns
override shape: u32;
override unknowns: u32;

var<workgroup> c: array<f32, 12>;    // 6 coefficients for x, 6 for y
var<workgroup> step: array<f32, 12>; // change of the unknowns

// Twelve values in registers: an array indexed in a loop would live in slow scratch memory.
struct Twelve {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

// Change of the grey value by each unknown.
fn descent(fx: f32, fy: f32, a: f32, b: f32) -> Twelve {
    const none = vec4f(0.0);
    if (shape == 0u) {
        return Twelve(vec4f(fx, fy, 0.0, 0.0), none, none);
    }
    if (shape == 1u) {
        return Twelve(vec4f(fx, fy, fy * a - fx * b, 0.0), none, none);
    }
    if (shape == 2u) {
        return Twelve(vec4f(fx, fx * a, fx * b, fy), vec4f(fy * a, fy * b, 0.0, 0.0), none);
    }
    let aa = 0.5 * a * a;
    let ab = a * b;
    let bb = 0.5 * b * b;
    return Twelve(
        vec4f(fx, fx * a, fx * b, fx * aa),
        vec4f(fx * ab, fx * bb, fy, fy * a),
        vec4f(fy * b, fy * aa, fy * ab, fy * bb),
    );
}

// One of the twelve; k is the same for all threads.
fn pick(d: Twelve, k: u32) -> f32 {
    var four = d.a;
    if (k >= 8u) {
        four = d.c;
    } else if (k >= 4u) {
        four = d.b;
    }
    let rest = k & 3u;
    return select(select(four.x, four.y, rest == 1u), select(four.z, four.w, rest == 3u), rest > 1u);
}

// The step as warp coefficients.
fn step_coefficients() -> array<f32, 12> {
    var d = array<f32, 12>();
    if (shape == 0u) {
        d[0] = step[0];
        d[6] = step[1];
    } else if (shape == 1u) {
        d[0] = step[0];
        d[6] = step[1];
        d[2] = -step[2];
        d[7] = step[2];
    } else if (shape == 2u) {
        d[0] = step[0];
        d[1] = step[1];
        d[2] = step[2];
        d[6] = step[3];
        d[7] = step[4];
        d[8] = step[5];
    } else {
        for (var i = 0u; i < 12u; i++) {
            d[i] = step[i];
        }
    }
    return d;
}

// c <- c o d^-1 to first order, cut after second-order terms (compose_inverse in warp.py).
fn compose(d: array<f32, 12>, half: f32) {
    for (var i = 0u; i < 12u; i += 6u) {
        let l = vec3f(c[i + 1u], c[i + 3u], c[i + 4u]) / half;
        let m = vec3f(c[i + 2u], c[i + 4u], c[i + 5u]) / half;
        c[i] -= d[i] + l.x * d[0] + m.x * d[6];
        c[i + 1u] -= d[i + 1u] + l.x * d[1] + l.y * d[0] + m.x * d[7] + m.y * d[6];
        c[i + 2u] -= d[i + 2u] + l.x * d[2] + l.z * d[0] + m.x * d[8] + m.z * d[6];
        if (shape == 3u) {
            c[i + 3u] -= d[i + 3u] + l.x * d[3] + 2.0 * l.y * d[1] + m.x * d[9] + 2.0 * m.y * d[7];
            c[i + 4u] -= d[i + 4u] + l.x * d[4] + l.y * d[2] + l.z * d[1]
                + m.x * d[10] + m.y * d[8] + m.z * d[7];
            c[i + 5u] -= d[i + 5u] + l.x * d[5] + 2.0 * l.z * d[2] + m.x * d[11] + 2.0 * m.z * d[8];
        }
    }
    if (shape == 1u) {
        let cosine = 2.0 * half + c[1] + c[8];
        let sine = c[7] - c[2];
        let length = sqrt(cosine * cosine + sine * sine);
        let shrink = -half * sine * sine / (length * (length + cosine));
        c[1] = shrink;
        c[8] = shrink;
        c[2] = -half * sine / length;
        c[7] = half * sine / length;
    }
}
