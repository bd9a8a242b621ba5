// The light on small matte triangles as functions of the pixel, and the pixels that read them.
// Described in gpusim/optics/shading/glance.py.
#import lib/paint/checker_fields
#import lib/light/glance
#import lib/numeric/index
#import lib/raster/point_in_triangle
#import lib/raster/planes
#import lib/light/surface
#import lib/raster/undistortion_table
#import lib/raster/vertex

override lit: u32;
// 1 where light is found without the albedo, which then differs from pixel to pixel
override bare: u32 = 0u;

struct Params {
    rays: Rays,
    count: u32,
    width: u32,
    row0: i32,
    background: f32,
    // of the largest light at its corners, that a triangle's function may be off by
    tolerance: f32,
    // the squares of two sides over twice the area, beyond which a triangle is a sliver
    slender: f32,
    // 1 / depth that those of the vertices are relative to
    inverse_depth: f32,
    // where triangles are looked at: the last paint in `order`, by what the lens stretches a pixel at
    // most, and of half the largest pixel on a triangle, how far from a line its pixels may be
    last: u32,
    stretch: f32,
    margin: f32,
    // where triangles draw their own pixels: rows of the band, pixels from one row of `band_radiance` to the
    // next, and 1 where it isn't known yet what triangles look like
    rows: i32,
    stride: i32,
    looking: u32,
    // rows of the image, and where the host has looked at some triangles only (`late`) the longest side of
    // a box round one, in 1/256 px
    tall: i32,
    longest: i32,
    late: u32,
    // the lowest cell of the pattern that all triangles have
    lowest: vec2i,
    // of triangles with a pattern that the host hasn't looked at: the least cosine that their normals may
    // have to the line of sight, and their paint's albedo
    steep: f32,
    ground: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
// numbers + 1 of the triangles to look at; or each triangle's paint, or one that all have
@group(0) @binding(1) var<storage, read> order: array<u32>;
// per triangle (bits of its albedo, its paint, plus 2^31 if it is near a line)
@group(0) @binding(11) var<storage, read_write> looks: array<vec2u>;
@group(0) @binding(6) var glances: texture_storage_2d<rgba32uint, write>;
// numbers + 1 of those whose light is no such function, and the workgroups of 64 that they fill, 1, 1,
// their count
@group(0) @binding(7) var<storage, read_write> refused: array<u32>;
@group(0) @binding(8) var<storage, read_write> refusals: array<atomic<u32>, 4>;

// A place on a triangle: its offset from the anchor in the ideal image, px, relative 1 / depth, and
// the normal times that, which are affine in the image.
struct Place {
    at: vec2f,
    w: f32,
    normal: vec3f,
}
fn place_of(v: Vertex, anchor: vec2i) -> Place {
    let w = 1.0 + v.offset;
    return Place(offset_from(anchor, v), w, w * v.normal);
}
fn between(a: Place, b: Place) -> Place {
    return Place(0.5 * (a.at + b.at), 0.5 * (a.w + b.w), 0.5 * (a.normal + b.normal));
}

fn light_at(place: Place, anchor: vec2f) -> f32 {
    if (lit == 0u) { return 1.0; }
    let p = anchor + place.at;
    let depth = 1.0 / (place.w * params.inverse_depth);
    let ray = params.rays.x.xyz * p.x + params.rays.y.xyz * p.y + params.rays.one.xyz;
    return reflection(depth * ray, normalize(place.normal), Gloss(), 1.0).matte;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.count) { return; }
    let id = order[i] - 1u;
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    let found = found_in(a, b, c);
    if (!found.even) { refuse(id); }
    keep(id, found, select(bitcast<f32>(looks[id].x), 1.0, bare != 0u), bare != 0u);
}

