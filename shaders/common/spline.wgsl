// Quintic B-spline weights. The NumPy form is gpusim/measure/interpolation.py.

struct Taps {
    a: vec3f,
    b: vec3f,
}

// Quintic B-spline weights of the taps -2..3 at the fraction t.
fn quintic(t: f32) -> Taps {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return Taps(
        vec3f(
            s2 * s2 * s,
            26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t)))),
            66.0 + t2 * (-60.0 + t2 * (30.0 - 10.0 * t)),
        ) / 120.0,
        vec3f(
            66.0 + s2 * (-60.0 + s2 * (30.0 - 10.0 * s)),
            26.0 + s * (-50.0 + s * (20.0 + s * (20.0 + s * (-20.0 + 5.0 * s)))),
            t2 * t2 * t,
        ) / 120.0,
    );
}
