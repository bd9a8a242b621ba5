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
    first: u32,
    faces: u32,
    group: u32,
    above: f32,
    rows: Rows,
}
@group(0) @binding(0) var<uniform> params: Params;
// per point (position, tolerance), (unit normal, thickness), (unit tangent, -)
@group(0) @binding(1) var<storage, read> points: array<vec4f>;
// four corners per face, the first one's w is 1 if its inside hides as well
@group(0) @binding(2) var around: texture_2d<f32>;
// where the list of each group of points begins, and the lists of faces
@group(0) @binding(5) var<storage, read> lists: array<u32>;
@group(0) @binding(3) var<storage, read_write> masks: array<u32>;
// times that the way along the normal leaves a body less those that it enters one, and `TOUCHES` for
// each face that the point lies on
@group(0) @binding(4) var<storage, read_write> leaves: array<i32>;

const PARTS: u32 = 8u;   // invocations per point, of eight rows each
const FAR: f32 = 1e9;
const TOUCHES: i32 = 65536;

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

// Where rows are inside, by their parameter.
struct Span {
    low: vec4f,
    high: vec4f,
}
// What an edge leaves of four rows with azimuths (c, s): inside is where up + x c + y s >= 0.
fn cut_rows(span: Span, up: f32, x: f32, y: f32, c: vec4f, s: vec4f) -> Span {
    let across = y * c - x * s;
    let value = up - params.rows.tilt * across;
    let slope = x * c + y * s + params.rows.turn * across;
    // an edge along a row has all of it on one side
    let cut = -value * select(vec4f(1e30), 1.0 / slope, slope != vec4f(0.0));
    let rising = slope >= vec4f(0.0);
    return Span(
        select(span.low, max(span.low, cut), rising),
        select(min(span.high, cut), span.high, rising),
    );
}

// The samples of four rows inside all edges, as bits.
fn inside(up: vec4f, x: vec4f, y: vec4f, k: u32) -> vec4u {
    let c = params.rows.cosine[k];
    let s = params.rows.sine[k];
    var span = Span(vec4f(0.0), vec4f(FAR));
    span = cut_rows(span, up.x, x.x, y.x, c, s);
    span = cut_rows(span, up.y, x.y, y.y, c, s);
    span = cut_rows(span, up.z, x.z, y.z, c, s);
    span = cut_rows(span, up.w, x.w, y.w, c, s);
    let start = params.rows.start[k];
    let bits = bits_from(sample_at(min(span.low, vec4f(FAR)), start))
        & ~bits_from(sample_at(min(span.high, vec4f(FAR)), start));
    return select(vec4u(0u), bits, span.low < span.high);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let number = gid.y * (groups.x * 64u) + gid.x;
    let point = number / PARTS;
    if (point >= params.count) { return; }
    let own = number % PARTS;
    let x = points[3u * point];
    let n = points[3u * point + 1u];
    let u = points[3u * point + 2u].xyz;
    let v = cross(n.xyz, u);
    var hidden0 = vec4u(0u);
    var hidden1 = vec4u(0u);
    var crossed = 0;
    let begin = lists[point / params.group] + params.first;
    let stop = min(lists[point / params.group + 1u], begin + params.faces);
    for (var i = begin; i < stop; i++) {
        let face = 4u * lists[i];
        let corner = textureLoad(around, texel(face), 0);
        let d0 = corner.xyz - x.xyz;
        let d1 = textureLoad(around, texel(face + 1u), 0).xyz - x.xyz;
        let d2 = textureLoad(around, texel(face + 2u), 0).xyz - x.xyz;
        let d3 = textureLoad(around, texel(face + 3u), 0).xyz - x.xyz;
        let highest = max(max(dot(d0, n.xyz), dot(d1, n.xyz)), max(dot(d2, n.xyz), dot(d3, n.xyz)));
        let n0 = cross(d0, d1);
        let n1 = cross(d1, d2);
        let n2 = cross(d2, d3);
        let n3 = cross(d3, d0);
        let normal = n0 + n1 + n2 + n3;
        let size = length(normal);
        let height = 0.25 * dot(normal, d0 + d1 + d2 + d3);
        let closed = corner.w == 0.0;
        let level = abs(height) <= x.w * size;
        let against = closed && level && dot(normal, n.xyz) < -0.5 * size;
        let faces_it = select(abs(height), -height, closed) > x.w * size;
        let up = vec4f(dot(n0, n.xyz), dot(n1, n.xyz), dot(n2, n.xyz), dot(n3, n.xyz));
        let pierced = all(up >= vec4f(0.0)) || all(up <= vec4f(0.0));
        let rise = height / select(dot(normal, n.xyz), 1.0, dot(normal, n.xyz) == 0.0);
        if (closed && pierced && rise > select(0.0, n.w, height > 0.0) && !level) { crossed += select(-1, 1, height > 0.0); }
        if (level && dot(normal, n.xyz) < 0.5 * size) {
            let within = 2.0 * x.w * size;
            let on = vec4f(
                dot(n0, normal) + within * length(d1 - d0), dot(n1, normal) + within * length(d2 - d1),
                dot(n2, normal) + within * length(d3 - d2), dot(n3, normal) + within * length(d0 - d3),
            );
            if (all(on >= vec4f(0.0))) { crossed += TOUCHES; }
        }
        if (!against && !(faces_it && highest > params.above * x.w)) { continue; }
        let side = select(-1.0, 1.0, height > 0.0 && !against);
        let a = side * vec4f(dot(n0, u), dot(n1, u), dot(n2, u), dot(n3, u));
        let b = side * vec4f(dot(n0, v), dot(n1, v), dot(n2, v), dot(n3, v));
        hidden0 |= inside(side * up, a, b, 2u * own);
        hidden1 |= inside(side * up, a, b, 2u * own + 1u);
    }
    let at = 8u * number;
    for (var k = 0u; k < 4u; k++) {
        masks[at + k] |= hidden0[k];
        masks[at + 4u + k] |= hidden1[k];
    }
    if (own == 0u) { leaves[point] += crossed; }
}
