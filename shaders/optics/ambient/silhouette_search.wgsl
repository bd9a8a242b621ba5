// Which edges may be contours to a point, and which faces it may lie on or have on its way up: a walk
// through clusters of them, stretch by stretch, none longer than a device may walk in one go. The NumPy
// form is gpusim/optics/ambient/silhouette_search.py, which finds them for points that lie together.
#import lib/numeric/texel
#import lib/numeric/index

struct Params {
    count: u32,
    most_edges: u32,    // of a point, as far as there is room
    most_faces: u32,
    tilt: f32,
    low: f32,       // sine of the height over the horizon below which edges don't matter
    rounding: f32,  // of heights over planes
    // from single edges or faces up: number of the first cluster, and how many
    edge_levels: array<vec4u, 12>,
    face_levels: array<vec4u, 12>,
}
// A stretch of both walks: through some clusters of one level.
struct Stretch {
    edge_level: u32,
    face_level: u32,
    first: u32,
    last: u32,      // the one after them
}
@group(0) @binding(0) var<uniform> params: Params;
// per point (position, tolerance), (unit normal, thickness), (unit tangent, -)
@group(0) @binding(1) var<storage, read> points: array<vec4f>;
// per cluster of edges (middle and radius of a ball around them); for the planes on both sides (axis,
// spread, of open surfaces less than -1 by it); the least and greatest products with both axes
@group(0) @binding(2) var clusters: texture_storage_2d<rgba32uint, read>;
// per cluster of faces (middle and radius of a ball around them)
@group(0) @binding(3) var spheres: texture_storage_2d<rgba32uint, read>;
// how many edges and faces a point needs, those of stretches before included, and the lists of them
@group(0) @binding(4) var<storage, read_write> counts: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> edges: array<u32>;
@group(0) @binding(6) var<storage, read_write> faces: array<u32>;
@group(0) @binding(7) var<uniform> stretch: Stretch;

const MEMBERS: u32 = 4u;        // of a cluster; places are told by two bits a level
const UNKNOWN: i32 = 2;

struct Point {
    at: vec3f,
    tolerance: f32,
    n: vec3f,
}

// How all faces of a cluster hide, or UNKNOWN, if their planes have an axis and products with it in
// common, and are at most `span` away.
fn hiding(p: Point, slope: vec4f, products: vec2f, span: f32) -> i32 {
    let opened = slope.w < 0.0;
    let spread = select(slope.w, -1.0 - slope.w, opened);
    let reach = spread * span + params.rounding;
    let product = dot(slope.xyz, p.at);
    let low = products.x - product - reach;
    let high = products.y - product + reach;
    if (high < -p.tolerance) { return -1; }
    if (low > p.tolerance) { return select(0, 1, opened); }
    let level = low > -p.tolerance && select(dot(slope.xyz, p.n) - spread >= -0.5, high < p.tolerance, opened);
    return select(UNKNOWN, 0, level);
}

// Whether a cluster may hold contours.
fn may_hold(p: Point, cluster: u32) -> bool {
    let ball = bitcast<vec4f>(textureLoad(clusters, texel(4u * cluster)));
    let to = ball.xyz - p.at;
    let away = length(to);
    if (dot(to, p.n) + ball.w <= params.low * max(away - ball.w, 0.0)) { return false; }
    let products = bitcast<vec4f>(textureLoad(clusters, texel(4u * cluster + 3u)));
    let span = away + ball.w;
    let one = hiding(p, bitcast<vec4f>(textureLoad(clusters, texel(4u * cluster + 1u))), products.xy, span);
    if (one == UNKNOWN) { return true; }
    let two = hiding(p, bitcast<vec4f>(textureLoad(clusters, texel(4u * cluster + 2u))), products.zw, span);
    return one != two;
}

// Whether a point may lie on a face of a cluster, or one on the way along its normal, as far aside as
// rows begin.
fn may_be_above(p: Point, cluster: u32) -> bool {
    let ball = bitcast<vec4f>(textureLoad(spheres, texel(cluster)));
    let to = ball.xyz - p.at;
    let height = dot(to, p.n);
    let reach = ball.w + p.tolerance;
    let wide = 1.01 * (reach + params.tilt * max(height + reach, 0.0));
    return height + reach >= 0.0 && dot(to, to) - height * height <= wide * wide;
}

// A way through clusters: level and number in it. After a cluster that is left out comes the next of
// its siblings, or of the lowest level above that has one.
struct Place {
    level: u32,
    number: u32,
}
fn beyond(place: Place, top: u32) -> Place {
    let number = place.number + 1u;
    let rise = min(countTrailingZeros(number) / 2u, top - place.level);
    return Place(place.level + rise, number >> (2u * rise));
}
// Whether a place, of so many on its level, is still in this stretch of a walk.
fn within(place: Place, top: u32, count: u32) -> bool {
    return place.number < min(count, stretch.last << (2u * (top - place.level)));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let point = linear_id(gid, groups, 64u);
    if (point >= params.count) { return; }
    let x = points[3u * point];
    let p = Point(x.xyz, x.w, points[3u * point + 1u].xyz);
    var found = counts[point];
    var top = stretch.edge_level;
    var at = Place(top, stretch.first);
    while (within(at, top, params.edge_levels[at.level].y)) {
        if (may_hold(p, params.edge_levels[at.level].x + at.number)) {
            if (at.level > 0u) {
                at = Place(at.level - 1u, at.number * MEMBERS);
                continue;
            }
            if (found.x < params.most_edges) { edges[point * params.most_edges + found.x] = at.number; }
            found.x += 1u;
        }
        at = beyond(at, top);
    }
    top = stretch.face_level;
    at = Place(top, stretch.first);
    while (within(at, top, params.face_levels[at.level].y)) {
        if (may_be_above(p, params.face_levels[at.level].x + at.number)) {
            if (at.level > 0u) {
                at = Place(at.level - 1u, at.number * MEMBERS);
                continue;
            }
            if (found.y < params.most_faces) { faces[point * params.most_faces + found.y] = at.number; }
            found.y += 1u;
        }
        at = beyond(at, top);
    }
    counts[point] = found;
}
