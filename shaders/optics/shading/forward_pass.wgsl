// Radiance of every pixel whose centre is hit: the closed-form mean of the paint over the pixel's
// footprint times the light at its centre. Pixels that an edge crosses are redone by resolve.wgsl.
//
// All that a large triangle's pixels share travels in flat varyings, which cost nothing per pixel.
// Where triangles are small, that and the pixels beside them that are shaded in vain cost more than
// the picture: which one each pixel sees is found first (id_buffer.wgsl), then every pixel reads its
// own one's record.
// The NumPy form is gpusim/optics/shading/shading_pass.py.
#import lib/paint/bitmap
#import lib/paint/checker_lines
#import lib/paint/feature_grid
#import lib/raster/planes
#import lib/raster/screen
#import lib/light/surface
#import lib/raster/undistortion_table

override lit: u32;
override patterned: u32;
override light_tiled: u32;

struct Params {
    rays: Rays,
    width: f32,
    rows: f32,
    row0: i32,
    near: f32,
    level: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(6) var<storage, read> screen: array<vec2i>;
@group(0) @binding(7) var<storage, read> inverse_depth: array<f32>;
// three vertices per triangle
@group(0) @binding(12) var<storage, read> corners: array<u32>;
// the triangles to draw, from near to far
@group(0) @binding(8) var<storage, read> order: array<u32>;

// per tile of 8 x 8 px its light (tile_light.wgsl), for triangles of large planes
@group(0) @binding(11) var light_tiles: texture_2d<f32>;

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
    @location(10) @interpolate(flat, either) pieces: vec4f,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let id = order[index / 3u];
    let corner = corners[3u * id + index % 3u];
    let depth = params.near * inverse_depth[corner];
    let size = vec2f(params.width, params.rows);
    let position = band_position(screen[corner], params.row0, size, depth);
    let t = triangle_at(id);
    let paint = paint_at(u32(t.ny.w));
    var out = Varying(
        position, t.st, t.tw, t.n0, t.nx, t.ny, t.place, t.more,
        vec4i(paint.i0, paint.j0, paint.columns, paint.rows),
        vec4f(paint.cell, bitcast<f32>(paint.first), paint.dot, f32(paint.cuts)),
        id,
        vec4f(paint.piece, paint.longest, paint.coverage, f32(paint.featured)),
    );
    if (board != 0u) {
        // these don't look into the paint's table
        let lattice = board_of(paint, t.place.zw);
        out.grid = bitcast<vec4i>(vec4f(lattice.corner, lattice.index));
        out.grid_size = vec4f(lattice.size, lattice.albedo, lattice.covers);
        out.pieces = vec4f(lattice.squares, 0.0, out.pieces.w);
    }
    return out;
}

// Radiance and albedo of a pixel, and the share of it that shows the paint's ground.
struct Shade {
    radiance: Color,
    albedo: Color,
    bare: f32,
}
fn shade(t: Triangle, paint: Paint, lattice: Board, at: vec2i) -> Shade {
    let pixel = at + vec2i(0, params.row0);
    let bend = bend_at(pixel);
    let shift = undistort(bend, vec2f(0.0));
    let d = vec2f(pixel - t.place.xy) + shift;
    let plain = ground_of(t);
    var albedo = plain;
    if (patterned != 0u) {
        let f = bent_footprint(footprint(t, d), undistort_change(bend));
        if (bitmaps != 0u) {
            let size = vec2i(paint.columns, paint.rows);
            let bitmap = Bitmap(t.place.zw, size, paint.first, paint.i0);
            albedo = bitmap_pixel(bitmap, plain, f.st, f.ex, f.ey, f.q);
        } else if (board != 0u) {
            albedo = board_pixel(lattice, plain, f.st, f.ex, f.ey, f.q);
        } else {
            albedo = paint_pixel(paint, t.place.zw, f.st, f.ex, f.ey, f.q);
        }
    }
    if (lit == 0u) { return Shade(albedo, albedo, 1.0); }
    var r = Reflection(Color(0.0), Color(0.0), Color(0.0));
    if (light_tiled != 0u) {
        let tile = vec2u(pixel) / 8u;
        let columns = (u32(params.width) + 7u) / 8u;
        let q = (vec2f(vec2u(pixel) % 8u) + 0.5) / 8.0;
        let first = BANDS * (tile.y * columns + tile.x);
        for (var k = 0u; k < BANDS; k++) {
            let c = textureLoad(light_tiles, texel(first + k), 0);
            r.matte = with_band(r.matte, k, c.x + c.y * q.x + (c.z + c.w * q.x) * q.y);
        }
    } else {
        r = reflection_at(t, params.rays, vec2f(pixel) + shift, d);
    }
    let ground = select(plain, albedo, speckle != 0u || bitmaps != 0u);
    let bare = clamp(1.0 - printed, 0.0, 1.0);
    return Shade(radiance_of(t, r, albedo, ground, bare), albedo, bare);
}

