// Quintic B-spline weights and sums. The NumPy form is gpusim/measure/images.py.

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

// Six taps among eight, two by two.
struct Eight {
    a: vec2f,
    b: vec2f,
    c: vec2f,
    d: vec2f,
}

// The taps moved by 0, 1 or 2 places.
fn moved_taps(t: Taps, by: f32) -> Eight {
    let none = vec2f(0.0);
    let at_one = by > 0.5;
    let at_two = by > 1.5;
    return Eight(
        select(t.a, select(vec2f(0.0, t.a.x), none, at_two), at_one),
        select(t.b, select(vec2f(t.a.y, t.b.x), t.a, at_two), at_one),
        select(t.c, select(vec2f(t.b.y, t.c.x), t.b, at_two), at_one),
        select(none, select(vec2f(t.c.y, 0.0), t.c, at_two), at_one),
    );
}

// Sums along two lines of eight, by texels of 2x2 coefficients.
fn eight_pair(a: vec4f, b: vec4f, c: vec4f, d: vec4f, x: Eight) -> vec2f {
    return x.a.x * a.xz + x.a.y * a.yw + x.b.x * b.xz + x.b.y * b.yw
        + x.c.x * c.xz + x.c.y * c.yw + x.d.x * d.xz + x.d.y * d.yw;
}

// Values at four positions of two neighbouring lines that lie within two pixels of each other:
// they share 16 loads instead of making 9 each. `x`, `y` are the positions as offsets from `at`.
fn spline_values(
    coefficients: texture_storage_2d<rgba32float, read>, at: vec2i, x: vec4f, y: vec4f,
) -> vec4f {
    let column = floor(x);
    let row = floor(y);
    let tx = x - column;
    let ty = y - row;
    let left = min(min(column.x, column.y), min(column.z, column.w));
    let top = min(min(row.x, row.y), min(row.z, row.w));
    let dx = column - left;
    let dy = row - top;
    let x0 = moved_taps(quintic(tx.x), dx.x);
    let x1 = moved_taps(quintic(tx.y), dx.y);
    let x2 = moved_taps(quintic(tx.z), dx.z);
    let x3 = moved_taps(quintic(tx.w), dx.w);
    let y0 = moved_taps(quintic(ty.x), dy.x);
    let y1 = moved_taps(quintic(ty.y), dy.y);
    let y2 = moved_taps(quintic(ty.z), dy.z);
    let y3 = moved_taps(quintic(ty.w), dy.w);
    let first = at + vec2i(i32(left), i32(top)) - vec2i(2, 2);
    return eight_lines(coefficients, first, x0, x1, x2, x3, y0.a, y1.a, y2.a, y3.a)
        + eight_lines(coefficients, first + vec2i(0, 2), x0, x1, x2, x3, y0.b, y1.b, y2.b, y3.b)
        + eight_lines(coefficients, first + vec2i(0, 4), x0, x1, x2, x3, y0.c, y1.c, y2.c, y3.c)
        + eight_lines(coefficients, first + vec2i(0, 6), x0, x1, x2, x3, y0.d, y1.d, y2.d, y3.d);
}

// What the line of `first` and the one below it give to four values.
fn eight_lines(
    coefficients: texture_storage_2d<rgba32float, read>, first: vec2i,
    x0: Eight, x1: Eight, x2: Eight, x3: Eight,
    y0: vec2f, y1: vec2f, y2: vec2f, y3: vec2f,
) -> vec4f {
    let a = textureLoad(coefficients, first);
    let b = textureLoad(coefficients, first + vec2i(2, 0));
    let c = textureLoad(coefficients, first + vec2i(4, 0));
    let d = textureLoad(coefficients, first + vec2i(6, 0));
    return vec4f(
        dot(y0, eight_pair(a, b, c, d, x0)),
        dot(y1, eight_pair(a, b, c, d, x1)),
        dot(y2, eight_pair(a, b, c, d, x2)),
        dot(y3, eight_pair(a, b, c, d, x3)),
    );
}
