// What a receiver sees of single occluders. The NumPy form is gpusim/optics/shadow/twin.py.
#import common/lamp_samples
#import optics/shadow/receiver

@group(0) @binding(30) var<uniform> lamp: LampFace;

const AGAINST: f32 = -0.5;   // cosine between the normals of what lies against each other
const BESIDE: f32 = 0.5;     // above which a receiver may be part of a sheet that goes on with a face
const BEYOND: f32 = 1e-5;   // sine by which what lies beyond an edge may overlap it from rounding

// A receiver before the lamp, and over its own plane: directions, and what a corner has to exceed.
struct Looking {
    to: vec3f,
    tolerance: f32,
    over: vec3f,
    level: f32,
    // corners of the triangle that it lies on; facing: 1 where that is of an open surface and turned to
    // all of the lamp, -1 where away, else 0; how much of the pixel about its middle lies within it
    a: vec3f,
    b: vec3f,
    c: vec3f,
    facing: f32,
    within: f32,
}
// Most of a plane's function over the lamp, where that is `middle` in the lamp's middle.
fn most_over_lamp(middle: f32, n: vec3f) -> f32 {
    return middle + lamp.u.w * abs(dot(n, lamp.u.xyz)) + abs(dot(n, lamp.v.xyz));
}
// How much of a pixel about its middle lies on the inner side of the edge from a to b about `n`.
fn within_edge(r: Receiver, n: vec3f, a: vec3f, b: vec3f) -> f32 {
    let inwards = cross(n, b - a);
    let extent = 0.5 * (abs(dot(r.dx, inwards)) + abs(dot(r.dy, inwards)));
    return clamp(dot(r.x - a, inwards) / max(extent, 1e-30), 0.0, 1.0);
}
fn looking(r: Receiver) -> Looking {
    var k: Looking;
    k.to = lamp.centre.xyz - lamp.centre.w * r.x;
    k.tolerance = light.tolerance * length(r.x);
    let up = cross(r.dx, r.dy);
    k.over = select(-up, up, dot(up, r.n) > 0.0);
    let sides = lamp.u.w * abs(dot(k.over, lamp.u.xyz)) + abs(dot(k.over, lamp.v.xyz));
    k.level = select(-1e30, k.tolerance * length(k.over), dot(k.over, k.to) > sides);
    if (r.on != NOBODY) {
        let o = occluder(r.on);
        k.a = o.a;
        k.b = o.b;
        k.c = o.c;
        let n = o.plane.xyz;
        let height = dot(n, k.to) + lamp.centre.w * (dot(n, r.x) - o.plane.w);
        let facing = select(-1.0, 1.0, height > 0.0);
        let within = min(within_edge(r, n, o.a, o.b), min(within_edge(r, n, o.b, o.c), within_edge(r, n, o.c, o.a)));
        // what a lamp without size lights has no penumbra but what the pixel is wide
        k.within = select(1.0, within, o.open && lamp.u.w != 0.0);
        k.facing = select(0.0, facing, o.open && most_over_lamp(-abs(height), n) < 0.0);
    }
    return k;
}
fn is_corner(k: Looking, v: vec3f) -> bool { return all(k.a == v) || all(k.b == v) || all(k.c == v); }
fn touches(r: Receiver, k: Looking, o: Occluder) -> bool {
    return r.on != NOBODY && (is_corner(k, o.a) || is_corner(k, o.b) || is_corner(k, o.c));
}
// Whether a place lies beyond the edge from a to b of the receiver's triangle, or on it, for all of the
// lamp.
fn is_beyond(k: Looking, a: vec3f, b: vec3f, at: vec3f, x: vec3f) -> bool {
    let n = k.facing * cross(b - a, at - a);
    let to = k.to + lamp.centre.w * (x - a);
    let slack = BEYOND * length(b - a) * length(at - a) * length(to);
    return most_over_lamp(dot(n, to), n) <= slack;
}
fn are_beyond(k: Looking, a: vec3f, b: vec3f, o: Occluder, x: vec3f) -> bool {
    return is_beyond(k, a, b, o.a, x) && is_beyond(k, a, b, o.b, x) && is_beyond(k, a, b, o.c, x);
}
// Whether an edge of the receiver's open triangle has an open occluder that touches that on its other
// side, seen from all of the lamp: what the receiver's plane goes on to beyond the edge is no part of the
// surface, and may lie behind it.
fn is_beside(r: Receiver, k: Looking, o: Occluder) -> bool {
    return k.facing != 0.0 && o.open && touches(r, k, o) && (are_beyond(k, k.a, k.b, o, r.x)
        || are_beyond(k, k.b, k.c, o, r.x) || are_beyond(k, k.c, k.a, o, r.x));
}

// Whether an occluder is in part over the receiver's plane, if all of the lamp is: nothing else hides.
fn is_over(r: Receiver, k: Looking, o: Occluder) -> bool {
    return max(dot(o.a - r.x, k.over), max(dot(o.b - r.x, k.over), dot(o.c - r.x, k.over))) > k.level;
}

