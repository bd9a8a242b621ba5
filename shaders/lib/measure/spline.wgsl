// Quintic B-spline weights and sums. The NumPy form is gpusim/measure/images.py.

// Weights of the taps -2..3, two by two.
struct Taps {
    a: vec2f,
    b: vec2f,
    c: vec2f,
}

// Coefficients of u^0, u^2, u^4 and of u, u^3, u^5, u = t - 1/2, of the weights of tap 3 and of tap 2.
const OUTER_EVEN = vec3f(1.0, 40.0, 80.0) / 3840.0;
const OUTER_ODD = vec3f(10.0, 80.0, 32.0) / 3840.0;
const NEXT_EVEN = vec3f(237.0, 840.0, -240.0) / 3840.0;
const NEXT_ODD = vec3f(750.0, 240.0, -160.0) / 3840.0;

// Weights at the fraction t in [0, 1). Those of two taps as far from the middle are a sum and a
// difference of an even and an odd polynomial; of the innermost, these follow from the others', as
// all weights add up to 1 and reproduce straight lines.
fn quintic(t: f32) -> Taps {
    let u = t - 0.5;
    let v = u * u;
    let even_a = OUTER_EVEN.x + v * (OUTER_EVEN.y + v * OUTER_EVEN.z);
    let odd_a = u * (OUTER_ODD.x + v * (OUTER_ODD.y + v * OUTER_ODD.z));
    let even_b = NEXT_EVEN.x + v * (NEXT_EVEN.y + v * NEXT_EVEN.z);
    let odd_b = u * (NEXT_ODD.x + v * (NEXT_ODD.y + v * NEXT_ODD.z));
    let even_c = 0.5 - even_a - even_b;
    let odd_c = u - 5.0 * odd_a - 3.0 * odd_b;
    return Taps(
        vec2f(even_a - odd_a, even_b - odd_b),
        vec2f(even_c - odd_c, even_c + odd_c),
        vec2f(even_b + odd_b, even_a + odd_a),
    );
}

// Value at pixel `at` plus the fraction f in [0, 1)^2. A texel holds the coefficients of a square
// of 2x2 pixels (upper left, right, lower left, right), so that 9 loads bring the 36: software
// rasterisers load texels with vector instructions but buffers word by word.
fn spline_value(coefficients: texture_storage_2d<rgba32float, read>, at: vec2i, f: vec2f) -> f32 {
    let x = quintic(f.x);
    let y = quintic(f.y);
    let first = at - vec2i(2, 2);
    return dot(y.a, line_pair(coefficients, first, x))
        + dot(y.b, line_pair(coefficients, first + vec2i(0, 2), x))
        + dot(y.c, line_pair(coefficients, first + vec2i(0, 4), x));
}

// Sums along the line of `first` and the one below it.
fn line_pair(coefficients: texture_storage_2d<rgba32float, read>, first: vec2i, x: Taps) -> vec2f {
    let a = textureLoad(coefficients, first);
    let b = textureLoad(coefficients, first + vec2i(2, 0));
    let c = textureLoad(coefficients, first + vec2i(4, 0));
    return x.a.x * a.xz + x.a.y * a.yw + x.b.x * b.xz + x.b.y * b.yw + x.c.x * c.xz + x.c.y * c.yw;
}

// Eight columns of two lines.
struct Band {
    a: vec2f,
    b: vec2f,
    c: vec2f,
    d: vec2f,
    e: vec2f,
    f: vec2f,
    g: vec2f,
    h: vec2f,
}

fn band(coefficients: texture_storage_2d<rgba32float, read>, first: vec2i) -> Band {
    let a = textureLoad(coefficients, first);
    let c = textureLoad(coefficients, first + vec2i(2, 0));
    let e = textureLoad(coefficients, first + vec2i(4, 0));
    let g = textureLoad(coefficients, first + vec2i(6, 0));
    return Band(a.xz, a.yw, c.xz, c.yw, e.xz, e.yw, g.xz, g.yw);
}

