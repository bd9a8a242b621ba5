// Which triangles hide part of another one's polygon, and what they leave of it while that is
// convex. The NumPy form is gpusim/optics/edge_pixels/visible_polygons.py, which follows all shapes.
#import lib/raster/polygon_clipping

const SMALLEST: f32 = 1e-9;
const TOUCH: f32 = 2e-5;   // px by which neighbours may overlap from rounding alone

// A triangle's corners and its half planes.
struct Sides {
    v: array<vec2f, 3>,
    s: array<vec3f, 3>,
}
fn sides_of(v0: vec2f, v1: vec2f, v2: vec2f) -> Sides {
    let twice = (v1.x - v0.x) * (v2.y - v0.y) - (v1.y - v0.y) * (v2.x - v0.x);
    let s = select(-1.0, 1.0, twice > 0.0);
    var result: Sides;
    result.v[0] = v0;
    result.v[1] = v1;
    result.v[2] = v2;
    result.s[0] = s * vec3f(v0.y - v1.y, v1.x - v0.x, v0.x * v1.y - v0.y * v1.x);
    result.s[1] = s * vec3f(v1.y - v2.y, v2.x - v1.x, v1.x * v2.y - v1.y * v2.x);
    result.s[2] = s * vec3f(v2.y - v0.y, v0.x - v2.x, v2.x * v0.y - v2.y * v0.x);
    return result;
}

// A polygon's corners side by side, to see quickly on which side of a line they lie.
struct Reach {
    x0: vec4f,
    y0: vec4f,
    x1: vec4f,
    y1: vec4f,
}
fn reach_of(polygon: ptr<function, Polygon>) -> Reach {
    let last = polygon.p[polygon.count - 1];
    var p = polygon.p;
    for (var i = 3; i < MOST; i++) { p[i] = select(p[i], last, i >= polygon.count); }
    return Reach(
        vec4f(p[0].x, p[1].x, p[2].x, p[3].x), vec4f(p[0].y, p[1].y, p[2].y, p[3].y),
        vec4f(p[4].x, p[5].x, p[6].x, p[7].x), vec4f(p[4].y, p[5].y, p[6].y, p[7].y),
    );
}

// What a line does to a polygon: 0 all of it lies beyond, 1 it is cut, 2 all lies within.
fn side_of(r: Reach, d: vec3f) -> u32 {
    let a = d.x * r.x0 + d.y * r.y0;
    let b = d.x * r.x1 + d.y * r.y1;
    let high = max(a, b);
    let low = min(a, b);
    let slack = TOUCH * length(d.xy);
    let most = max(max(high.x, high.y), max(high.z, high.w)) + d.z;
    let least = min(min(low.x, low.y), min(low.z, low.w)) + d.z;
    return select(select(1u, 2u, least >= -slack), 0u, most <= slack);
}
fn outside_of(other: Sides, d: vec3f) -> bool {
    let far = max(max(dot(other.v[0], d.xy), dot(other.v[1], d.xy)), dot(other.v[2], d.xy));
    return far + d.z <= TOUCH * length(d.xy);
}

// How a triangle in front meets the polygon of another: 0 not at all, 1 it hides all of it, 2 all
// on one side of `line`, 3 in another way.
struct Meeting {
    kind: u32,
    line: vec3f,
}
fn meeting(reach: Reach, own: Sides, other: Sides) -> Meeting {
    let s0 = side_of(reach, other.s[0]);
    let s1 = side_of(reach, other.s[1]);
    let s2 = side_of(reach, other.s[2]);
    let apart = s0 == 0u || s1 == 0u || s2 == 0u || outside_of(other, own.s[0])
        || outside_of(other, own.s[1]) || outside_of(other, own.s[2]);
    let line = select(select(other.s[2], other.s[1], s1 == 1u), other.s[0], s0 == 1u);
    let cuts = 6u - (s0 + s1 + s2);
    return Meeting(select(min(cuts + 1u, 3u), 0u, apart), line);
}