// The same for triangles whose pixels find the pattern's albedo themselves (optics/shading/speckled.wgsl): four texels
// each, after the light what gives paint coordinates.
@compute @workgroup_size(64)
fn patterned(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    pattern(id, a, b, c, planes_of(a, b, c));
}
fn pattern(id: u32, a: Vertex, b: Vertex, c: Vertex, f: Planes) {
    let found = found_in(a, b, c);
    if (!found.even) { refuse(id); }
    // weights by that at the anchor
    let w = 1.0 / f.depth.x;
    let s = w * f.s;
    let t = w * f.t;
    let cell = vec2u(clamp(f.cell - params.lowest, vec2i(-1), vec2i(65534)) + 1);
    let bend = bitcast<vec3u>(found.bend);
    let i = 4u * id;
    textureStore(glances, texel(i), vec4u(bitcast<vec3u>(vec3f(found.value, found.slope)), packed(found.anchor)));
    textureStore(glances, texel(i + 1u), bitcast<vec4u>(vec4f(s, t.x)));
    textureStore(glances, texel(i + 2u), bitcast<vec4u>(vec4f(t.yz, w * f.depth.yz)));
    textureStore(glances, texel(i + 3u), vec4u(bend, (cell.y << 16u) | cell.x));
}
fn packed(anchor: vec2i) -> u32 {
    return (u32(anchor.y) << 16u) | (u32(anchor.x) & 65535u);
}

// numbers + 1 of the triangles near lines, and the workgroups of 64 that they fill, 1, 1, their count;
// then 1 if a pixel is larger than its paint says, and 1 if a triangle lies over others
@group(0) @binding(14) var<storage, read_write> lined: array<u32>;
@group(0) @binding(15) var<storage, read_write> counts: array<atomic<u32>, 6>;

fn looked_at(id: u32, a: Vertex, b: Vertex, c: Vertex) -> Look {
    let paint = order[min(id, params.last)];
    let look = look_of(a, b, c, paint, params.stretch, params.margin);
    looks[id] = vec2u(bitcast<u32>(look.albedo), paint | select(0u, 0x80000000u, look.near));
    if (look.larger) { atomicStore(&counts[4], 1u); }
    return look;
}
fn note(id: u32) {
    let place = atomicAdd(&counts[3], 1u);
    lined[place] = id + 1u;
    atomicMax(&counts[0], place / 64u + 1u);
}

// All triangles, and first what they look like.
@compute @workgroup_size(64)
fn looked(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    let look = looked_at(id, a, b, c);
    if (look.near) { note(id); }
    let found = found_in(a, b, c);
    if (!found.even) { refuse(id); }
    keep(id, found, select(look.albedo, 1.0, look.near), look.near);
}

// per pixel of the band its radiance's bits, or MARK and a triangle's number
@group(0) @binding(16) var<storage, read_write> band_radiance: array<u32>;

// A vertex's place in 1/256 px, as lib/raster/pixel_box.wgsl has it.
fn steps_of(v: Vertex) -> vec2i {
    return (v.at + select(vec2i(0), vec2i(1), v.rest >= vec2f(0.5)) + 128) >> vec2u(8u);
}

fn in_band(a: Vertex, b: Vertex, c: Vertex) -> Places {
    let band = vec2i(0, 256 * params.row0);
    return Places(steps_of(a) - band, steps_of(b) - band, steps_of(c) - band, vec3f(0.0));
}

// Whether a triangle is a line but for what float32 may be off by.
fn thin(a: Vertex, b: Vertex, c: Vertex) -> bool {
    let u = vec2f(b.at - a.at) + (b.rest - a.rest);
    let v = vec2f(c.at - a.at) + (c.rest - a.rest);
    return !(abs(u.x * v.y - u.y * v.x) > 1e-6 * (dot(u, u) + dot(v, v)));
}

// Of triangles that the host hasn't looked at: whether no pixel's square reaches one, and whether it is
// larger than those that the host has.
fn away(at: Places) -> bool {
    let band = vec2i(0, 256 * params.row0);
    let last = vec2i(i32(params.width), params.tall - params.row0) * 256;
    return any(max(max(at.p, at.q), at.r) < -band - 256) || any(min(min(at.p, at.q), at.r) > last);
}
fn odd(at: Places) -> bool {
    let size = max(max(at.p, at.q), at.r) - min(min(at.p, at.q), at.r);
    return any(size > vec2i(params.longest));
}

