// The curve of sRGB (IEC 61966-2-1). The NumPy form is `encoded` in gpusim/arrays/srgb.py.

// What stands on a screen for a linear value from 0 to 1.
fn encoded(linear: f32) -> f32 {
    let curve = 1.055 * pow(max(linear, 0.0031308), 1.0 / 2.4) - 0.055;
    return select(curve, 12.92 * linear, linear <= 0.0031308);
}
