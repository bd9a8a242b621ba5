// A triangle set up for shading, and the light that falls on it.
// The NumPy form is gpusim/optics/shading/radiance.py.
#import lib/paint/relief_normals
#import lib/paint/footprint
#import lib/light/lighting
#import lib/numeric/texel

// Affine functions of the offset (dx, dy) from the anchor pixel, scaled by the triangle's mean
// depth: st = (s0, sx, sy, t0), tw = (tx, ty, wx, wy), n0 = (normal at the anchor, w0),
// nx = (change per column, 1 / mean depth), ny = (change per row, paint),
// place = (anchor column, row, cell i, cell j), more = (ground albedo, 1 if a feature is near, GGX alpha
// or 1 if matte, metallic), id: its number.
struct Triangle {
    st: vec4f,
    tw: vec4f,
    n0: vec4f,
    nx: vec4f,
    ny: vec4f,
    place: vec4i,
    more: vec4f,
    id: u32,
}

// seven texels per triangle, the first four with all that plain matte paint needs: a load takes
// longer than most arithmetic
@group(0) @binding(4) var triangles: texture_storage_2d<rgba32uint, read>;
fn triangle_word(i: u32) -> vec4f {
    return bitcast<vec4f>(textureLoad(triangles, texel(i)));
}
fn triangle_at(id: u32) -> Triangle {
    let i = 7u * id;
    let n0 = triangle_word(i);
    let nx = triangle_word(i + 1u);
    let ny = triangle_word(i + 2u);
    let w = triangle_word(i + 3u);
    let st = triangle_word(i + 4u);
    let t = triangle_word(i + 5u);
    let more = triangle_word(i + 6u);
    return Triangle(st, vec4f(t.xy, w.xy), n0, nx, vec4f(ny.xyz, more.x),
        vec4i(bitcast<vec2i>(w.zw), bitcast<vec2i>(t.zw)), vec4f(ny.w, more.yzw), id);
}

fn weight(t: Triangle, d: vec2f) -> f32 {
    return weight_of(t.tw, t.n0.w, d);
}
fn paint_position(t: Triangle, d: vec2f) -> vec2f {
    return paint_position_of(t.st, t.tw, t.n0.w, d);
}
fn footprint(t: Triangle, d: vec2f) -> Footprint {
    return footprint_of_planes(t.st, t.tw, t.n0.w, d);
}

// World-space ray of unit depth through a pixel: x * column + y * row + one.
struct Rays {
    x: vec4f,
    y: vec4f,
    one: vec4f,
}

// Where the surface is seen at image position p, which lies at offset d from the triangle's anchor,
// relative to the eye, its unit normal there, how the place changes per column and row, and what a
// relief adds to the square of alpha.
struct Spot {
    x: vec3f,
    n: vec3f,
    dx: vec3f,
    dy: vec3f,
    widened: f32,
}
fn spot(t: Triangle, rays: Rays, p: vec2f, d: vec2f) -> Spot {
    let w = weight(t, d);
    let depth = 1.0 / (w * t.nx.w);
    let x = depth * (rays.x.xyz * p.x + rays.y.xyz * p.y + rays.one.xyz);
    let n = normalize(t.n0.xyz + t.nx.xyz * d.x + t.ny.xyz * d.y);
    let rate = t.tw.zw / w;
    let dx = depth * rays.x.xyz - rate.x * x;
    let dy = depth * rays.y.xyz - rate.y * x;
    if (bumpy == 0u) { return Spot(x, n, dx, dy, 0.0); }
    let relief = leaning(t.id, d, w, t.tw.zw, n, dx, dy);
    return Spot(x, relief.n, dx, dy, relief.widened);
}

fn gloss_at(t: Triangle, s: Spot) -> Gloss {
    if (glossy == 0u) { return Gloss(); }
    var alpha = t.more.z;
    if (bumpy != 0u) { alpha = min(sqrt(alpha * alpha + s.widened), 1.0); }
    return gloss_of(u32(t.ny.w), lamps.per_paint.x, alpha, t.more.w, normalize(-s.x), s.n);
}

// What is reflected there, of all lamps.
fn reflection_at(t: Triangle, rays: Rays, p: vec2f, d: vec2f) -> Reflection {
    let s = spot(t, rays, p, d);
    return reflection(s.x, s.n, gloss_at(t, s), openness_at(t.id, s.x));
}

// Albedo of the paint's ground.
fn ground_of(t: Triangle) -> Color { return color_of(t.more.x); }

// Radiance of a spot of mean albedo `albedo`, of which the paint's ground (albedo `ground`) shows
// over `bare`; the rest is matte print.
fn radiance_of(t: Triangle, r: Reflection, albedo: Color, ground: Color, bare: f32) -> Color {
    if (glossy == 0u) { return albedo * r.matte; }
    let shiny = (albedo - ground * bare) * r.matte + bare * (ground * r.p + r.q);
    return select(albedo * r.matte, shiny, t.more.z < 1.0);
}
