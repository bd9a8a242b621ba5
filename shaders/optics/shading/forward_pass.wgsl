// Radiance of every pixel whose centre is hit: the closed-form mean of the paint over the pixel's
// footprint times the light at its centre. Pixels that an edge crosses are redone by resolve.wgsl.
//
// All that a large triangle's pixels share travels in flat varyings, which cost nothing per pixel.
// Where triangles are small, that and the pixels beside them that are shaded in vain cost more than
// the picture: which one each pixel sees is found first (compute_raster.wgsl or id_buffer.wgsl), then every
// pixel reads its own one's record, or an invocation per triangle shades the triangle's own pixels.
#import lib/paint/bitmap
#import lib/paint/checker_lines
#import lib/light/glance
#import lib/numeric/index
#import lib/paint/feature_grid
#import lib/raster/pixel_box
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
// the triangles to draw, from near to far
@group(0) @binding(8) var<storage, read> order: array<u32>;

// per tile of 8 x 8 px its light (tile_light.wgsl), for triangles of large planes
@group(0) @binding(11) var light_tiles: texture_2d<f32>;

struct Varying {
    // large triangles are drawn where id_buffer.wgsl found them
    @invariant @builtin(position) position: vec4f,
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
fn shade(t: Triangle, paint: Paint, lattice: Board, at: vec2i) -> vec3f {
    let pixel = at + vec2i(0, params.row0);
    let bend = bend_at(pixel);
    let shift = undistort(bend, vec2f(0.0));
    let d = vec2f(pixel - t.place.xy) + shift;
    var albedo = t.more.x;
    if (patterned != 0u) {
        let f = bent_footprint(footprint(t, d), undistort_change(bend));
        if (bitmaps != 0u) {
            let size = vec2i(paint.columns, paint.rows);
            let bitmap = Bitmap(t.place.zw, size, paint.first, paint.i0);
            albedo = bitmap_pixel(bitmap, t.more.x, f.st, f.ex, f.ey, f.q);
        } else if (board != 0u) {
            albedo = board_pixel(lattice, t.more.x, f.st, f.ex, f.ey, f.q);
        } else {
            albedo = paint_pixel(paint, t.place.zw, f.st, f.ex, f.ey, f.q);
        }
    }
    if (lit == 0u) { return vec3f(albedo, albedo, 1.0); }
    var r = Reflection(0.0, 0.0, 0.0);
    if (light_tiled != 0u) {
        let tile = vec2u(pixel) / 8u;
        let columns = (u32(params.width) + 7u) / 8u;
        let c = textureLoad(light_tiles, texel(tile.y * columns + tile.x), 0);
        let q = (vec2f(vec2u(pixel) % 8u) + 0.5) / 8.0;
        r.matte = c.x + c.y * q.x + (c.z + c.w * q.x) * q.y;
    } else {
        r = reflection_at(t, params.rays, vec2f(pixel) + shift, d);
    }
    let ground = select(t.more.x, albedo, speckle != 0u || bitmaps != 0u);
    let bare = clamp(1.0 - printed, 0.0, 1.0);
    return vec3f(radiance_of(t, r, albedo, ground, bare), albedo, bare);
}

fn shade_inside(in: Varying) -> vec3f {
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
struct Marked {
    @location(0) radiance: f32,
    @location(1) mark: vec2u,
}
fn marked(s: vec3f, number: u32) -> Marked {
    var mark = u32(s.y * 4294967040.0);
    if (glossy != 0u) { mark = pack2x16unorm(s.yz); }
    return Marked(s.x, vec2u(number, mark));
}

struct Numbered {
    @location(0) radiance: f32,
    @location(1) number: u32,
}

@fragment
fn fragment(in: Varying) -> @location(0) f32 {
    return shade_inside(in).x;
}
@fragment
fn fragment_marked(in: Varying) -> Marked {
    return marked(shade_inside(in), in.id + 1u);
}
@fragment
fn fragment_numbered(in: Varying) -> Numbered {
    return Numbered(shade_inside(in).x, in.id + 1u);
}

// number + 1 of the triangle that each pixel's centre sees
@group(0) @binding(9) var ids: texture_2d<u32>;

// Of a large triangle the pixels that see it, where small ones are shaded pixel by pixel.
fn is_seen(in: Varying) -> bool {
    return textureLoad(ids, vec2u(in.position.xy), 0).x == in.id + 1u;
}
@fragment
fn fragment_own(in: Varying) -> @location(0) f32 {
    if (!is_seen(in)) { discard; }
    return shade_inside(in).x;
}
@fragment
fn fragment_own_marked(in: Varying) -> Marked {
    if (!is_seen(in)) { discard; }
    return marked(shade_inside(in), in.id + 1u);
}

// per triangle a byte, which program it has; sixteen of them a texel
@group(0) @binding(10) var levels: texture_2d<u32>;

// All of the band, at the depth of one program.
@vertex
fn vertex_band(@builtin(vertex_index) index: u32) -> @invariant @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, params.level, 1.0);
}
// The same of some tiles of the picture, whose column and row are 16 bits each of `order`.
const TILE: i32 = 32;
@vertex
fn vertex_tiles(@builtin(vertex_index) index: u32) -> @invariant @builtin(position) vec4f {
    let tile = order[index / 6u];
    let k = index % 6u;
    // the second triangle has the corners of the first, turned round
    let own = select(k, k - 3u, k > 2u);
    let turned = select(0u, 1u, k > 2u);
    let corner = vec2u(own & 1u, own >> 1u) ^ vec2u(turned);
    let at = TILE * vec2i(vec2u(tile & 0xffffu, tile >> 16u) + corner) - vec2i(0, params.row0);
    let place = 2.0 * vec2f(at) / vec2f(params.width, params.rows) - 1.0;
    return vec4f(place.x, -place.y, params.level, 1.0);
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

fn shade_seen(at: vec4f, number: u32) -> vec3f {
    let t = triangle_at(max(number, 1u) - 1u);
    let paint = paint_at(u32(t.ny.w));
    let none = Board(vec2f(0.0), vec2f(0.0), vec2f(0.0), 1.0, vec2f(0.0), 0.0);
    return shade(t, paint, none, vec2i(floor(at.xy)));
}
@fragment
fn fragment_seen(@builtin(position) at: vec4f) -> @location(0) f32 {
    return shade_seen(at, textureLoad(ids, vec2u(at.xy), 0).x).x;
}
@fragment
fn fragment_seen_marked(@builtin(position) at: vec4f) -> Marked {
    let number = textureLoad(ids, vec2u(at.xy), 0).x;
    return marked(shade_seen(at, number), number);
}

// -- triangle by triangle ----------------------------------------------------------------------

struct Band {
    // of the triangles to shade, whose numbers + 1 are in `order` (0 where there is none)
    count: u32,
    // from one row of `band_radiance` to the next
    stride: i32,
}
@group(0) @binding(13) var<uniform> band: Band;
// per pixel of the band what compute_raster.wgsl found, the lower half first
@group(0) @binding(14) var<storage, read> band_nearest: array<vec2u>;
// bits of the radiance
@group(0) @binding(15) var<storage, read_write> band_radiance: array<u32>;

fn band_size() -> vec2i {
    return vec2i(vec2f(params.width, params.rows));
}

// 1: triangles left marks on their own pixels (optics/shading/glance.wgsl), in `band_radiance`
override signed: u32 = 0u;

// From one row to the next of what tells which triangle a pixel sees.
fn row_length() -> i32 {
    return select(band_size().x, band.stride, signed != 0u);
}
fn sees(pixel: i32, id: u32) -> bool {
    if (signed != 0u) { return band_radiance[pixel] == (MARK | id); }
    return band_nearest[pixel].x == ~id;
}

// Where a walk over a box, row by row, has come to: the pixel of the band, and the column of the box.
struct Walk {
    pixel: i32,
    column: i32,
}
// Which of the next pixels of its box see a triangle; `many` is at most 32.
fn seen_bits(id: u32, box: Box, many: i32, walk: ptr<function, Walk>) -> u32 {
    let turn = row_length() - box.size.x;
    var bits = 0u;
    var k = 0;
    loop {
        if (k < many && sees((*walk).pixel, id)) { bits |= 1u << u32(k); }
        let end = (*walk).column == box.size.x;
        (*walk).pixel += select(1, turn, end);
        (*walk).column = select((*walk).column + 1, 0, end);
        k++;
        if (k >= many) { break; }
    }
    return bits;
}

// A triangle's own pixels, looked for 32 at a time, so that what costs is done for them alone.
@compute @workgroup_size(64)
fn own_pixels(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= band.count) { return; }
    let number = order[i];
    if (number == 0u) { return; }
    let id = number - 1u;
    let t = triangle_at(id);
    let paint = paint_at(u32(t.ny.w));
    let none = Board(vec2f(0.0), vec2f(0.0), vec2f(0.0), 1.0, vec2f(0.0), 0.0);
    let box = box_of(places_of(id, params.row0), band_size());
    let columns = box.size.x + 1;
    let share = 1.0 / f32(columns);
    let count = select(columns * (box.size.y + 1), 0, any(box.size < vec2i(0)));
    var walk = Walk(box.low.y * row_length() + box.low.x, 0);
    var first = 0;
    loop {
        var bits = seen_bits(id, box, min(count - first, 32), &walk);
        loop {
            if (bits != 0u) {
                let n = first + i32(firstTrailingBit(bits));
                let row = i32((f32(n) + 0.5) * share);
                let at = box.low + vec2i(n - row * columns, row);
                printed = 0.0;
                band_radiance[at.y * band.stride + at.x] = bitcast<u32>(shade(t, paint, none, at).x);
            }
            bits &= bits - 1u;
            if (bits == 0u) { break; }
        }
        first += 32;
        if (first >= count) { break; }
    }
}

