// Radiance of every pixel whose centre is hit: the closed-form mean of the paint over the pixel's
// footprint times the light at its centre. Pixels that an edge crosses are redone by edges.wgsl.
//
// All that a triangle's pixels share travels in flat varyings, which cost nothing per pixel.
#import common/bitmap
#import common/paint
#import common/screen
#import common/surface
#import common/undistort

override lit: u32;
override patterned: u32;

struct Params {
    rays: Rays,
    width: f32,
    rows: f32,
    row0: i32,
    near: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> paints: array<Paint>;
@group(0) @binding(4) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(6) var<storage, read> screen: array<vec2i>;
@group(0) @binding(7) var<storage, read> inverse_depth: array<f32>;
// the triangles to draw, from near to far
@group(0) @binding(8) var<storage, read> order: array<u32>;

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) st: vec4f,
    @location(1) @interpolate(flat, either) tw: vec4f,
    @location(2) @interpolate(flat, either) n0: vec4f,
    @location(3) @interpolate(flat, either) nx: vec4f,
    @location(4) @interpolate(flat, either) ny: vec4f,
    @location(5) @interpolate(flat, either) place: vec4i,
    @location(6) @interpolate(flat, either) more: vec4f,
    @location(7) @interpolate(flat, either) grid: vec4i,
    @location(8) @interpolate(flat, either) grid_size: vec4f,
    @location(9) @interpolate(flat, either) id: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let id = order[index / 3u];
    let corner = 3u * id + index % 3u;
    let depth = params.near * inverse_depth[corner];
    let size = vec2f(params.width, params.rows);
    let position = band_position(screen[corner], params.row0, size, depth);
    let t = triangles[id];
    let paint = paints[u32(t.ny.w)];
    return Varying(
        position, t.st, t.tw, t.n0, t.nx, t.ny, t.place, t.more,
        vec4i(paint.i0, paint.j0, paint.columns, paint.rows),
        vec4f(paint.cell, bitcast<f32>(paint.first), paint.dot, f32(paint.cuts)),
        id,
    );
}

// Radiance and albedo of the pixel, and the share of it that shows the paint's ground.
fn shade(in: Varying) -> vec3f {
    let t = Triangle(in.st, in.tw, in.n0, in.nx, in.ny, in.place, in.more);
    let pixel = vec2i(floor(in.position.xy)) + vec2i(0, params.row0);
    let bend = bend_at(pixel);
    let shift = undistort(bend, vec2f(0.0));
    let d = vec2f(pixel - t.place.xy) + shift;
    var albedo = t.more.x;
    if (patterned != 0u) {
        let f = bent_footprint(footprint(t, d), undistort_change(bend));
        let g = in.grid;
        let paint = Paint(t.more.x, in.grid_size.x, g.x, g.y, g.z, g.w,
            bitcast<u32>(in.grid_size.y), 1u, in.grid_size.z, u32(in.grid_size.w));
        if (bitmaps != 0u) {
            let bitmap = Bitmap(t.place.zw, g.zw, paint.first, g.x);
            albedo = bitmap_pixel(bitmap, t.more.x, f.st, f.ex, f.ey, f.q);
        } else {
            albedo = paint_pixel(paint, t.place.zw, f.st, f.ex, f.ey, f.q);
        }
    }
    if (lit == 0u) { return vec3f(albedo, albedo, 1.0); }
    var bits = 0u;
    if (shadowed != 0u) { bits = shadow_tile(pixel).x; }
    let r = reflection_at(t, params.rays, vec2f(pixel) + shift, d, bits);
    let ground = select(t.more.x, albedo, speckle != 0u || bitmaps != 0u);
    let bare = clamp(1.0 - printed, 0.0, 1.0);
    return vec3f(radiance_of(t, r, albedo, ground, bare), albedo, bare);
}

@fragment
fn fragment(in: Varying) -> @location(0) f32 {
    return shade(in).x;
}

// The same for views with shadows: marks what shadow.wgsl needs to know of each pixel.
struct Marked {
    @location(0) radiance: f32,
    @location(1) mark: vec2u,
}
@fragment
fn fragment_marked(in: Varying) -> Marked {
    let s = shade(in);
    var mark = u32(s.y * 4294967040.0);
    if (glossy != 0u) { mark = pack2x16unorm(s.yz); }
    return Marked(s.x, vec2u(in.id + 1u, mark));
}
