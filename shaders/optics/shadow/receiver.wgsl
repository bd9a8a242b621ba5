// Receivers: pixels of the picture in tiles of 8 x 8, or places that are listed in groups of neighbours.
// An entry is what lies nearer of a group, and by `groups` later what lies farther where depths differ.
#import lib/raster/undistortion_table
#import optics/shadow/light_space
#import optics/shadow/plane_words

// 1: they are listed, 0: pixels; 2: `receivers.listed` tells, in programs that look at each receiver once
override listed: u32 = 2u;

struct Receivers {
    // ray of unit depth through a pixel: x * column + y * row + one
    x: vec4f,
    y: vec4f,
    one: vec4f,
    size: vec2u,     // of the picture
    columns: u32,    // of tiles
    groups: u32,     // tiles, or groups of the list
    capacity: u32,   // chunks in the pool
    leaves: u32,
    count: u32,      // of all receivers
    row0: i32,       // of the picture, at which these pixels begin
    stride: u32,     // words from one row of `ids` to the next, and from one pixel to the next
    step: u32,
    listed: u32,
}
@group(0) @binding(10) var<uniform> receivers: Receivers;
// triangle of the view + 1 that each pixel sees
@group(0) @binding(11) var<storage, read> ids: array<u32>;
// per triangle of the view n / d of its plane n x = d, in 24 bits the occluder that it is part of, or
// NO_OWNER, and in the others how far normals for shading are from its own
@group(0) @binding(12) var planes: texture_storage_2d<rgba32uint, read>;
// per receiver of the list its place (w: the occluder that it lies on), unit normal, and how the
// place changes over the piece, twice
@group(0) @binding(13) var<storage, read> pieces: array<vec4f>;

// Of pixels two words of each tile: bits of those in its farther half. Of the list where each group
// begins, and where the last one ends; then a word of each receiver, 1 in the farther half.
@group(0) @binding(17) var<storage, read_write> halves: array<u32>;

struct Receiver {
    x: vec3f,
    n: vec3f,
    dx: vec3f,
    dy: vec3f,
    // from the eye; 0: it isn't there
    depth: f32,
    on: u32,
    // how far normals for shading may be from n
    lean: f32,
    // where it is and how far it goes on about that, in the coordinates of cells (receiver_groups.wgsl)
    at: vec3f,
    reach: vec3f,
}

fn are_listed() -> bool { return select(listed, receivers.listed, listed == 2u) != 0u; }

// At most 64.
fn size_of(group: u32) -> u32 {
    if (are_listed()) { return halves[group + 1u] - halves[group]; }
    return 64u;
}
fn tile_pixel(tile: u32, k: u32) -> vec2u {
    return 8u * vec2u(tile % receivers.columns, tile / receivers.columns) + vec2u(k & 7u, k >> 3u);
}
// Place among all receivers of the k-th one of a group.
fn number_of(group: u32, k: u32) -> u32 {
    if (are_listed()) { return halves[group] + k; }
    let pixel = tile_pixel(group, k);
    return pixel.y * receivers.size.x + pixel.x;
}
fn is_farther(group: u32, k: u32) -> bool {
    if (are_listed()) { return halves[receivers.groups + 1u + number_of(group, k)] != 0u; }
    return (halves[2u * group + (k >> 5u)] >> (k & 31u) & 1u) != 0u;
}

fn pixel_id(pixel: vec2u) -> u32 {
    let there = all(pixel < receivers.size);
    return select(0u, ids[select(0u, pixel.y * receivers.stride + pixel.x * receivers.step, there)], there);
}
fn in_picture(pixel: vec2u) -> vec2i { return vec2i(pixel) + vec2i(0, receivers.row0); }
fn pixel_ray(at: vec2f) -> vec3f {
    return receivers.one.xyz + at.x * receivers.x.xyz + at.y * receivers.y.xyz;
}
fn pixel_receiver(pixel: vec2u) -> Receiver {
    var r = Receiver();
    let id = pixel_id(pixel);
    if (id == 0u) { return r; }
    let plane = textureLoad(planes, texel(id - 1u));
    let m = bitcast<vec3f>(plane.xyz);
    let bend = bend_at(in_picture(pixel));
    let at = vec2f(in_picture(pixel)) + undistort(bend, vec2f(0.0));
    let ray = pixel_ray(at);
    let rate = 1.0 / dot(m, ray);
    let extent = undistort_change(bend);
    let sides = mat2x3f(receivers.x.xyz, receivers.y.xyz) * extent;
    let slope = rate * vec2f(dot(m, sides[0]), dot(m, sides[1]));
    r.x = rate * ray;
    r.n = -normalize(m);
    r.dx = rate * sides[0] - slope.x * r.x;
    r.dy = rate * sides[1] - slope.y * r.x;
    r.depth = rate;
    let own = plane.w & NO_OWNER;
    r.on = select(own, NOBODY, own == NO_OWNER);
    r.lean = f32(plane.w >> 24u) / LEAN;
    // what samples look from lies in its plane, and seen from the eye a little beside the pixel
    let steep = 0.5 * (abs(slope.x) + abs(slope.y));
    r.at = vec3f(at, rate);
    r.reach = vec3f(0.5 * (abs(extent[0]) + abs(extent[1])) / (1.0 - min(steep, 0.9)), rate * steep);
    return r;
}
fn listed_receiver(i: u32) -> Receiver {
    let place = pieces[4u * i];
    var r: Receiver;
    r.x = place.xyz;
    r.n = pieces[4u * i + 1u].xyz;
    r.dx = pieces[4u * i + 2u].xyz;
    r.dy = pieces[4u * i + 3u].xyz;
    // one may lie in the eye
    r.depth = select(0.0, max(length(r.x), 1e-30), any(r.n != vec3f(0.0)));
    r.on = bitcast<u32>(place.w);
    r.at = r.x;
    r.reach = 0.5 * (abs(r.dx) + abs(r.dy));
    return r;
}
fn receiver_of(group: u32, k: u32) -> Receiver {
    if (are_listed()) {
        if (k >= size_of(group)) { return Receiver(); }
        return listed_receiver(number_of(group, k));
    }
    return pixel_receiver(tile_pixel(group, k));
}

// Whether it is there, before the lamp and turned to it.
fn asks(r: Receiver) -> bool {
    let plane = plane_in_light_space(vec4f(r.n, dot(r.n, r.x)));
    let away = select(1.0, distance(r.x, light.centre.xyz), is_near());
    // what lies between a lamp's two spaces is before both
    let before = !is_near() || ahead(r.x) >= 0.0;
    return r.depth > 0.0 && before && plane.z + lamp_extent(plane) > -(light.terminator + r.lean) * away;
}
// Whether the k-th receiver of a group asks as one of an entry.
fn is_in(r: Receiver, entry: u32, k: u32) -> bool {
    return asks(r) && is_farther(entry % receivers.groups, k) == (entry >= receivers.groups);
}

// Unit normal of a receiver's plane as its own changes tell it.
fn upright(r: Receiver) -> vec3f {
    let up = cross(r.dx, r.dy);
    let size = length(up);
    let n = select(r.n, up / size, size > 0.0);
    return select(-n, n, dot(n, r.n) > 0.0);
}
