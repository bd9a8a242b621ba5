// Which directions of the hemisphere over a point the faces around it hide: a mask of 64 rows of 32
// samples, all of the same share of a matte face's light. The NumPy form is
// gpusim/optics/ambient/hemisphere_mask.py, which explains it. A workgroup looks at one point, a lane at every
// 64th face and edge of its lists, and at the end at one row.
#import lib/numeric/texel

struct Params {
    count: u32,
    most_edges: u32,    // in the list of a point
    most_faces: u32,
    tilt: f32,
    turn: f32,
    // per row cosine and sine of its azimuth, and the place of its first sample
    rows: array<vec4f, 64>,
}
@group(0) @binding(0) var<uniform> params: Params;
// per point (position, tolerance), (unit normal, thickness), (unit tangent, -)
@group(0) @binding(1) var<storage, read> points: array<vec4f>;
// two texels per edge: where it begins and ends; twice the face on its left and on its right, plus
// one where the face hides on both sides
@group(0) @binding(2) var edges: texture_storage_2d<rgba32uint, read>;
// per face its unit normal outward, and the product of that with a point of it
@group(0) @binding(3) var planes: texture_storage_2d<rgba32uint, read>;
// per face twice the number of each edge, plus one where the face is on its right
@group(0) @binding(4) var borders: texture_storage_2d<rgba32uint, read>;
// how many edges and faces a point needs, and the lists of them (optics/ambient/silhouette_search)
@group(0) @binding(5) var<storage, read> counts: array<vec2u>;
@group(0) @binding(6) var<storage, read> needed: array<u32>;
@group(0) @binding(9) var<storage, read> faces: array<u32>;
@group(0) @binding(7) var<storage, read_write> masks: array<u32>;
// times that the way along the normal leaves a body less those that it enters one, and `TOUCHES` for
// each face that the point lies on
@group(0) @binding(8) var<storage, read_write> leaves: array<i32>;

const LANES: u32 = 64u;
const ROWS: i32 = 64;
const COLUMNS: u32 = 32u;
const FAR: f32 = 1e9;
const TOUCHES: i32 = 65536;
const NONE: u32 = 0xffffffffu;
const ROW: f32 = 0.09817477;    // radians between rows

// A point, with its axes: tangent, across, normal.
struct Point {
    at: vec3f,
    tolerance: f32,
    u: vec3f,
    v: vec3f,
    n: vec3f,
    thickness: f32,
}
fn along(p: Point, x: vec3f) -> vec3f {
    let d = x - p.at;
    return vec3f(dot(d, p.u), dot(d, p.v), dot(d, p.n));
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
    let plane = bitcast<vec4f>(textureLoad(planes, texel(code >> 1u)));
    let height = fma(-plane.x, p.at.x, fma(-plane.y, p.at.y, fma(-plane.z, p.at.z, plane.w)));
    let facing = fma(plane.x, p.n.x, fma(plane.y, p.n.y, plane.z * p.n.z));
    let closed = (code & 1u) == 0u;
    let against = closed && abs(height) <= p.tolerance && facing < -0.5;
    let behind = !closed && height > p.tolerance;
    return Face(
        height, facing, select(select(0, 1, behind), -1, against || height < -p.tolerance)
    );
}

// Of an edge and a row: whether a half circle through the row crosses it, whether that leaves the side
// on its left, and its plane at the row's start and along it.
struct Crossing {
    crossed: bool,
    leaves: bool,
    value: f32,
    slope: f32,
}
fn crossing(a: vec3f, b: vec3f, plane: vec3f, row: vec4f) -> Crossing {
    let c = row.x;
    let s = row.y;
    let turn = params.turn;
    let left = c * (a.y - turn * a.x) - s * (a.x + turn * a.y) + params.tilt * a.z < 0.0;
    let to_left = c * (b.y - turn * b.x) - s * (b.x + turn * b.y) + params.tilt * b.z < 0.0;
    let across = plane.y * c - plane.x * s;
    let value = plane.z - params.tilt * across;
    let slope = plane.x * c + plane.y * s + turn * across;
    let out = value >= 0.0;
    return Crossing(select(to_left && !left, left && !to_left, out), out, value, slope);
}

// The first row that may cross an edge, and how many.
fn rows_of(a: vec3f, b: vec3f) -> vec2i {
    let way = b.xy - a.xy;
    let t = clamp(-dot(a.xy, way) / max(dot(way, way), 1e-30), 0.0, 1.0);
    // an edge that passes the cone of the rows' starts may cross any
    let rise = params.tilt * max(abs(a.z), abs(b.z));
    if (length(a.xy + t * way) <= 1.05 * rise) { return vec2i(0, ROWS); }
    let steep = params.tilt * inverseSqrt(1.0 + params.turn * params.turn);
    let aside = asin(clamp(steep * vec2f(a.z, b.z) / vec2f(length(a.xy), length(b.xy)), vec2f(-1.0), vec2f(1.0)));
    let begin = atan2(a.y, a.x) - atan(params.turn) + aside.x;
    let sweep = atan2(a.x * b.y - a.y * b.x, dot(a.xy, b.xy)) + aside.y - aside.x;
    // angles are told only roughly
    let first = i32(ceil(min(begin, begin + sweep) / ROW - 0.2));
    let last = i32(floor(max(begin, begin + sweep) / ROW + 0.2));
    return vec2i(first, clamp(last - first + 1, 0, ROWS));
}

