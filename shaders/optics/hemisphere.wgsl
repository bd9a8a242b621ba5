// Which directions of the hemisphere over a point the faces around it hide: a mask of 64 rows of 32
// samples, all of the same share of a matte face's light. The NumPy form is
// gpusim/optics/hemisphere.py, which explains it.
#import common/texel

// For four rows at a time cosine and sine of their azimuth, and the place of their first sample.
struct Rows {
    cosine: array<vec4f, 16>,
    sine: array<vec4f, 16>,
    start: array<vec4f, 16>,
    tilt: f32,
    turn: f32,
}
struct Params {
    count: u32,
    groups: u32,
    rows: Rows,
}
@group(0) @binding(0) var<uniform> params: Params;
// per point (position, tolerance), (unit normal, thickness), (unit tangent, -)
@group(0) @binding(1) var<storage, read> points: array<vec4f>;
// two texels per edge: where it begins and ends; twice the face on its left and on its right, plus
// one where the face hides on both sides
@group(0) @binding(2) var edges: texture_2d<u32>;
// per face (unit normal outward, product of that with a point of it), (middle and radius of a ball
// around it)
@group(0) @binding(3) var planes: texture_2d<u32>;
// per face twice the number of each edge, plus one where the face is on its right
@group(0) @binding(4) var borders: texture_2d<u32>;
// where the list of edges of each group of points begins, the same of its faces, and the lists
@group(0) @binding(5) var<storage, read> lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> masks: array<u32>;
// times that the way along the normal leaves a body less those that it enters one, and `TOUCHES` for
// each face that the point lies on
@group(0) @binding(7) var<storage, read_write> leaves: array<i32>;

const GROUP: u32 = 16u;  // points that share lists
const PARTS: u32 = 8u;   // invocations per point, of eight rows each
const FAR: f32 = 1e9;
const TOUCHES: i32 = 65536;
const NONE: u32 = 0xffffffffu;

// A point, with its axes: tangent, across, normal.
struct Point {
    at: vec3f,
    tolerance: f32,
    u: vec3f,
    v: vec3f,
    n: vec3f,
    thickness: f32,
}
// An edge as a point sees it: its ends and its plane along the point's axes, and its faces.
struct Edge {
    a: vec3f,
    b: vec3f,
    plane: vec3f,
    faces: vec2u,
}
fn along(p: Point, x: vec3f) -> vec3f {
    let d = x - p.at;
    return vec3f(dot(d, p.u), dot(d, p.v), dot(d, p.n));
}
fn edge_of(p: Point, number: u32) -> Edge {
    let first = textureLoad(edges, texel(2u * number), 0);
    let last = textureLoad(edges, texel(2u * number + 1u), 0);
    let a = along(p, bitcast<vec3f>(first.xyz));
    let b = along(p, bitcast<vec3f>(last.xyz));
    return Edge(a, b, cross(a, b), vec2u(first.w, last.w));
}

// How far a point lies behind a face, the cosine of their normals, and how the face hides: -1 by its
// outside, 1 by its inside, 0 not at all. The same numbers wherever it is asked, or what encloses an
// area would not close.
struct Face {
    height: f32,
    facing: f32,
    hides: i32,
}
fn face_of(p: Point, code: u32) -> Face {
    if (code == NONE) { return Face(0.0, 0.0, 0); }
    let plane = bitcast<vec4f>(textureLoad(planes, texel(2u * (code >> 1u)), 0));
    let height = fma(-plane.x, p.at.x, fma(-plane.y, p.at.y, fma(-plane.z, p.at.z, plane.w)));
    let facing = fma(plane.x, p.n.x, fma(plane.y, p.n.y, plane.z * p.n.z));
    let closed = (code & 1u) == 0u;
    let against = closed && abs(height) <= p.tolerance && facing < -0.5;
    let behind = !closed && height > p.tolerance;
    return Face(
        height, facing, select(select(0, 1, behind), -1, against || height < -p.tolerance)
    );
}

// Of an edge and four rows: whether half circles through them cross it, whether they leave the side
// on its left, and its plane at their starts and along them.
struct Crossing {
    crossed: vec4<bool>,
    leaves: vec4<bool>,
    value: vec4f,
    slope: vec4f,
}
fn crossing(e: Edge, k: u32) -> Crossing {
    let c = params.rows.cosine[k];
    let s = params.rows.sine[k];
    let tilt = params.rows.tilt;
    let turn = params.rows.turn;
    let a = c * (e.a.y - turn * e.a.x) - s * (e.a.x + turn * e.a.y) + tilt * e.a.z;
    let b = c * (e.b.y - turn * e.b.x) - s * (e.b.x + turn * e.b.y) + tilt * e.b.z;
    let left = a < vec4f(0.0);
    let to_left = b < vec4f(0.0);
    let across = e.plane.y * c - e.plane.x * s;
    let value = e.plane.z - tilt * across;
    let slope = e.plane.x * c + e.plane.y * s + turn * across;
    let out = value >= vec4f(0.0);
    return Crossing(select(to_left & !left, left & !to_left, out), out, value, slope);
}