fn shade_inside(in: Varying) -> Shade {
    let t = Triangle(in.st, in.tw, in.n0, in.nx, in.ny, in.place, in.more, in.id);
    let g = in.grid;
    let paint = Paint(t.more.x, in.grid_size.x, g.x, g.y, g.z, g.w, bitcast<u32>(in.grid_size.y),
        u32(in.pieces.w), in.grid_size.z, u32(in.grid_size.w),
        in.pieces.x, in.pieces.y, in.pieces.z);
    let corner = bitcast<vec4f>(g);
    let size = in.grid_size;
    let lattice = Board(corner.xy, corner.zw, in.pieces.xy, size.x, size.yz, size.w);
    return shade(t, paint, lattice, vec2i(floor(in.position.xy)));
}

// For views with shadows: marks what relighting.wgsl needs to know of each pixel, its triangle alone
// where all is matte.
fn marked(s: Shade, number: u32) -> MarkedPixel {
    return marked_pixel(s.radiance, number, s.albedo, s.bare, glossy != 0u);
}

@fragment
fn fragment(in: Varying) -> Pixel {
    return pixel_of(shade_inside(in).radiance);
}
@fragment
fn fragment_marked(in: Varying) -> MarkedPixel {
    return marked(shade_inside(in), in.id + 1u);
}
@fragment
fn fragment_numbered(in: Varying) -> NumberedPixel {
    return numbered_pixel(shade_inside(in).radiance, in.id + 1u);
}

// number + 1 of the triangle that each pixel's centre sees
@group(0) @binding(9) var ids: texture_2d<u32>;

// per triangle a byte, which program it has; sixteen of them a texel
@group(0) @binding(10) var levels: texture_2d<u32>;

// All of the band, at the depth of one program.
@vertex
fn vertex_band(@builtin(vertex_index) index: u32) -> @invariant @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, params.level, 1.0);
}
// Depths by program: each then draws the band where they equal its own.
const LEVELS: f32 = 64.0;
@fragment
fn fragment_levels(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {
    let number = textureLoad(ids, vec2u(at.xy), 0).x;
    let i = max(number, 1u) - 1u;
    let four = textureLoad(levels, texel(i / 16u), 0);
    // no array: what is indexed by a variable goes through memory
    let two = select(four.xy, four.zw, (i & 8u) != 0u);
    let one = select(two.x, two.y, (i & 4u) != 0u);
    let program = (one >> (8u * (i & 3u))) & 255u;
    return select(0.0, f32(program) / LEVELS, number > 0u);
}

fn shade_seen(at: vec4f, number: u32) -> Shade {
    let t = triangle_at(max(number, 1u) - 1u);
    let paint = paint_at(u32(t.ny.w));
    let none = Board(vec2f(0.0), vec2f(0.0), vec2f(0.0), 1.0, vec2f(0.0), 0.0);
    return shade(t, paint, none, vec2i(floor(at.xy)));
}
@fragment
fn fragment_seen(@builtin(position) at: vec4f) -> Pixel {
    return pixel_of(shade_seen(at, textureLoad(ids, vec2u(at.xy), 0).x).radiance);
}
@fragment
fn fragment_seen_marked(@builtin(position) at: vec4f) -> MarkedPixel {
    let number = textureLoad(ids, vec2u(at.xy), 0).x;
    return marked(shade_seen(at, number), number);
}