// The first sample of a row at or beyond a direction of parameter t.
fn sample_at(t: f32, start: f32) -> u32 {
    let tilt = params.tilt;
    let turn = params.turn;
    let square = 1.0 + tilt * tilt + t * (t * (1.0 + turn * turn) - 2.0 * turn * tilt);
    let place = select(32.0 * (1.0 - 1.0 / square) - start, 0.0, t <= 0.0);
    return u32(ceil(clamp(place, 0.0, 32.0)));
}

// How many more faces lie before a sample than before the one before it, in rows of 33.
var<workgroup> change: array<atomic<i32>, 2112>;
var<workgroup> left: atomic<i32>;

// An edge: what crossing it changes.
fn add_edge(p: Point, number: u32) {
    let first = textureLoad(edges, texel(2u * number));
    let last = textureLoad(edges, texel(2u * number + 1u));
    let a = along(p, bitcast<vec3f>(first.xyz));
    let b = along(p, bitcast<vec3f>(last.xyz));
    if (a.z <= 0.0 && b.z <= 0.0) { return; }
    let weight = face_of(p, first.w).hides - face_of(p, last.w).hides;
    if (weight == 0) { return; }
    let plane = cross(a, b);
    let own = rows_of(a, b);
    for (var k = 0; k < own.y; k++) {
        let number = u32((own.x + k) & (ROWS - 1));
        let row = params.rows[number];
        let found = crossing(a, b, plane, row);
        // what is beyond the horizon doesn't count
        if (!found.crossed || !select(found.slope > 0.0, found.slope < 0.0, found.leaves)) { continue; }
        let at = sample_at(min(-found.value / found.slope, FAR), row.z);
        if (at < COLUMNS) {
            atomicAdd(&change[33u * number + at], select(weight, -weight, found.leaves));
        }
    }
}

// A face: where rows begin before it, and what it means for the way along the normal.
fn add_face(p: Point, number: u32) {
    let border = textureLoad(borders, texel(number));
    var code = NONE;
    for (var k = 0u; k < 4u; k++) {
        if (border[k] != NONE) { code = textureLoad(edges, texel(border[k])).w; }
    }
    let face = face_of(p, code);
    let normal = bitcast<vec4f>(textureLoad(planes, texel(number))).xyz;
    let facing = vec3f(dot(normal, p.u), dot(normal, p.v), dot(normal, p.n));
    var a: array<vec3f, 4>;
    var b: array<vec3f, 4>;
    var plane: array<vec3f, 4>;
    var over = true;
    var under = true;
    var on = true;
    for (var k = 0u; k < 4u; k++) {
        if (border[k] == NONE) { continue; }
        let number = border[k] & 0xfffffffeu;
        a[k] = along(p, bitcast<vec3f>(textureLoad(edges, texel(number)).xyz));
        b[k] = along(p, bitcast<vec3f>(textureLoad(edges, texel(number + 1u)).xyz));
        plane[k] = cross(a[k], b[k]);
        let outward = plane[k] * f32(1 - 2 * i32(border[k] & 1u));
        over = over && outward.z >= 0.0;
        under = under && outward.z <= 0.0;
        on = on && dot(outward, facing) >= -2.0 * p.tolerance * length(b[k] - a[k]);
    }
    for (var row = 0u; row < u32(ROWS) && face.hides != 0; row++) {
        var before = 0;
        for (var k = 0u; k < 4u; k++) {
            if (border[k] == NONE) { continue; }
            let found = crossing(a[k], b[k], plane[k], params.rows[row]);
            let turn = face.hides * (1 - 2 * i32(border[k] & 1u));
            before += select(0, select(turn, -turn, found.leaves), found.crossed);
        }
        if (before < 0) { atomicAdd(&change[33u * row], 1); }
    }
    let closed = (code & 1u) == 0u;
    let level = abs(face.height) <= p.tolerance;
    let rise = face.height / select(face.facing, 1.0, face.facing == 0.0);
    if (closed && (over || under) && !level && rise > select(0.0, p.thickness, face.height > 0.0)) {
        atomicAdd(&left, select(-1, 1, face.height > 0.0));
    }
    // a sheet that looks the other way is the point's own, from its other side
    let across = face.facing < 0.5 && (closed || face.facing > -0.5);
    if (level && across && on) { atomicAdd(&left, TOUCHES); }
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32,
        @builtin(num_workgroups) size: vec3u) {
    let point = workgroup.y * size.x + workgroup.x;
    if (point >= params.count) { return; }
    let x = points[3u * point];
    let n = points[3u * point + 1u];
    let u = points[3u * point + 2u].xyz;
    let p = Point(x.xyz, x.w, u, cross(n.xyz, u), n.xyz, n.w);
    for (var k = 0u; k < 33u; k++) { atomicStore(&change[33u * lane + k], 0); }
    if (lane == 0u) { atomicStore(&left, 0); }
    workgroupBarrier();
    let many = counts[point];
    for (var i = lane; i < many.y; i += LANES) { add_face(p, faces[point * params.most_faces + i]); }
    for (var i = lane; i < many.x; i += LANES) { add_edge(p, needed[point * params.most_edges + i]); }
    workgroupBarrier();
    var before = 0;
    var hidden = 0u;
    for (var k = 0u; k < COLUMNS; k++) {
        before += atomicLoad(&change[33u * lane + k]);
        hidden |= select(0u, 1u << k, before > 0);
    }
    masks[64u * point + lane] = hidden;
    if (lane == 0u) { leaves[point] = atomicLoad(&left); }
}