// How a receiver sees an occluder: whether it may be hidden by it, from which side, and whether from
// all over the pixel (1), its middle (0), or so much of it.
struct Aspect { counts: bool, side: f32, moves: f32, apart: f32 }
fn aspect(r: Receiver, k: Looking, o: Occluder) -> Aspect {
    let n = o.plane.xyz;
    let height = o.plane.w - dot(n, r.x);
    let against = !o.open && abs(height) <= k.tolerance && dot(n, r.n) < AGAINST;
    let side = select(-1.0, 1.0, height > 0.0 && !against);
    let above = select(-height, abs(height), o.open);
    let apart = side * (dot(n, k.to) - lamp.centre.w * height);
    let extent = lamp.u.w * abs(dot(n, lamp.u.xyz)) + abs(dot(n, lamp.v.xyz));
    var counts = (above > k.tolerance || against) && apart + extent > 0.0;
    let passes = abs(height) < abs(dot(n, r.dx)) + abs(dot(n, r.dy));
    // seen edge-on, a face would seem to hide what lies on its other side
    if (passes && !against) {
        counts = counts && max(dot(o.a - r.x, k.to), max(dot(o.b - r.x, k.to), dot(o.c - r.x, k.to))) > 0.0;
    }
    counts = counts && (against || is_over(r, k, o));
    var moves = select(1.0, k.within, o.open && touches(r, k, o));
    if (o.open && passes && abs(dot(n, r.n)) > BESIDE) { moves = 0.0; }
    return Aspect(counts, side, moves, apart);
}

// Most of what an edge's function is over lamp and pixel.
fn most(k: Looking, normal: vec3f, way: vec3f, dx: vec3f, dy: vec3f) -> f32 {
    let turned = cross(k.to, way) - lamp.centre.w * normal;
    return dot(normal, k.to) + lamp.u.w * abs(dot(normal, lamp.u.xyz)) + abs(dot(normal, lamp.v.xyz))
        + 0.5 * (abs(dot(turned, dx)) + abs(dot(turned, dy)));
}
// Whether it may hide any of the samples.
fn may_hide(r: Receiver, k: Looking, o: Occluder, s: Aspect) -> bool {
    if (!s.counts) { return false; }
    let a = o.a - r.x;
    let b = o.b - r.x;
    let c = o.c - r.x;
    let dx = s.moves * r.dx;
    let dy = s.moves * r.dy;
    return most(k, s.side * cross(a, b), s.side * (b - a), dx, dy) >= 0.0
        && most(k, s.side * cross(b, c), s.side * (c - b), dx, dy) >= 0.0
        && most(k, s.side * cross(c, a), s.side * (a - c), dx, dy) >= 0.0;
}

fn both(a: Samples, b: Samples) -> Samples {
    return Samples(a.rows0 & b.rows0, a.rows1 & b.rows1, a.rows2 & b.rows2, a.rows3 & b.rows3);
}
fn either(a: Samples, b: Samples) -> Samples {
    return Samples(a.rows0 | b.rows0, a.rows1 | b.rows1, a.rows2 | b.rows2, a.rows3 | b.rows3);
}
// The samples that it hides.
fn hidden_by(r: Receiver, k: Looking, o: Occluder, s: Aspect) -> Samples {
    let a = o.a - r.x;
    let b = o.b - r.x;
    let c = o.c - r.x;
    let dx = s.moves * r.dx;
    let dy = s.moves * r.dy;
    var found = samples_of(lamp, k.to, s.side * cross(a, b), s.side * (b - a), dx, dy);
    found = both(found, samples_of(lamp, k.to, s.side * cross(b, c), s.side * (c - b), dx, dy));
    found = both(found, samples_of(lamp, k.to, s.side * cross(c, a), s.side * (a - c), dx, dy));
    // of what goes on behind the lamp's plane only samples beyond the face's own plane
    if (lamp.u.w != 0.0 && is_near() && min(ahead(o.a), min(ahead(o.b), ahead(o.c))) < light.axis.w) {
        found = both(found, samples_beyond(s, o.plane.xyz));
    }
    return found;
}
fn samples_beyond(s: Aspect, n: vec3f) -> Samples {
    let a = s.side * dot(n, lamp.u.xyz);
    let b = s.side * dot(n, lamp.v.xyz);
    let slope = STEP_A * vec2f(a, -a) + STEP_B * b;
    let inverse = select(vec2f(-1e30), -1.0 / slope, slope != vec2f(0.0));
    let falling = select(vec2u(0u), vec2u(0xffffffffu), slope < vec2f(0.0));
    return Samples(
        inside_edge(s.apart, a, b, 0.0, inverse.x, falling.x, ROWS0),
        inside_edge(s.apart, a, b, 0.0, inverse.x, falling.x, ROWS1),
        inside_edge(s.apart, -a, b, 0.0, inverse.y, falling.y, ROWS2),
        inside_edge(s.apart, -a, b, 0.0, inverse.y, falling.y, ROWS3),
    );
}
