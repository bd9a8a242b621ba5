// Which triangle each pixel's centre sees. Writes the triangle's number + 1; 0 is background.
// The NumPy form is gpusim/optics/visibility_buffer.py.
#import lib/raster/screen

struct Params {
    width: f32,
    rows: f32,
    row0: i32,
    near: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> screen: array<vec2i>;
@group(0) @binding(2) var<storage, read> inverse_depth: array<f32>;
// three vertices per triangle
@group(0) @binding(6) var<storage, read> corners: array<u32>;

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) id: u32,
}

fn corner_of(id: u32, k: u32) -> Varying {
    let corner = corners[3u * id + k];
    let depth = params.near * inverse_depth[corner];
    let size = vec2f(params.width, params.rows);
    return Varying(band_position(screen[corner], params.row0, size, depth), id + 1u);
}
@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    return corner_of(index / 3u, index % 3u);
}

// the triangles of a band
@group(0) @binding(7) var<storage, read> order: array<u32>;
@vertex
fn vertex_some(@builtin(vertex_index) index: u32) -> Varying {
    return corner_of(order[index / 3u], index % 3u);
}

@fragment
fn fragment(in: Varying) -> @location(0) u32 {
    return in.id;
}

struct Copy {
    width: u32,
    rows: u32,
}
@group(0) @binding(3) var<uniform> copy: Copy;
@group(0) @binding(4) var ids: texture_2d<u32>;
@group(0) @binding(5) var<storage, read_write> result: array<u32>;

// Copies the id texture into a buffer that the host can read.
@compute @workgroup_size(64, 4)
fn read_ids(@builtin(global_invocation_id) gid: vec3u) {
    if (gid.x >= copy.width || gid.y >= copy.rows) { return; }
    result[gid.y * copy.width + gid.x] = textureLoad(ids, vec2i(gid.xy), 0).x;
}