// The same on chessboards whose light is known as a function of the pixel: most pixels lie within a
// field, and the closed form is for those alone whose footprints reach over a line.
@compute @workgroup_size(64)
fn own_fields(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= band.count) { return; }
    let number = order[i];
    if (number == 0u) { return; }
    let id = number - 1u;
    let light = glance_at(id);
    if (light.none) { return; }
    let t = triangle_at(id);
    let lattice = board_of(paint_at(u32(t.ny.w)), t.place.zw);
    let squares = squares_of(lattice);
    let box = box_of(places_of(id, params.row0), band_size());
    let columns = box.size.x + 1;
    let share = 1.0 / f32(columns);
    let count = select(columns * (box.size.y + 1), 0, any(box.size < vec2i(0)));
    var walk = Walk(box.low.y * row_length() + box.low.x, 0);
    var first = 0;
    loop {
        var bits = seen_bits(id, box, min(count - first, 32), &walk);
        var lines = 0u;
        loop {
            if (bits != 0u) {
                let bit = firstTrailingBit(bits);
                let own = own_pixel(t, light, lattice, first + i32(bit), columns, share, box.low);
                let field = field_at(lattice, t.more.x, own.at, own.f.ex, own.f.ey, own.f.q);
                band_radiance[own.place] = bitcast<u32>(field.albedo * own.light);
                if (field.line) { lines |= 1u << bit; }
            }
            bits &= bits - 1u;
            if (bits == 0u) { break; }
        }
        loop {
            if (lines != 0u) {
                let n = first + i32(firstTrailingBit(lines));
                let own = own_pixel(t, light, lattice, n, columns, share, box.low);
                let s = checker_share(squares, own.at, own.f.ex, own.f.ey, own.f.q);
                let albedo = t.more.x + (s.x - t.more.x * s.y);
                band_radiance[own.place] = bitcast<u32>(albedo * own.light);
            }
            lines &= lines - 1u;
            if (lines == 0u) { break; }
        }
        first += 32;
        if (first >= count) { break; }
    }
}

// A pixel of a box: where it lies on a board and in the image, its footprint, and its light.
struct OwnPixel {
    at: vec2f,
    f: Footprint,
    light: f32,
    place: i32,
}
fn own_pixel(
    t: Triangle, glance: Glance, lattice: Board, n: i32, columns: i32, share: f32, low: vec2i
) -> OwnPixel {
    let row = i32((f32(n) + 0.5) * share);
    let at = low + vec2i(n - row * columns, row);
    let pixel = at + vec2i(0, params.row0);
    let bend = bend_at(pixel);
    let d = vec2f(pixel - t.place.xy) + undistort(bend, vec2f(0.0));
    let f = bent_footprint(footprint(t, d), undistort_change(bend));
    return OwnPixel(f.st - lattice.corner, f, glance_of(glance, d), at.y * band.stride + at.x);
}