fn bits_from(n: vec4f) -> vec4u {
    let first = vec4u(ceil(clamp(n, vec4f(0.0), vec4f(32.0))));
    return select(vec4u(0xffffffffu) << (first & vec4u(31u)), vec4u(0u), first >= vec4u(32u));
}

// Where along a row, in samples from its first one, a direction of parameter t lies.
fn sample_at(t: vec4f, start: vec4f) -> vec4f {
    let tilt = params.rows.tilt;
    let turn = params.rows.turn;
    let square = 1.0 + tilt * tilt + t * (t * (1.0 + turn * turn) - 2.0 * turn * tilt);
    return select(32.0 * (1.0 - 1.0 / square) - start, vec4f(0.0), t <= vec4f(0.0));
}

// Numbers of eight bits, one per sample of four rows: bit k of all of them is d[k].
struct Count {
    d0: vec4u, d1: vec4u, d2: vec4u, d3: vec4u, d4: vec4u, d5: vec4u, d6: vec4u, d7: vec4u,
}
// Adds one (or takes one off, where `less` has all bits) at the samples `ones`, two at `twos`.
fn add(count: ptr<function, Count>, ones: vec4u, twos: vec4u, less: vec4u) {
    var carry = ones;
    var digit = (*count).d0;
    (*count).d0 = digit ^ carry;
    carry = (carry & (digit ^ less)) | twos;
    digit = (*count).d1;
    (*count).d1 = digit ^ carry;
    carry &= digit ^ less;
    if (all(carry == vec4u(0u))) { return; }
    digit = (*count).d2;
    (*count).d2 = digit ^ carry;
    carry &= digit ^ less;
    digit = (*count).d3;
    (*count).d3 = digit ^ carry;
    carry &= digit ^ less;
    digit = (*count).d4;
    (*count).d4 = digit ^ carry;
    carry &= digit ^ less;
    digit = (*count).d5;
    (*count).d5 = digit ^ carry;
    carry &= digit ^ less;
    digit = (*count).d6;
    (*count).d6 = digit ^ carry;
    carry &= digit ^ less;
    (*count).d7 ^= carry;
}
// Where numbers are above 0.
fn above(c: Count) -> vec4u {
    return (c.d0 | c.d1 | c.d2 | c.d3 | c.d4 | c.d5 | c.d6) & ~c.d7;
}

// Adds what crossing an edge changes along four rows; it has `weight` faces more on its left.
fn cross_edge(count: ptr<function, Count>, e: Edge, weight: i32, k: u32) {
    let found = crossing(e, k);
    // what is beyond the horizon doesn't count
    let outward = select(found.slope > vec4f(0.0), found.slope < vec4f(0.0), found.leaves);
    let crossed = found.crossed & outward;
    if (!any(crossed)) { return; }
    let t = min(-found.value / select(vec4f(1.0), found.slope, crossed), vec4f(FAR));
    let bits = select(vec4u(0u), bits_from(sample_at(t, params.rows.start[k])), crossed);
    let less = select(vec4u(0u), vec4u(NONE), found.leaves == vec4<bool>(weight > 0));
    if (abs(weight) == 1) {
        add(count, bits, vec4u(0u), less);
    } else {
        add(count, vec4u(0u), bits, less);
    }
}

// Whether an edge of the list may matter to a point.
fn contour(p: Point, number: u32) -> bool {
    let first = textureLoad(edges, texel(2u * number), 0);
    let last = textureLoad(edges, texel(2u * number + 1u), 0);
    let low = dot(bitcast<vec3f>(first.xyz) - p.at, p.n) <= 0.0
        && dot(bitcast<vec3f>(last.xyz) - p.at, p.n) <= 0.0;
    return !low && face_of(p, first.w).hides != face_of(p, last.w).hides;
}
// Whether a face of the list may touch a point, or lie on the way along its normal or where rows
// begin.
fn upward(p: Point, code: u32) -> bool {
    let ball = bitcast<vec4f>(textureLoad(planes, texel(2u * (code >> 1u) + 1u), 0));
    let to = ball.xyz - p.at;
    let height = dot(to, p.n);
    let reach = ball.w + p.tolerance;
    let wide = 1.01 * (reach + params.rows.tilt * max(height + reach, 0.0));
    return height + reach >= 0.0 && dot(to, to) - height * height <= wide * wide;
}

