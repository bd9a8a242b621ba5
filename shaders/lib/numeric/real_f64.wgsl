// `real` on devices with 64-bit floats. The other form is real_double_single.wgsl.
#import lib/numeric/finite
alias real = f64;
fn r_f32(a: f32) -> real { return f64(a); }
fn r_to_f32(a: real) -> f32 { return f32(a); }
fn r_add(a: real, b: real) -> real { return a + b; }
fn r_sub(a: real, b: real) -> real { return a - b; }
fn r_mul(a: real, b: real) -> real { return a * b; }
fn r_div(a: real, b: real) -> real { return a / b; }
fn r_neg(a: real) -> real { return -a; }
fn r_fma(a: real, b: real, c: real) -> real { return a * b + c; }
fn r_sqrt(a: real) -> real { return sqrt(a); }
fn r_lt(a: real, b: real) -> bool { return a < b; }
// The factor brings every finite f64 into the range of f32; NaN and infinity survive it.
fn r_is_finite(a: real) -> bool { return is_finite_f32(f32(a * 1e-270lf)); }
// the nearest f32, and what it leaves
fn r_high(a: real) -> f32 { return f32(a); }
fn r_low(a: real) -> f32 { return f32(a - f64(f32(a))); }
fn r_pair(high: f32, low: f32) -> real { return f64(high) + f64(low); }
