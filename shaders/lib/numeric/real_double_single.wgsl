// `real` on devices without 64-bit floats: an unevaluated sum of two f32, about 48 bits
// (Dekker 1971; Hida, Li, Bailey 2001). The range is that of f32: the host scales first.
//
// Compilers may simplify (a + b) - a to b, which destroys the low part. `opaque` sends a value
// through an exclusive or with a zero that is only known at run time, so that they can't.
#import lib/numeric/finite
alias real = vec2f;
struct RealOpaque {
    zero: u32,
}
@group(1) @binding(0) var<uniform> real_opaque: RealOpaque;
fn opaque(a: f32) -> f32 { return bitcast<f32>(bitcast<u32>(a) ^ real_opaque.zero); }
fn quick_two_sum(a: f32, b: f32) -> vec2f {
    let s = opaque(a + b);
    return vec2f(s, b - opaque(s - a));
}
fn two_sum(a: f32, b: f32) -> vec2f {
    let s = opaque(a + b);
    let v = opaque(s - a);
    return vec2f(s, (a - opaque(s - v)) + (b - v));
}
fn split(a: f32) -> vec2f {
    let t = opaque(4097.0 * a);
    let hi = opaque(t - opaque(t - a));
    return vec2f(hi, opaque(a - hi));
}
fn two_prod(a: f32, b: f32) -> vec2f {
    let p = opaque(a * b);
    let x = split(a);
    let y = split(b);
    let e = opaque(opaque(x.x * y.x) - p) + opaque(x.x * y.y);
    return vec2f(p, opaque(opaque(e) + opaque(x.y * y.x)) + opaque(x.y * y.y));
}
fn r_f32(a: f32) -> real { return vec2f(a, 0.0); }
fn r_to_f32(a: real) -> f32 { return a.x + a.y; }
fn r_add(a: real, b: real) -> real {
    let s = two_sum(a.x, b.x);
    let t = two_sum(a.y, b.y);
    let c = quick_two_sum(s.x, s.y + t.x);
    return quick_two_sum(c.x, c.y + t.y);
}
fn r_neg(a: real) -> real { return -a; }
fn r_sub(a: real, b: real) -> real { return r_add(a, -b); }
fn r_mul(a: real, b: real) -> real {
    let p = two_prod(a.x, b.x);
    return quick_two_sum(p.x, p.y + (opaque(a.x * b.y) + opaque(a.y * b.x)));
}
fn r_fma(a: real, b: real, c: real) -> real { return r_add(r_mul(a, b), c); }
fn r_div(a: real, b: real) -> real {
    let q = a.x / b.x;
    let r = r_sub(a, r_mul(b, vec2f(q, 0.0)));
    let q2 = r.x / b.x;
    let r2 = r_sub(r, r_mul(b, vec2f(q2, 0.0)));
    return r_add(quick_two_sum(q, q2), vec2f(r2.x / b.x, 0.0));
}
fn r_sqrt(a: real) -> real {
    if (!(a.x > 0.0)) { return vec2f(0.0, 0.0); }
    let x = inverseSqrt(a.x);
    let ax = a.x * x;
    let d = r_sub(a, two_prod(ax, ax));
    let y = quick_two_sum(ax, d.x * (x * 0.5));
    let d2 = r_sub(a, r_mul(y, y));
    return r_add(y, vec2f(d2.x * (x * 0.5), 0.0));
}
fn r_lt(a: real, b: real) -> bool { return a.x < b.x || (a.x == b.x && a.y < b.y); }
fn r_is_finite(a: real) -> bool { return is_finite_f32(a.x) && is_finite_f32(a.y); }
fn r_high(a: real) -> f32 { return a.x; }
fn r_low(a: real) -> f32 { return a.y; }
fn r_pair(high: f32, low: f32) -> real { return vec2f(high, low); }
