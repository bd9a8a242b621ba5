// The light on a small matte triangle as a function of the pixel (gpusim/optics/shading/glance.py).
#import lib/numeric/texel

// 0: affine, a texel per triangle; 1: of second degree, two
override quadratic: u32 = 0u;

// In place of the anchor of a triangle that has no such function.
const NONE: u32 = 0x80008000u;

// On a pixel that a triangle of this number (below 2^22) shades one by one: no number that it may have.
const MARK: u32 = 0xffc00000u;

// per triangle its value at an anchor, its change per column and per row, the anchor's column (lower
// half) and row; then its part of second degree, per column squared, column and row, row squared
@group(0) @binding(42) var seen: texture_storage_2d<rgba32uint, read>;

struct Glance {
    affine: vec3f,
    bend: vec3f,
    anchor: vec2i,
    none: bool,
}
fn glance_at(id: u32) -> Glance {
    let a = textureLoad(seen, texel((1u + quadratic) * id));
    let anchor = vec2i(i32(a.w << 16u), i32(a.w)) >> vec2u(16u);
    var bend = vec3f(0.0);
    if (quadratic != 0u) { bend = bitcast<vec3f>(textureLoad(seen, texel((1u + quadratic) * id + 1u)).xyz); }
    return Glance(bitcast<vec3f>(a.xyz), bend, anchor, a.w == NONE);
}

// Its value at an offset from the anchor, px of the ideal image.
fn glance_of(g: Glance, d: vec2f) -> f32 {
    if (quadratic == 0u) { return g.affine.x + dot(g.affine.yz, d); }
    return g.affine.x + d.x * (g.affine.y + g.bend.x * d.x + g.bend.y * d.y)
        + d.y * (g.affine.z + g.bend.z * d.y);
}
