// Which triangle each pixel's centre sees, where triangles are small: an invocation per triangle
// walks over the few pixels of its box. Rasterisers set triangles up one after another, which takes
// several times as long as so few pixels do. Writes the same numbers as id_buffer.wgsl.
// Described in gpusim/optics/raster/compute_raster.py.
#import lib/numeric/index
#import lib/raster/point_in_triangle

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