// Sums along a band for three neighbouring pixels: its first six columns, the next, the last.
struct Three {
    a: vec2f,
    b: vec2f,
    c: vec2f,
}

fn along(l: Band, x: ThreeTaps) -> Three {
    let p = x.a;
    let q = x.b;
    let r = x.c;
    return Three(
        p.a.x * l.a + p.a.y * l.b + p.b.x * l.c + p.b.y * l.d + p.c.x * l.e + p.c.y * l.f,
        q.a.x * l.b + q.a.y * l.c + q.b.x * l.d + q.b.y * l.e + q.c.x * l.f + q.c.y * l.g,
        r.a.x * l.c + r.a.y * l.d + r.b.x * l.e + r.b.y * l.f + r.c.x * l.g + r.c.y * l.h,
    );
}

struct ThreeTaps {
    a: Taps,
    b: Taps,
    c: Taps,
}

fn three_taps(t: vec3f) -> ThreeTaps {
    return ThreeTaps(quintic(t.x), quintic(t.y), quintic(t.z));
}

// Values at three by three positions about one pixel apart, which share 16 loads instead of making
// 9 each: lines `x[0]`, `y[0]` to `x[2]`, `y[2]`, as offsets from `at`. The pieces of a quintic spline
// meet in four derivatives, so that one holds on beyond its pixel: by 0.2 px to 3e-6 of its sixth
// differences. So all take the pieces that follow from the middle one's.
fn nine_values(
    coefficients: texture_storage_2d<rgba32float, read>, at: vec2i,
    x: mat3x3f, y: mat3x3f,
) -> mat3x3f {
    let column = floor(x[1].y);
    let row = floor(y[1].y);
    let first = at + vec2i(i32(column), i32(row)) - 3;
    let top = band(coefficients, first);
    let upper = band(coefficients, first + vec2i(0, 2));
    let lower = band(coefficients, first + vec2i(0, 4));
    let bottom = band(coefficients, first + vec2i(0, 6));
    let columns = column + vec3f(-1.0, 0.0, 1.0);
    var values: mat3x3f;
    {
        let taps = three_taps(x[0] - columns);
        let by = three_taps(y[0] - row + 1.0);
        let p = along(top, taps);
        let q = along(upper, taps);
        let r = along(lower, taps);
        values[0] = vec3f(
            dot(by.a.a, p.a) + dot(by.a.b, q.a) + dot(by.a.c, r.a),
            dot(by.b.a, p.b) + dot(by.b.b, q.b) + dot(by.b.c, r.b),
            dot(by.c.a, p.c) + dot(by.c.b, q.c) + dot(by.c.c, r.c),
        );
    }
    {
        let taps = three_taps(x[1] - columns);
        let by = three_taps(y[1] - row);
        let p = along(top, taps);
        let q = along(upper, taps);
        let r = along(lower, taps);
        let s = along(bottom, taps);
        values[1] = vec3f(
            between(by.a, p.a, q.a, r.a, s.a),
            between(by.b, p.b, q.b, r.b, s.b),
            between(by.c, p.c, q.c, r.c, s.c),
        );
    }
    {
        let taps = three_taps(x[2] - columns);
        let by = three_taps(y[2] - row - 1.0);
        let q = along(upper, taps);
        let r = along(lower, taps);
        let s = along(bottom, taps);
        values[2] = vec3f(
            dot(by.a.a, q.a) + dot(by.a.b, r.a) + dot(by.a.c, s.a),
            dot(by.b.a, q.b) + dot(by.b.b, r.b) + dot(by.b.c, s.b),
            dot(by.c.a, q.c) + dot(by.c.b, r.c) + dot(by.c.c, s.c),
        );
    }
    return values;
}

// Sum over six lines that begin with the second of the first pair.
fn between(by: Taps, p: vec2f, q: vec2f, r: vec2f, s: vec2f) -> f32 {
    return by.a.x * p.y + by.a.y * q.x + by.b.x * q.y + by.b.y * r.x + by.c.x * r.y + by.c.y * s.x;
}