// Adds what a face covers where rows begin, and returns what it means for the way along the normal.
fn add_face(count0: ptr<function, Count>, count1: ptr<function, Count>, p: Point, code: u32, own: u32) -> i32 {
    let face = face_of(p, code);
    let border = textureLoad(borders, texel(code >> 1u), 0);
    let normal = bitcast<vec4f>(textureLoad(planes, texel(2u * (code >> 1u)), 0)).xyz;
    let facing = vec3f(dot(normal, p.u), dot(normal, p.v), dot(normal, p.n));
    var before0 = vec4i(0);
    var before1 = vec4i(0);
    var over = true;
    var under = true;
    var on = true;
    for (var k = 0u; k < 4u; k++) {
        if (border[k] == NONE) { continue; }
        let e = edge_of(p, border[k] >> 1u);
        let sign = 1 - 2 * i32(border[k] & 1u);
        let plane = f32(sign) * e.plane;
        over = over && plane.z >= 0.0;
        under = under && plane.z <= 0.0;
        on = on && dot(plane, facing) >= -2.0 * p.tolerance * length(e.b - e.a);
        if (face.hides != 0) {
            let one = crossing(e, 2u * own);
            let two = crossing(e, 2u * own + 1u);
            let turn = sign * face.hides;
            before0 += select(vec4i(0), select(vec4i(turn), vec4i(-turn), one.leaves), one.crossed);
            before1 += select(vec4i(0), select(vec4i(turn), vec4i(-turn), two.leaves), two.crossed);
        }
    }
    let none = vec4u(0u);
    add(count0, select(none, vec4u(NONE), before0 < vec4i(0)), none, none);
    add(count1, select(none, vec4u(NONE), before1 < vec4i(0)), none, none);
    let closed = (code & 1u) == 0u;
    let level = abs(face.height) <= p.tolerance;
    let rise = face.height / select(face.facing, 1.0, face.facing == 0.0);
    var left = 0;
    if (closed && (over || under) && !level && rise > select(0.0, p.thickness, face.height > 0.0)) {
        left = select(-1, 1, face.height > 0.0);
    }
    return left + select(0, TOUCHES, level && face.facing < 0.5 && on);
}

// Per lane which of its 32 entries of a list its point needs.
var<workgroup> needed: array<u32, 128>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32,
        @builtin(num_workgroups) size: vec3u) {
    let group = workgroup.y * size.x + workgroup.x;
    if (group >= params.groups) { return; }
    // lanes beyond the last point repeat it
    let place = lane % GROUP;
    let point = min(group * GROUP + place, params.count - 1u);
    // neighbours see the same edges cross the same rows
    let own = lane / GROUP;
    let x = points[3u * point];
    let n = points[3u * point + 1u];
    let u = points[3u * point + 2u].xyz;
    let p = Point(x.xyz, x.w, u, cross(n.xyz, u), n.xyz, n.w);
    var count0 = Count();
    var count1 = Count();
    var left = 0;
    let faces = params.groups + 1u + group;
    // lanes of a point share out the lists; then each looks at what is left of all of them
    let last_face = lists[faces + 1u];
    for (var begin = lists[faces]; begin < last_face; begin += 32u * PARTS) {
        var bits = 0u;
        for (var k = 0u; k < 32u; k++) {
            let i = begin + PARTS * k + own;
            if (i >= last_face) { break; }
            if (upward(p, lists[i])) { bits |= 1u << k; }
        }
        workgroupBarrier();
        needed[lane] = bits;
        workgroupBarrier();
        for (var part = 0u; part < PARTS; part++) {
            var rest = needed[part * GROUP + place];
            while (rest != 0u) {
                let i = begin + PARTS * countTrailingZeros(rest) + part;
                rest &= rest - 1u;
                left += add_face(&count0, &count1, p, lists[i], own);
            }
        }
    }
    let last_edge = lists[group + 1u];
    for (var begin = lists[group]; begin < last_edge; begin += 32u * PARTS) {
        var bits = 0u;
        for (var k = 0u; k < 32u; k++) {
            let i = begin + PARTS * k + own;
            if (i >= last_edge) { break; }
            if (contour(p, lists[i])) { bits |= 1u << k; }
        }
        workgroupBarrier();
        needed[lane] = bits;
        workgroupBarrier();
        for (var part = 0u; part < PARTS; part++) {
            var rest = needed[part * GROUP + place];
            while (rest != 0u) {
                let e = edge_of(p, lists[begin + PARTS * countTrailingZeros(rest) + part]);
                rest &= rest - 1u;
                let weight = face_of(p, e.faces.x).hides - face_of(p, e.faces.y).hides;
                cross_edge(&count0, e, weight, 2u * own);
                cross_edge(&count1, e, weight, 2u * own + 1u);
            }
        }
    }
    if (group * GROUP + place >= params.count) { return; }
    let at = 64u * point + 8u * own;
    let hidden0 = above(count0);
    let hidden1 = above(count1);
    for (var k = 0u; k < 4u; k++) {
        masks[at + k] = hidden0[k];
        masks[at + 4u + k] = hidden1[k];
    }
    if (own == 0u) { leaves[point] = left; }
}
