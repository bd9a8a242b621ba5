// Pixels of tiles in which a lamp is hidden, or half: their light again, with its visible share.
// One workgroup per tile. What shade.wgsl found is scaled by how much less light matte surfaces get;
// with glossy ones in view it left the paint's albedo in `marks`.
#import common/surface
#import common/undistort

// 1: what is there was lit by all lamps, 2: by those that light some of the tile; 0 forgets it
override scaled: u32;
// whether no lamp is half hidden from these tiles
override whole: u32;

struct Params {
    rays: Rays,
    width: u32,
    stride: u32,
    row0: i32,
    rows: i32,
    first: u32,
    count: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> radiance: array<f32>;
// triangle + 1 of every pixel of the band and, unless `scaled`, its albedo in 1 / 2^32
@group(0) @binding(6) var marks: texture_2d<u32>;
// row and column of every such tile
@group(0) @binding(7) var<storage, read> places: array<vec2u>;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(local_invocation_id) local: vec3u,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group.y * groups.x + group.x;
    if (number >= params.count) { return; }
    let place = places[params.first + number];
    let pixel = vec2i(i32(8u * place.y + local.x), i32(8u * place.x + local.y));
    let row = pixel.y - params.row0;
    if (row < 0 || row >= params.rows || u32(pixel.x) >= params.width) { return; }
    let mark = textureLoad(marks, vec2i(pixel.x, row), 0);
    if (mark.x == 0u) { return; }
    let t = triangle_at(mark.x - 1u);
    let bend = bend_at(pixel);
    let shift = undistort(bend, vec2f(0.0));
    let d = vec2f(pixel - t.place.xy) + shift;
    let extent = undistort_change(bend);
    let at = vec2f(pixel) + shift;
    var seen: Seen;
    if (whole != 0u) {
        seen.r = reflection_at(t, params.rays, at, d, shadow_tile(pixel).x);
        seen.whole = vec2f(reflection_at(t, params.rays, at, d, 0xffffffffu).matte);
    } else {
        seen = reflection_seen_at(t, params.rays, at, d, extent, shadow_tile(pixel));
    }
    let i = u32(row) * params.stride + u32(pixel.x);
    if (scaled != 0u) {
        let whole = select(seen.whole.y, seen.whole.x, scaled == 1u);
        radiance[i] *= select(0.0, seen.r.matte / whole, whole > 0.0);
        return;
    }
    // glossy paints share the word: albedo and the share of the ground, 16 bits each
    let both = unpack2x16unorm(mark.y);
    let shiny = glossy != 0u && t.more.z < 1.0;
    let albedo = select(f32(mark.y) * 0x1p-32, both.x, shiny);
    let ground = select(t.more.x, albedo, t.more.y > 1.0);
    radiance[i] = radiance_of(t, seen.r, albedo, ground, both.y);
}
