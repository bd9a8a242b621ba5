// Receivers: pixels of the picture, or pieces of pixels that are listed one by one. They are looked
// at in groups: an entry is what lies nearer, or farther, of the pixels of a tile, or one of the list.
#import common/undistort
#import optics/shadow/light_space

// 1: they are listed
override listed: u32;

struct Receivers {
    // ray of unit depth through a pixel: x * column + y * row + one
    x: vec4f,
    y: vec4f,
    one: vec4f,
    size: vec2u,     // of the picture
    columns: u32,    // of tiles
    groups: u32,     // tiles, or receivers of the list
    capacity: u32,   // chunks in the pool
    leaves: u32,
    count: u32,      // of all receivers
    row0: i32,       // of the picture, at which these pixels begin
    stride: u32,     // words from one row of `ids` to the next, and from one pixel to the next
    step: u32,
}
@group(0) @binding(10) var<uniform> receivers: Receivers;
// triangle of the view + 1 that each pixel sees
@group(0) @binding(11) var<storage, read> ids: array<u32>;
// per triangle of the view n / d of its plane n x = d, and the occluder that it is part of, or NOBODY
@group(0) @binding(12) var planes: texture_2d<u32>;
// per receiver of the list its place (w: the occluder that it lies on), unit normal, and how the
// place changes over the piece, twice
@group(0) @binding(13) var<storage, read> pieces: array<vec4f>;

struct Receiver {
    x: vec3f,
    n: vec3f,
    dx: vec3f,
    dy: vec3f,
    depth: f32,
    on: u32,
    // whether it is there, before the lamp and turned to it
    asks: bool,
}

fn pixel_id(pixel: vec2u) -> u32 {
    let there = all(pixel < receivers.size);
    return select(0u, ids[select(0u, pixel.y * receivers.stride + pixel.x * receivers.step, there)], there);
}
fn in_picture(pixel: vec2u) -> vec2i { return vec2i(pixel) + vec2i(0, receivers.row0); }
fn pixel_ray(pixel: vec2u, bend: Bend) -> vec3f {
    let at = vec2f(in_picture(pixel)) + undistort(bend, vec2f(0.0));
    return receivers.one.xyz + at.x * receivers.x.xyz + at.y * receivers.y.xyz;
}
// 0 where it sees nothing.
fn pixel_depth(pixel: vec2u) -> f32 {
    let id = pixel_id(pixel);
    let m = bitcast<vec3f>(textureLoad(planes, texel(max(id, 1u) - 1u), 0).xyz);
    return select(0.0, 1.0 / dot(m, pixel_ray(pixel, bend_at(in_picture(pixel)))), id > 0u);
}

fn pixel_receiver(pixel: vec2u) -> Receiver {
    var r = Receiver();
    let id = pixel_id(pixel);
    if (id == 0u) { return r; }
    let plane = textureLoad(planes, texel(id - 1u), 0);
    let m = bitcast<vec3f>(plane.xyz);
    let bend = bend_at(in_picture(pixel));
    let ray = pixel_ray(pixel, bend);
    let rate = 1.0 / dot(m, ray);
    let extent = undistort_change(bend);
    let sides = mat2x3f(receivers.x.xyz, receivers.y.xyz) * extent;
    r.x = rate * ray;
    r.n = -normalize(m);
    r.dx = rate * (sides[0] - r.x * dot(m, sides[0]));
    r.dy = rate * (sides[1] - r.x * dot(m, sides[1]));
    r.depth = rate;
    r.on = plane.w;
    r.asks = is_asking(r.x, r.n);
    return r;
}

fn listed_receiver(i: u32) -> Receiver {
    let place = pieces[4u * i];
    var r: Receiver;
    r.x = place.xyz;
    r.n = pieces[4u * i + 1u].xyz;
    r.dx = pieces[4u * i + 2u].xyz;
    r.dy = pieces[4u * i + 3u].xyz;
    r.depth = 1.0;
    r.on = bitcast<u32>(place.w);
    r.asks = is_asking(r.x, r.n);
    return r;
}

fn is_asking(x: vec3f, n: vec3f) -> bool {
    let plane = plane_in_light_space(vec4f(n, dot(n, x)));
    let away = select(1.0, distance(x, light.centre.xyz), is_near());
    let before = !is_near() || ahead(x) > 0.0;
    return before && plane.z + lamp_extent(plane) > -light.terminator * away;
}

fn tile_pixel(entry: u32, local: vec2u) -> vec2u {
    let tile = entry % receivers.groups;
    return 8u * vec2u(tile % receivers.columns, tile / receivers.columns) + local;
}

// Light-space box of what a receiver's samples look from.
struct Reach { low: vec3f, high: vec3f }
fn reach_of(r: Receiver) -> Reach {
    var reach = Reach(vec3f(UNLIMITED), vec3f(-UNLIMITED));
    for (var k = 0u; k < 4u; k++) {
        let side = vec2f(select(-0.5, 0.5, (k & 1u) != 0u), select(-0.5, 0.5, (k & 2u) != 0u));
        let at = to_light_space(r.x + side.x * r.dx + side.y * r.dy);
        let slack = rounding_at(at);
        reach = Reach(min(reach.low, at - slack), max(reach.high, at + slack));
    }
    return reach;
}

// Unit normal of a receiver's plane as its own changes tell it.
fn upright(r: Receiver) -> vec3f {
    let up = cross(r.dx, r.dy);
    let size = length(up);
    let n = select(r.n, up / size, size > 0.0);
    return select(-n, n, dot(n, r.n) > 0.0);
}