// All triangles, where none lies over another: they write their own pixels, or leave their mark on those
// that are shaded one by one.
@compute @workgroup_size(64)
fn layered(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    let at = in_band(a, b, c);
    let box = box_of(at, vec2i(i32(params.width), params.rows));
    let beside = any(box.size < vec2i(0));
    if (beside && params.looking == 0u) { return; }
    // no branch on uniforms alone: lavapipe would compile the program anew at each dispatch
    let late = (params.late & params.looking) != 0u;
    if (late & away(at)) { return; }
    if (late & (odd(at) | thin(a, b, c))) { atomicStore(&counts[5], 1u); }
    let look = looked_at(id, a, b, c);
    let triangle = inside_of(at, box);
    // all are wound one way, or some lie over each other
    if (triangle.area != 0 && !triangle.turned) { atomicStore(&counts[5], 1u); }
    if (triangle.area == 0 || beside) { return; }
    let found = found_in(a, b, c);
    let own = look.near || !found.even;
    if (own) { keep(id, found, 1.0, true); }
    if (look.near) { note(id); }
    if (!found.even) { refuse(id); }
    let light = Glance(look.albedo * vec3f(found.value, found.slope), look.albedo * found.bend,
        found.anchor, false);
    var inside = triangle.here;
    var place = box.low;
    let end = box.low + box.size;
    loop {
        if (all(inside > triangle.limits)) {
            let pixel = place + vec2i(0, params.row0);
            let d = vec2f(pixel - light.anchor) + undistort(bend_at(pixel), vec2f(0.0));
            band_radiance[place.y * params.stride + place.x] =
                select(bitcast<u32>(glance_of(light, d)), MARK | id, own);
        }
        let last = place.x == end.x;
        inside += select(triangle.right, triangle.next, last);
        place = select(place + vec2i(1, 0), vec2i(box.low.x, place.y + 1), last);
        if (place.y > end.y) { break; }
    }
}

// The same of triangles that `patterned` is for: they leave their mark on all their pixels.
@compute @workgroup_size(64)
fn patterned_layer(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let a = vertex_at(corners[3u * id]);
    let b = vertex_at(corners[3u * id + 1u]);
    let c = vertex_at(corners[3u * id + 2u]);
    let at = in_band(a, b, c);
    let box = box_of(at, vec2i(i32(params.width), params.rows));
    let beside = any(box.size < vec2i(0));
    if (beside && params.looking == 0u) { return; }
    if (params.looking != 0u && away(at)) { return; }
    let f = planes_of(a, b, c);
    if (params.looking != 0u) {
        let cosine = facing(f, params.rays.x.xyz, params.rays.y.xyz, params.rays.one.xyz);
        if (odd(at) || thin(a, b, c) || !(cosine > params.steep)) { atomicStore(&counts[5], 1u); }
        if (!(footprint_of(a, b, c, 1.0) <= params.margin)) { atomicStore(&counts[4], 1u); }
        looks[id] = vec2u(bitcast<u32>(params.ground), params.last | 0x80000000u);
    }
    let triangle = inside_of(at, box);
    if (triangle.area != 0 && !triangle.turned) { atomicStore(&counts[5], 1u); }
    if (triangle.area == 0 || beside) { return; }
    pattern(id, a, b, c, f);
    var inside = triangle.here;
    var place = box.low;
    let end = box.low + box.size;
    loop {
        if (all(inside > triangle.limits)) { band_radiance[place.y * params.stride + place.x] = MARK | id; }
        let last = place.x == end.x;
        inside += select(triangle.right, triangle.next, last);
        place = select(place + vec2i(1, 0), vec2i(box.low.x, place.y + 1), last);
        if (place.y > end.y) { break; }
    }
}

// Sets the pixels of a band to the background.
@compute @workgroup_size(64)
fn blank(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let place = linear_id(gid, groups, 64u);
    if (place < arrayLength(&band_radiance)) { band_radiance[place] = bitcast<u32>(params.background); }
}

