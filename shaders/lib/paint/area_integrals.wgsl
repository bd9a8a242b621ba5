// Exact areas of simple shapes inside a pixel's footprint, in float32 without cancellation.
// The NumPy form is gpusim/optics/geometry/polygon_clipping.py; both are compared with sampling in the tests.
//
// A footprint is a convex polygon in paint coordinates. Green's theorem turns each area into a
// sum over its edges, so that a shape needs one function of an edge only.

// Mean of max(x, 0) over the segment from a to b.
fn relu_mean(a: f32, b: f32) -> f32 {
    let hi = max(a, b);
    let lo = min(a, b);
    if (lo >= 0.0) { return 0.5 * (a + b); }
    if (hi <= 0.0) { return 0.0; }
    return 0.5 * hi * (hi / (hi - lo));
}

// Contribution of the edge p -> q to the area of {x > 0, y > 0}: integral of max(x,0) [y>0] dy.
fn quadrant_edge(p: vec2f, q: vec2f) -> f32 {
    if (p.y <= 0.0 && q.y <= 0.0) { return 0.0; }
    var a = p;
    var b = q;
    if (a.y < 0.0) { a = vec2f(mix(a.x, b.x, -a.y / (b.y - a.y)), 0.0); }
    if (b.y < 0.0) { b = vec2f(mix(b.x, a.x, -b.y / (a.y - b.y)), 0.0); }
    return relu_mean(a.x, b.x) * (b.y - a.y);
}

// Share of the unit pixel where d + g.x * x + g.y * y > 0, with x, y in [-1/2, 1/2].
fn half_plane_share(d: f32, g: vec2f) -> f32 {
    let a = max(abs(g.x), abs(g.y));
    let b = min(abs(g.x), abs(g.y));
    let x = abs(d);
    let far = 0.5 * (a + b);
    if (x >= far) { return select(0.0, 1.0, d > 0.0); }
    if (x <= 0.5 * (a - b)) { return 0.5 + d / a; }
    let rest = 0.5 * (far - x) * ((far - x) / (a * b));
    return select(rest, 1.0 - rest, d > 0.0);
}

// Contribution of the edge p -> q to the area inside the circle |x| < r (r of pixel size).
fn small_disc_edge(p: vec2f, q: vec2f, r: f32) -> f32 {
    let d = q - p;
    let a = dot(d, d);
    if (a <= 0.0) { return 0.0; }
    let b = dot(p, d);
    let c = dot(p, p) - r * r;
    let disc = b * b - a * c;
    if (disc <= 0.0) { return sector(p, q, r); }
    let root = sqrt(disc);
    let t0 = clamp((-b - root) / a, 0.0, 1.0);
    let t1 = clamp((-b + root) / a, 0.0, 1.0);
    if (t1 <= t0) { return sector(p, q, r); }
    let u = p + t0 * d;
    let v = p + t1 * d;
    var area = 0.5 * (u.x * v.y - u.y * v.x);
    if (t0 > 0.0) { area += sector(p, u, r); }
    if (t1 < 1.0) { area += sector(v, q, r); }
    return area;
}

// Signed area of the circular sector between the directions of p and q.
fn sector(p: vec2f, q: vec2f, r: f32) -> f32 {
    let across = p.x * q.y - p.y * q.x;
    let along = dot(p, q);
    var angle = atan2(across, along);
    if (abs(across) < 0.1 * along) {
        // drivers' atan2 is good to 1e-7 rad only, which r^2 makes large: the series
        let z = across / along;
        let k = z * z;
        angle = z * (1.0 - k * (1.0 / 3.0 - k * (1.0 / 5.0 - k * (1.0 / 7.0 - k * (1.0 / 9.0)))));
    }
    return 0.5 * r * r * angle;
}

// Integral of r - sqrt(r^2 - x^2) from 0 to x, by its series; |x| < r / 3.
fn sagitta_integral(x: f32, r: f32) -> f32 {
    let k = (x / r) * (x / r);
    return x * x * (x / r) * (1.0 / 6.0 + k * (1.0 / 40.0 + k * (1.0 / 112.0 + k * (5.0 / 1152.0 + k * 7.0 / 2816.0))));
}

// Contribution of the edge p -> q to the area inside a circle that is large against the pixel.
// Frame: x along the tangent, y along the outward normal, origin where the pixel's centre is;
// `gap` = r - distance of the origin from the circle's centre. Inside: y < gap - sagitta(x).
// The integral of -min(y, curve(x)) dx, split where the edge crosses the curve.
fn large_disc_edge(p: vec2f, q: vec2f, r: f32, gap: f32) -> f32 {
    let d = q - p;
    let m = vec2f(p.x, p.y + (r - gap));
    let a = dot(d, d);
    if (a <= 0.0) { return 0.0; }
    let b = dot(m, d);
    // |m|^2 - r^2 without cancellation
    let c = p.x * p.x + (p.y - gap) * (p.y - gap + 2.0 * r);
    let disc = b * b - a * c;
    var t0 = 0.0;
    var t1 = 0.0;
    if (disc > 0.0) {
        let root = sqrt(disc);
        let w = -b - select(-root, root, b > 0.0);
        var u = c / w;
        var v = w / a;
        if (w == 0.0) { u = 0.0; v = 0.0; }
        t0 = clamp(min(u, v), 0.0, 1.0);
        t1 = clamp(max(u, v), 0.0, 1.0);
    }
    let u = p + t0 * d;
    let v = p + t1 * d;
    // inside the circle (between t0 and t1) the edge itself counts, outside it the curve
    var area = -0.5 * (u.y + v.y) * (v.x - u.x);
    area -= gap * (u.x - p.x) - (sagitta_integral(u.x, r) - sagitta_integral(p.x, r));
    area -= gap * (q.x - v.x) - (sagitta_integral(q.x, r) - sagitta_integral(v.x, r));
    return area;
}

// Share of the parallelogram with centre p (relative to the centre of a disc that is large against
// it) and sides ex, ey inside the disc.
fn large_disc_share(p: vec2f, ex: vec2f, ey: vec2f, r: f32) -> f32 {
    let reach = 0.5 * max(length(ex + ey), length(ex - ey));
    let dist = length(p);
    if (dist >= r + reach) { return 0.0; }
    if (dist <= r - reach) { return 1.0; }
    let n = p / dist;
    let gap = r - dist;
    let x = 0.5 * vec2f(n.y * ex.x - n.x * ex.y, dot(n, ex));
    let y = 0.5 * vec2f(n.y * ey.x - n.x * ey.y, dot(n, ey));
    let sum = large_disc_edge(-x - y, x - y, r, gap) + large_disc_edge(x - y, x + y, r, gap)
        + large_disc_edge(x + y, y - x, r, gap) + large_disc_edge(y - x, -x - y, r, gap);
    return clamp(sum / (ex.x * ey.y - ex.y * ey.x), 0.0, 1.0);
}
