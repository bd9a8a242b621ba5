// Which triangle each pixel's centre sees, where triangles are small: an invocation per triangle
// walks over the few pixels of its box. Rasterisers set triangles up one after another, which takes
// several times as long as so few pixels do. Writes the same numbers as id_buffer.wgsl.
// Described in gpusim/optics/raster/compute_raster.py.
#import lib/numeric/index
#import lib/numeric/texel

struct Params {
    count: u32,
    width: i32,
    rows: i32,
    row0: i32,
}
@group(0) @binding(0) var<uniform> params: Params;
// per pixel of the band: depth above, what is left of 2^32 by the triangle's number + 1 below, so
// that of triangles at one depth the first is seen
@group(0) @binding(1) var<storage, read_write> nearest: array<atomic<u64>>;

// three vertices per triangle
@group(0) @binding(12) var<storage, read> corners: array<u32>;
// per vertex (column, row in 1/65536 px, near / z, 0)
@group(0) @binding(18) var places: texture_storage_2d<rgba32uint, read>;

// The corners in 1/256 px from the first row of the band on, and their near / z.
struct Places {
    p: vec2i,
    q: vec2i,
    r: vec2i,
    depth: vec3f,
}
fn places_of(id: u32, row0: i32) -> Places {
    let a = textureLoad(places, texel(corners[3u * id]));
    let b = textureLoad(places, texel(corners[3u * id + 1u]));
    let c = textureLoad(places, texel(corners[3u * id + 2u]));
    let band = vec2i(0, 256 * row0);
    return Places(snapped(a) - band, snapped(b) - band, snapped(c) - band,
        bitcast<vec3f>(vec3u(a.z, b.z, c.z)));
}
fn snapped(at: vec4u) -> vec2i {
    return (vec2i(at.xy) + 128) >> vec2u(8u);
}

// The first pixel and how many columns and rows follow it; below 0 where there is none.
struct Box {
    low: vec2i,
    size: vec2i,
}
fn box_of(at: Places, size: vec2i) -> Box {
    let low = max((min(min(at.p, at.q), at.r) + 255) >> vec2u(8u), vec2i(0));
    let high = min(max(max(at.p, at.q), at.r) >> vec2u(8u), size - 1);
    return Box(low, high - low);
}

// The edges' functions, the areas opposite to r, p and q, at a pixel: how they change to the next one of
// a row and from a row's last to the next row, and what all have to be above. `area`: twice the
// triangle's; `turned`: its second and third corner are the other way round.
struct Inside {
    here: vec3i,
    right: vec3i,
    next: vec3i,
    limits: vec3i,
    area: i32,
    turned: bool,
}

// Twice the area of (0, a, b): above 0 where b is on the inner side of the edge along a.
fn cross_of(a: vec2i, b: vec2i) -> i32 {
    return a.x * b.y - a.y * b.x;
}

// What the edge function has to be above: an edge's own points are inside where it is a left or an
// upper one.
fn limit(edge: vec2i) -> i32 {
    return select(0, -1, edge.y < 0 || (edge.y == 0 && edge.x > 0));
}

// From the first pixel of the box on.
fn inside_of(at: Places, box: Box) -> Inside {
    // from there on numbers are small
    let p = at.p - (box.low << vec2u(8u));
    var q = at.q - (box.low << vec2u(8u));
    var r = at.r - (box.low << vec2u(8u));
    let area = cross_of(q - p, r - p);
    if (area < 0) {
        let other = q;
        q = r;
        r = other;
    }
    let limits = vec3i(limit(q - p), limit(r - q), limit(p - r));
    let here = vec3i(cross_of(q - p, -p), cross_of(r - q, -q), cross_of(p - r, -r));
    let right = 256 * vec3i(p.y - q.y, q.y - r.y, r.y - p.y);
    let down = 256 * vec3i(q.x - p.x, r.x - q.x, p.x - r.x);
    return Inside(here, right, down - box.size.x * right, limits, abs(area), area < 0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let at = places_of(id, params.row0);
    let box = box_of(at, vec2i(params.width, params.rows));
    let size = box.size;
    let triangle = inside_of(at, box);
    if (triangle.area == 0 || size.x < 0 || size.y < 0) { return; }
    let depth = select(at.depth, at.depth.xzy, triangle.turned);
    var inside = triangle.here;
    let slope = (depth.zy - depth.xx) / f32(triangle.area);
    let last = u64(~id);
    var pixel = box.low.y * params.width + box.low.x;
    var column = 0;
    var left = (size.x + 1) * (size.y + 1);
    loop {
        if (all(inside > triangle.limits)) {
            let z = max(depth.x + dot(slope, vec2f(inside.xz)), 0.0);
            atomicMax(&nearest[pixel], (u64(bitcast<u32>(z)) << 32u) | last);
        }
        let end = column == size.x;
        inside += select(triangle.right, triangle.next, end);
        pixel += select(1, params.width - size.x, end);
        column = select(column + 1, 0, end);
        left--;
        if (left <= 0) { break; }
    }
}

// (lower, upper half) of each pixel
@group(0) @binding(4) var<storage, read> found: array<vec2u>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}
// The number + 1 of the triangle that a pixel sees, or 0.
@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) u32 {
    let pixel = vec2i(at.xy);
    return 0u - found[pixel.y * params.width + pixel.x].x;
}