// The function of a triangle's light: its value at an anchor, its changes, and whether it is one.
struct Found {
    value: f32,
    slope: vec2f,
    bend: vec3f,
    anchor: vec2i,
    even: bool,
}
fn found_in(a: Vertex, b: Vertex, c: Vertex) -> Found {
    let anchor = anchor_of(a, b, c);
    let origin = vec2f(anchor);
    let p = place_of(a, anchor);
    let q = place_of(b, anchor);
    let r = place_of(c, anchor);
    let m = between(q, r);
    let n = between(r, p);
    let o = between(p, q);
    let light = vec3f(light_at(p, origin), light_at(q, origin), light_at(r, origin));
    let middle = vec3f(light_at(m, origin), light_at(n, origin), light_at(o, origin));
    let most = max(light.x, max(light.y, light.z));
    let u = q.at - p.at;
    let v = r.at - p.at;
    let area = u.x * v.y - u.y * v.x;
    let scale = 1.0 / select(area, 1.0, area == 0.0);
    var off = abs(middle - 0.5 * (light.yzx + light.zxy));
    let one = light.y - light.x;
    let two = light.z - light.x;
    var value = light.x;
    var slope = vec2f(one * v.y - two * u.y, two * u.x - one * v.x) / select(area, 1.0, area == 0.0);
    var bend = vec3f(0.0);
    var sound = area != 0.0;
    if (quadratic != 0u) {
        // where it is off: at a quarter of every side, and in the middle
        let quarter = vec3f(light_at(between(p, o), origin), light_at(between(q, m), origin),
            light_at(between(r, n), origin));
        off = abs(quarter - (0.375 * light - 0.125 * light.yzx + 0.75 * middle.zxy));
        let centre = Place((p.at + q.at + r.at) / 3.0, (p.w + q.w + r.w) / 3.0,
            (p.normal + q.normal + r.normal) / 3.0);
        let sums = vec2f(dot(light, vec3f(1.0)), dot(middle, vec3f(1.0)));
        off.x = max(off.x, abs(light_at(centre, origin) - (4.0 * sums.y - sums.x) / 9.0));
        // by barycentric coordinates a, b of the second and the third corner: light.x + a (one - aa)
        // + b (two - bb) + aa a^2 + bb b^2 + ab a b
        let aa = 2.0 * (light.x + light.y - 2.0 * middle.z);
        let bb = 2.0 * (light.x + light.z - 2.0 * middle.y);
        let ab = 4.0 * (light.x + middle.x - middle.y - middle.z);
        let da = vec2f(v.y, -v.x) * scale;
        let db = vec2f(-u.y, u.x) * scale;
        slope = (one - aa) * da + (two - bb) * db;
        bend = vec3f(aa * da.x * da.x + bb * db.x * db.x + ab * da.x * db.x,
            2.0 * (aa * da.x * da.y + bb * db.x * db.y) + ab * (da.x * db.y + da.y * db.x),
            aa * da.y * da.y + bb * db.y * db.y + ab * da.y * db.y);
        // so far from the first corner: the anchor lies at -p.at
        let d = -p.at;
        value += d.x * (slope.x + bend.x * d.x + bend.y * d.y) + d.y * (slope.y + bend.z * d.y);
        slope += vec2f(2.0 * bend.x * d.x + bend.y * d.y, bend.y * d.x + 2.0 * bend.z * d.y);
        // on slivers large terms would cancel
        sound = dot(u, u) + dot(v, v) <= params.slender * abs(area);
    } else {
        value -= dot(slope, p.at);
    }
    let even = max(off.x, max(off.y, off.z)) <= params.tolerance * most && sound;
    return Found(value, slope, bend, anchor, even);
}

fn refuse(id: u32) {
    let place = atomicAdd(&refusals[3], 1u);
    refused[place] = id + 1u;
    atomicMax(&refusals[0], place / 64u + 1u);
}

// `own`: the triangle's pixels each have an albedo of their own.
fn keep(id: u32, found: Found, albedo: f32, own: bool) {
    let at = select(packed(found.anchor), NONE, own && !found.even);
    let radiance = albedo * vec3f(found.value, found.slope);
    textureStore(glances, texel((1u + quadratic) * id), vec4u(bitcast<vec3u>(radiance), at));
    if (quadratic != 0u) {
        let bend = bitcast<vec3u>(albedo * found.bend);
        textureStore(glances, texel((1u + quadratic) * id + 1u), vec4u(bend, 0u));
    }
}

// per pixel of the band what compute_raster.wgsl found, the lower half first
@group(0) @binding(9) var<storage, read> nearest: array<vec2u>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}
// Four pixels side by side: what a rasteriser does for one costs as much as what the pixel reads.
@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let four = vec2u(at.xy);
    let column = min(4u * four.x + vec4u(0u, 1u, 2u, 3u), vec4u(params.width - 1u));
    return vec4f(radiance_at(vec2u(column.x, four.y)), radiance_at(vec2u(column.y, four.y)),
        radiance_at(vec2u(column.z, four.y)), radiance_at(vec2u(column.w, four.y)));
}
fn radiance_at(at: vec2u) -> f32 {
    let number = 0u - nearest[at.y * params.width + at.x].x;
    let glance = glance_at(max(number, 1u) - 1u);
    let pixel = vec2i(at) + vec2i(0, params.row0);
    let d = vec2f(pixel - glance.anchor) + undistort(bend_at(pixel), vec2f(0.0));
    return select(params.background, glance_of(glance, d), number > 0u);
}
