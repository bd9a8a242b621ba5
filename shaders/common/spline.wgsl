// Quintic B-spline weights and sums. The NumPy form is gpusim/measure/interpolation.py.

// Weights of the taps -2..3, two by two.
struct Taps {
    a: vec2f,
    b: vec2f,
    c: vec2f,
}

// Weights at the fraction t in [0, 1).
fn quintic(t: f32) -> Taps {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return Taps(
        vec2f(s2 * s2 * s, 26.0 + near(t)) / 120.0,
        vec2f(66.0 + t2 * (-60.0 + t2 * (30.0 - 10.0 * t)),
            66.0 + s2 * (-60.0 + s2 * (30.0 - 10.0 * s))) / 120.0,
        vec2f(26.0 + near(s), t2 * t2 * t) / 120.0,
    );
}

fn near(t: f32) -> f32 {
    return t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))));
}

// Value at pixel `at` plus the fraction f in [0, 1)^2. A texel holds the coefficients of a square
// of 2x2 pixels (upper left, right, lower left, right), so that 9 loads bring the 36: software
// rasterisers load texels with vector instructions but buffers word by word.
fn spline_value(coefficients: texture_2d<f32>, at: vec2i, f: vec2f) -> f32 {
    let x = quintic(f.x);
    let y = quintic(f.y);
    let first = at - vec2i(2, 2);
    return dot(y.a, line_pair(coefficients, first, x))
        + dot(y.b, line_pair(coefficients, first + vec2i(0, 2), x))
        + dot(y.c, line_pair(coefficients, first + vec2i(0, 4), x));
}

// Sums along the line of `first` and the one below it.
fn line_pair(coefficients: texture_2d<f32>, first: vec2i, x: Taps) -> vec2f {
    let a = textureLoad(coefficients, first, 0);
    let b = textureLoad(coefficients, first + vec2i(2, 0), 0);
    let c = textureLoad(coefficients, first + vec2i(4, 0), 0);
    return x.a.x * a.xz + x.a.y * a.yw + x.b.x * b.xz + x.b.y * b.yw + x.c.x * c.xz + x.c.y * c.yw;
}
