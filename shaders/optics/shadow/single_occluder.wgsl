// What a receiver sees of single occluders. The NumPy form is `edge_functions` in gpusim/optics/shadow/brute_force.py.
#import lib/shadow/sample_mask
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
    slack: f32,
    level: f32,
    // the triangle that it lies on, if that is of an open surface; how much of the pixel about its middle
    // lies within it
    own: Occluder,
    within: f32,
}
// Most of a plane's function over the lamp, where that is `middle` in the lamp's middle.
fn most_over_lamp(middle: f32, n: vec3f) -> f32 {
    return middle + lamp.u.w * abs(dot(n, lamp.u.xyz)) + abs(dot(n, lamp.v.xyz));
}
fn lamp_height(plane: vec4f) -> f32 { return dot(plane.xyz, lamp.centre.xyz) - lamp.centre.w * plane.w; }

// How much of a pixel about its middle lies on the inner side of the edge from a to b about `n`.
fn within_edge(r: Receiver, n: vec3f, a: vec3f, b: vec3f) -> f32 {
    let inwards = cross(n, b - a);
    let extent = 0.5 * (abs(dot(r.dx, inwards)) + abs(dot(r.dy, inwards)));
    return clamp(dot(r.x - a, inwards) / max(extent, 1e-30), 0.0, 1.0);
}
fn open_triangle(on: u32) -> Occluder {
    var own = occluder(select(on, 0u, on == NOBODY));
    own.open = own.open && on != NOBODY;
    return own;
}
fn looking(r: Receiver) -> Looking {
    var k: Looking;
    k.to = lamp.centre.xyz - lamp.centre.w * r.x;
    k.tolerance = light.tolerance * length(r.x);
    let up = cross(r.dx, r.dy);
    k.over = select(-up, up, dot(up, r.n) > 0.0);
    let sides = lamp.u.w * abs(dot(k.over, lamp.u.xyz)) + abs(dot(k.over, lamp.v.xyz));
    k.slack = k.tolerance * length(k.over);
    k.level = select(-1e30, k.slack, dot(k.over, k.to) > sides);
    let own = open_triangle(r.on);
    let n = own.plane.xyz;
    let within = min(within_edge(r, n, own.a, own.b), min(within_edge(r, n, own.b, own.c), within_edge(r, n, own.c, own.a)));
    // what a lamp without size lights has no penumbra but what the pixel is wide
    k.within = select(1.0, within, own.open && lamp.u.w != 0.0);
    k.own = own;
    return k;
}
fn is_corner(o: Occluder, v: vec3f) -> bool { return all(o.a == v) || all(o.b == v) || all(o.c == v); }
fn touch(own: Occluder, o: Occluder) -> bool {
    return own.open && o.open && (is_corner(own, o.a) || is_corner(own, o.b) || is_corner(own, o.c));
}

// Whether a triangle lies before an open occluder's plane, as all of the lamp does.
fn is_before(own: Occluder, o: Occluder) -> bool {
    let height = lamp_height(o.plane);
    let n = select(-o.plane, o.plane, height > 0.0);
    let least = min(dot(n.xyz, own.a), min(dot(n.xyz, own.b), dot(n.xyz, own.c))) - n.w;
    return most_over_lamp(-abs(height), n.xyz) < 0.0 && least >= -light.tolerance * length(own.a);
}
// Whether a place lies beyond the edge from a to b of a triangle that faces the lamp so, for all of that,
// or on it.
fn is_beyond(facing: f32, a: vec3f, b: vec3f, at: vec3f) -> bool {
    let n = facing * cross(b - a, at - a);
    let to = lamp.centre.xyz - lamp.centre.w * a;
    let slack = BEYOND * length(b - a) * length(at - a) * length(to);
    return most_over_lamp(dot(n, to), n) <= slack;
}
fn are_beyond(facing: f32, a: vec3f, b: vec3f, o: Occluder) -> bool {
    return is_beyond(facing, a, b, o.a) && is_beyond(facing, a, b, o.b) && is_beyond(facing, a, b, o.c);
}
// Whether an open occluder hides nothing of an open triangle: that lies before it, or touches it on the
// other side of an edge, seen from all of the lamp. What a receiver's plane goes on to beyond its triangle
// is no part of the surface, and may lie behind the next ones.
fn is_beside(own: Occluder, o: Occluder) -> bool {
    let height = lamp_height(own.plane);
    let facing = select(-1.0, 1.0, height > 0.0);
    let parted = most_over_lamp(-abs(height), own.plane.xyz) < 0.0 && touch(own, o)
        && (are_beyond(facing, own.a, own.b, o) || are_beyond(facing, own.b, own.c, o)
            || are_beyond(facing, own.c, own.a, o));
    return own.open && o.open && (parted || is_before(own, o));
}

