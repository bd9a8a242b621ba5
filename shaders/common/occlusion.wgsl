// Which share of a lamp a point sees: the outlines of the faces between, on a mask of 16 x 32
// samples. The NumPy form is gpusim/optics/occlusion.py, which explains it; the tables are made by
// gpusim/optics/shadow_tiles.py.
#import common/texel

override shadowed: u32;

// centre (w: 1 if it is near, 0 for a direction), half sides u (w: 1 if it has a size) and v (w:
// the number of its samples), part = (first emitter, last + 1, -, -), samples on its face.
struct LampFace {
    centre: vec4f,
    u: vec4f,
    v: vec4f,
    part: vec4u,
    mask: array<vec4u, 4>,
}
// rows: per row of samples a and b of the first one, and the pixel offset that it looks from
struct Shades {
    count: u32,
    columns: u32,
    mask_rows: u32,
    tolerance: f32,
    rows: array<vec4f, 16>,
    lamps: array<LampFace, 16>,
}
@group(0) @binding(60) var<uniform> shades: Shades;
// four corners per face, relative to the eye; the first one's w is 1 if its inside hides as well
@group(0) @binding(61) var occluders: texture_2d<f32>;
// per tile in half shadow a texel per lamp (first, count, -, -), then the faces, four a texel
@group(0) @binding(62) var shadow_lists: texture_2d<u32>;
// per tile of 8 x 8 px (bits of the lamps that light it, number among the half shadowed + 1, -, -)
@group(0) @binding(63) var shadow_tiles: texture_2d<u32>;

const STEP_A: f32 = 0.0625;
const STEP_B: f32 = 0.00390625;

fn shadow_tile(pixel: vec2i) -> vec2u {
    let tile = vec2u(pixel) / 8u;
    return textureLoad(shadow_tiles, texel(tile.y * shades.columns + tile.x), 0).xy;
}

// n low bits
fn low_bits(n: u32) -> u32 {
    return select((1u << (n & 31u)) - 1u, 0xffffffffu, n >= 32u);
}

fn lamp_share(l: u32, x: vec3f, dx: vec3f, dy: vec3f, tile: vec2u) -> f32 {
    let lit = f32((tile.x >> l) & 1u);
    if (tile.y == 0u) { return lit; }
    let list = textureLoad(shadow_lists, texel((tile.y - 1u) * shades.count + l), 0);
    if (list.y == 0u) { return lit; }
    let lamp = shades.lamps[l];
    let to = lamp.centre.xyz - lamp.centre.w * x;
    let tolerance = shades.tolerance * length(x);
    var covered: array<u32, 16>;
    for (var r = 0u; r < shades.mask_rows; r++) { covered[r] = 0u; }
    for (var i = list.x; i < list.x + list.y; i++) {
        let face = 4u * textureLoad(shadow_lists, texel(i >> 2u), 0)[i & 3u];
        let first = textureLoad(occluders, texel(face), 0);
        let d0 = first.xyz - x;
        let d1 = textureLoad(occluders, texel(face + 1u), 0).xyz - x;
        let d2 = textureLoad(occluders, texel(face + 2u), 0).xyz - x;
        let d3 = textureLoad(occluders, texel(face + 3u), 0).xyz - x;
        let n0 = cross(d0, d1);
        let n1 = cross(d1, d2);
        let n2 = cross(d2, d3);
        let n3 = cross(d3, d0);
        let normal = n0 + n1 + n2 + n3;
        let height = 0.25 * dot(normal, d0 + d1 + d2 + d3);
        let side = select(-1.0, 1.0, height > 0.0);
        let above = select(-height, abs(height), first.w != 0.0);
        let apart = side * (dot(normal, to) - lamp.centre.w * height);
        let a4 = vec4f(dot(n0, lamp.u.xyz), dot(n1, lamp.u.xyz), dot(n2, lamp.u.xyz),
            dot(n3, lamp.u.xyz));
        let b4 = vec4f(dot(n0, lamp.v.xyz), dot(n1, lamp.v.xyz), dot(n2, lamp.v.xyz),
            dot(n3, lamp.v.xyz));
        let reach = abs(a4.x + a4.y + a4.z + a4.w) + abs(b4.x + b4.y + b4.z + b4.w);
        var use_rows = above > tolerance * length(normal) && apart + reach > 0.0;
        // where the sample lattice is on the lamp, it is in part on the pixel
        let g0 = cross(to, d1 - d0) - lamp.centre.w * n0;
        let g1 = cross(to, d2 - d1) - lamp.centre.w * n1;
        let g2 = cross(to, d3 - d2) - lamp.centre.w * n2;
        let g3 = cross(to, d0 - d3) - lamp.centre.w * n3;
        let gx = vec4f(dot(g0, dx), dot(g1, dx), dot(g2, dx), dot(g3, dx));
        let gy = vec4f(dot(g0, dy), dot(g1, dy), dot(g2, dy), dot(g3, dy));
        let extended = lamp.u.w != 0.0;
        let a = side * select(0.5 * gx, a4, extended);
        let b = side * select(0.5 * gy, b4, extended);
        let px = side * select(vec4f(0.0), gx, extended);
        let py = side * select(vec4f(0.0), gy, extended);
        let value = side * vec4f(dot(n0, to), dot(n1, to), dot(n2, to), dot(n3, to));
        let most = value + abs(a) + abs(b) + 0.5 * (abs(px) + abs(py));
        use_rows = use_rows && all(most >= vec4f(0.0));
        let slope = STEP_A * a + STEP_B * b;
        let inverse = select(vec4f(0.0), 1.0 / slope, slope != vec4f(0.0));
        let count = select(0u, shades.mask_rows, use_rows);
        for (var r = 0u; r < count; r++) {
            let row = shades.rows[r];
            let start = value + row.x * a + row.y * b + row.z * px + row.w * py;
            let cut = -start * inverse;
            let low = select(vec4f(0.0), cut, slope > vec4f(0.0));
            let high = select(vec4f(32.0), cut, slope < vec4f(0.0));
            let empty = any((slope == vec4f(0.0)) & (start < vec4f(0.0)));
            let begin = clamp(max(max(low.x, low.y), max(low.z, low.w)), 0.0, 32.0);
            let end = clamp(min(min(high.x, high.y), min(high.z, high.w)), 0.0, 32.0);
            let bits = low_bits(u32(ceil(end))) & ~low_bits(u32(ceil(begin)));
            covered[r] |= select(bits, 0u, empty || begin >= end || r >= count);
        }
    }
    var seen = 0u;
    for (var r = 0u; r < shades.mask_rows; r++) {
        seen += countOneBits(lamp.mask[r >> 2u][r & 3u] & ~covered[r]);
    }
    return f32(seen) / lamp.v.w;
}
