// Pixels that don't see all of every lamp: their light again, with its visible shares.
// What shade.wgsl found is scaled by how much less light matte surfaces get; with glossy ones in view
// it left the paint's albedo in `marks`. The NumPy form is gpusim/optics/relit.py.
#import common/lamp_shares
#import common/surface
#import common/undistort

// whether all is matte
override scaled: u32;

struct Params {
    rays: Rays,
    width: u32,
    rows: u32,
    stride: u32,
    row0: i32,
    casting: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> radiance: array<f32>;
// triangle + 1 of every pixel of the band and, unless `scaled`, its albedo in 1 / 2^32
@group(0) @binding(6) var marks: texture_2d<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) gid: vec3u) {
    if (gid.x >= params.width || gid.y >= params.rows) { return; }
    let known = Known(gid.y * params.width + gid.x, params.width * params.rows, params.casting);
    var left = params.casting;
    var seen = true;
    loop {
        if (left == 0u) { break; }
        seen = seen && known_share(known, firstTrailingBit(left)) == 1.0;
        left &= left - 1u;
    }
    if (seen) { return; }
    let mark = textureLoad(marks, gid.xy, 0);
    if (mark.x == 0u) { return; }
    let pixel = vec2i(gid.xy) + vec2i(0, params.row0);
    let t = triangle_at(mark.x - 1u);
    let shift = undistort(bend_at(pixel), vec2f(0.0));
    let s = spot(t, params.rays, vec2f(pixel) + shift, vec2f(pixel - t.place.xy) + shift);
    let lit = reflection_known(s.x, s.n, gloss_at(t, s), openness_at(t.id, s.x), known);
    let i = gid.y * params.stride + gid.x;
    if (scaled != 0u) {
        radiance[i] *= select(0.0, lit.r.matte / lit.whole, lit.whole > 0.0);
        return;
    }
    // glossy paints share the word: albedo and the share of the ground, 16 bits each
    let both = unpack2x16unorm(mark.y);
    let shiny = glossy != 0u && t.more.z < 1.0;
    let albedo = select(f32(mark.y) * 0x1p-32, both.x, shiny);
    let ground = select(t.more.x, albedo, t.more.y > 1.0);
    radiance[i] = radiance_of(t, lit.r, albedo, ground, both.y);
}