// Whether an occluder is in part over the receiver's plane, if all of the lamp is: nothing else hides.
fn is_over(r: Receiver, k: Looking, o: Occluder) -> bool {
    return max(dot(o.a - r.x, k.over), max(dot(o.b - r.x, k.over), dot(o.c - r.x, k.over))) > k.level;
}

// How a receiver sees an occluder: whether it may be hidden by it, from which side, and whether from
// all over the pixel (1), its middle (0), or so much of it. `beyond`: what has to be positive so that the
// plane is between pixel and lamp: in the middle of both, and its change along the lamp or over the pixel.
struct Aspect { counts: bool, side: f32, moves: f32, beyond: f32, along_lamp: vec2f, over_pixel: vec2f }
fn aspect(r: Receiver, k: Looking, o: Occluder) -> Aspect {
    let n = o.plane.xyz;
    let height = o.plane.w - dot(n, r.x);
    let against = !o.open && abs(height) <= k.tolerance && dot(n, r.n) < AGAINST;
    let passes = abs(height) < abs(dot(n, r.dx)) + abs(dot(n, r.dy));
    // a sheet that is bent within the pixel
    let bent = k.own.open && k.own.sheet == o.sheet && passes && abs(dot(n, r.n)) > BESIDE;
    let moves = select(select(1.0, k.within, touch(k.own, o)), 0.0, bent);
    let change = moves * vec2f(dot(n, r.dx), dot(n, r.dy));
    let over_plane = dot(n, k.to) - lamp.centre.w * height;
    let along_lamp = vec2f(lamp.u.w * dot(n, lamp.u.xyz), dot(n, lamp.v.xyz));
    let extent = abs(along_lamp.x) + abs(along_lamp.y);
    let least = lamp.centre.w * on_face();
    // of a pixel that the plane of what is above it parts, what is on the other side than the lamp
    let parted = passes && moves > 0.0 && abs(over_plane) > extent + least
        && min(dot(o.a - r.x, k.over), min(dot(o.b - r.x, k.over), dot(o.c - r.x, k.over))) > k.slack;
    let side = select(-1.0, 1.0, select(height > 0.0 && !against, over_plane > 0.0, parted));
    let most_beyond = side * height + select(0.0, 0.5 * (abs(change.x) + abs(change.y)), parted);
    var counts = (most_beyond > k.tolerance && (o.open || side < 0.0)) || against;
    counts = counts && side * over_plane + extent > least;
    // seen edge-on, a face would seem to hide what lies on its other side
    if (passes && !against && !parted) {
        counts = counts && max(dot(o.a - r.x, k.to), max(dot(o.b - r.x, k.to), dot(o.c - r.x, k.to))) > 0.0;
    }
    counts = counts && (against || is_over(r, k, o));
    return Aspect(
        counts, side, moves, side * select(over_plane, height, parted),
        select(side * along_lamp, vec2f(0.0), parted), select(vec2f(0.0), -side * change, parted),
    );
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
    // of what goes on behind the lamp's plane, or passes through the pixel, only samples beyond it
    let behind = min(ahead(o.a), min(ahead(o.b), ahead(o.c))) < light.axis.w;
    let parted = any(s.over_pixel != vec2f(0.0));
    // & and not &&: lavapipe compiles a program anew, at each dispatch, with the values of uniforms that
    // branches of it depend on alone
    if (((lamp.u.w != 0.0) & is_near() & behind) | parted) {
        found = both(found, samples_inside(lamp, s.beyond, s.along_lamp, s.over_pixel));
    }
    return found;
}
