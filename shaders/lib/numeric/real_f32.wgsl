// `real` in single precision, for stages that want it on every device.
alias real = f32;
fn r_f32(a: f32) -> real { return a; }
fn r_add(a: real, b: real) -> real { return a + b; }
fn r_sub(a: real, b: real) -> real { return a - b; }
fn r_mul(a: real, b: real) -> real { return a * b; }
fn r_fma(a: real, b: real, c: real) -> real { return a * b + c; }
fn r_pair(high: f32, low: f32) -> real { return high + low; }
