// Warp of a subset and what a step does to it. gpusim/measure/correlation/warp.py has the formulas and the
// NumPy form.

// 0 translation, 1 rigid, 2 affine, 3 quadratic
override shape: u32;

// One displacement component: coefficients of 1, a, b and of a^2/2, ab, b^2/2; px.
struct Component {
    low: vec3f,
    high: vec3f,
}

struct Warp {
    x: Component,
    y: Component,
}

// Displacement at the local position s = (a, b).
fn displacement(c: Warp, s: vec2f) -> vec2f {
    let first = vec3f(1.0, s);
    var d = vec2f(dot(c.x.low, first), dot(c.y.low, first));
    if (shape == 3u) {
        let second = vec3f(0.5 * s.x * s.x, s.x * s.y, 0.5 * s.y * s.y);
        d += vec2f(dot(c.x.high, second), dot(c.y.high, second));
    }
    return d;
}

// The unknowns of the shape as a warp.
fn warp_of(step: array<f32, 12>) -> Warp {
    const none = vec3f(0.0);
    if (shape == 0u) {
        return Warp(
            Component(vec3f(step[0], 0.0, 0.0), none),
            Component(vec3f(step[1], 0.0, 0.0), none),
        );
    }
    if (shape == 1u) {
        return Warp(
            Component(vec3f(step[0], 0.0, -step[2]), none),
            Component(vec3f(step[1], step[2], 0.0), none),
        );
    }
    if (shape == 2u) {
        return Warp(
            Component(vec3f(step[0], step[1], step[2]), none),
            Component(vec3f(step[3], step[4], step[5]), none),
        );
    }
    return Warp(
        Component(vec3f(step[0], step[1], step[2]), vec3f(step[3], step[4], step[5])),
        Component(vec3f(step[6], step[7], step[8]), vec3f(step[9], step[10], step[11])),
    );
}

// The most that a point of the subset moves along an axis.
fn largest_move(d: Warp) -> f32 {
    const one = vec3f(1.0);
    return max(
        dot(abs(d.x.low), one) + dot(abs(d.x.high), one),
        dot(abs(d.y.low), one) + dot(abs(d.y.high), one),
    );
}

// c o d^-1 to first order in d, cut after second-order terms.
fn compose_inverse(c: Warp, d: Warp, half: f32) -> Warp {
    let result = Warp(
        compose_component(c.x, d.x, d, half),
        compose_component(c.y, d.y, d, half),
    );
    if (shape == 1u) {
        return nearest_rotation(result, half);
    }
    return result;
}

fn compose_component(c: Component, own: Component, d: Warp, half: f32) -> Component {
    // slopes of c by a and b, and how they change: constant, a, b
    let l = vec3f(c.low.y, c.high.x, c.high.y) / half;
    let m = vec3f(c.low.z, c.high.y, c.high.z) / half;
    let p = d.x.low;
    let q = d.y.low;
    let low = own.low + l.x * p + m.x * q
        + vec3f(0.0, l.y * p.x + m.y * q.x, l.z * p.x + m.z * q.x);
    if (shape != 3u) {
        return Component(c.low - low, c.high);
    }
    let high = own.high + l.x * d.x.high + m.x * d.y.high
        + vec3f(
            2.0 * (l.y * p.y + m.y * q.y),
            l.y * p.z + l.z * p.y + m.y * q.z + m.z * q.y,
            2.0 * (l.z * p.z + m.z * q.z),
        );
    return Component(c.low - low, c.high - high);
}

fn nearest_rotation(c: Warp, half: f32) -> Warp {
    let cosine = 2.0 * half + c.x.low.y + c.y.low.z;
    let sine = c.y.low.y - c.x.low.z;
    let length = sqrt(cosine * cosine + sine * sine);
    // 1 - cos from the sine: no cancellation at small angles
    let shrink = -half * sine * sine / (length * (length + cosine));
    let turn = half * sine / length;
    return Warp(
        Component(vec3f(c.x.low.x, shrink, -turn), vec3f(0.0)),
        Component(vec3f(c.y.low.x, turn, shrink), vec3f(0.0)),
    );
}

// Whether positions lie in a closed box.
fn inside(x: vec3f, y: vec3f, lowest: vec2f, highest: vec2f) -> vec3<bool> {
    let in_x = (x >= lowest.xxx) & (x <= highest.xxx);
    return in_x & (y >= lowest.yyy) & (y <= highest.yyy);
}

// Displacements of three pixels of the line at b.
struct Moves {
    x: vec3f,
    y: vec3f,
}

fn three_displacements(c: Warp, a: vec3f, b: f32) -> Moves {
    let p = displacement(c, vec2f(a.x, b));
    let q = displacement(c, vec2f(a.y, b));
    let r = displacement(c, vec2f(a.z, b));
    return Moves(vec3f(p.x, q.x, r.x), vec3f(p.y, q.y, r.y));
}

// How much neighbouring pixels, diagonal ones too, are closer or further apart along an axis after
// the warp, px.
fn stretch(c: Warp, half: f32) -> f32 {
    // second derivatives act over the subset's half width and half a pixel
    let bend_x = abs(c.x.high.x) + 2.0 * abs(c.x.high.y) + abs(c.x.high.z);
    let bend_y = abs(c.y.high.x) + 2.0 * abs(c.y.high.y) + abs(c.y.high.z);
    return max(
        abs(c.x.low.y) + abs(c.x.low.z) + 1.2 * bend_x,
        abs(c.y.low.y) + abs(c.y.low.z) + 1.2 * bend_y,
    ) / half;
}
