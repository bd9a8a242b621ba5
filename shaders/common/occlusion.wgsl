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
// rows: for four rows of samples at a time a and b of the first ones, the pixel offset in x that they
// look from, and the direction that a takes along them
struct SampleRows {
    a: vec4f,
    b: vec4f,
    x: vec4f,
    way: vec4f,
}
struct Shades {
    count: u32,
    columns: u32,
    tolerance: f32,
    groups: u32,
    rows: array<SampleRows, 4>,
    lamps: array<LampFace, 16>,
}
@group(0) @binding(60) var<uniform> shades: Shades;
// four corners per face, relative to the eye; the first one's w is 1 if its inside hides as well
@group(0) @binding(61) var occluders: texture_2d<f32>;
// per tile in half shadow a texel per lamp (first, count, -, -), then the faces, four a texel
@group(0) @binding(62) var shadow_lists: texture_2d<u32>;
// per tile of 8 x 8 px (bits of the lamps that light it, number among the half shadowed + 1, -, -)
@group(0) @binding(63) var shadow_tiles: texture_2d<u32>;

const AGAINST: f32 = -0.5;   // cosine between the normals of what lies against each other
const STEP_A: f32 = 0.0625;
const STEP_B: f32 = 0.00390625;

fn shadow_tile(pixel: vec2i) -> vec2u {
    let tile = vec2u(pixel) / 8u;
    return textureLoad(shadow_tiles, texel(tile.y * shades.columns + tile.x), 0).xy;
}

// All bits from the n-th on.
fn bits_from(n: vec4f) -> vec4u {
    let first = vec4u(ceil(clamp(n, vec4f(0.0), vec4f(32.0))));
    return select(vec4u(0xffffffffu) << (first & vec4u(31u)), vec4u(0u), first >= vec4u(32u));
}

// Where rows of samples are inside, in steps from their first ones.
struct Span {
    low: vec4f,
    high: vec4f,
}

// What an edge leaves of it: inside is where value + a A + b B + x X >= 0.
fn cut_rows(span: Span, value: f32, a: f32, b: f32, x: f32, rows: SampleRows) -> Span {
    let start = vec4f(value) + a * rows.a + b * rows.b + x * rows.x;
    let slope = STEP_A * a + STEP_B * b;
    // an edge along the rows lies before or behind all of their samples
    let cut = start * select(-1e30, -1.0 / slope, slope != 0.0);
    let rising = vec4<bool>(slope >= 0.0);
    return Span(
        select(span.low, max(span.low, cut), rising),
        select(min(span.high, cut), span.high, rising),
    );
}

// n: the receiver's normal. A closed body hides from a receiver that lies against it, too.
fn lamp_share(l: u32, x: vec3f, n: vec3f, dx: vec3f, dy: vec3f, tile: vec2u) -> f32 {
    let lit = f32((tile.x >> l) & 1u);
    if (tile.y == 0u) { return lit; }
    let list = textureLoad(shadow_lists, texel((tile.y - 1u) * shades.count + l), 0);
    if (list.y == 0u) { return lit; }
    let lamp = shades.lamps[l];
    let to = lamp.centre.xyz - lamp.centre.w * x;
    let tolerance = shades.tolerance * length(x);
    // where the sample lattice is on the lamp, it is in part on the pixel
    let extended = lamp.u.w != 0.0;
    var covered0 = vec4u(0u);
    var covered1 = vec4u(0u);
    var covered2 = vec4u(0u);
    var covered3 = vec4u(0u);
    // The tests of loops come last: software drivers pass over a loop's body until no lane is left,
    // so that a test at its beginning costs one pass more.
    var i = list.x;
    loop {
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
        let size = length(normal);
        let against = first.w == 0.0 && abs(height) <= tolerance * size
            && dot(normal, n) < AGAINST * size;
        let side = select(-1.0, 1.0, height > 0.0 && !against);
        let above = select(-height, abs(height), first.w != 0.0);
        let apart = side * (dot(normal, to) - lamp.centre.w * height);
        let a4 = vec4f(dot(n0, lamp.u.xyz), dot(n1, lamp.u.xyz), dot(n2, lamp.u.xyz),
            dot(n3, lamp.u.xyz));
        let b4 = vec4f(dot(n0, lamp.v.xyz), dot(n1, lamp.v.xyz), dot(n2, lamp.v.xyz),
            dot(n3, lamp.v.xyz));
        let reach = abs(a4.x + a4.y + a4.z + a4.w) + abs(b4.x + b4.y + b4.z + b4.w);
        let counts = (above > tolerance * size || against) && apart + reach > 0.0;
        let g0 = cross(to, d1 - d0) - lamp.centre.w * n0;
        let g1 = cross(to, d2 - d1) - lamp.centre.w * n1;
        let g2 = cross(to, d3 - d2) - lamp.centre.w * n2;
        let g3 = cross(to, d0 - d3) - lamp.centre.w * n3;
        // seen from beyond its plane, a face would seem to hide what lies behind the receiver
        let crossed = abs(height) < 0.5 * (abs(dot(normal, dx)) + abs(dot(normal, dy)));
        let whole = select(side, 0.0, first.w != 0.0 && crossed);
        let gx = whole * vec4f(dot(g0, dx), dot(g1, dx), dot(g2, dx), dot(g3, dx));
        let gy = whole * vec4f(dot(g0, dy), dot(g1, dy), dot(g2, dy), dot(g3, dy));
        let a = select(0.5 * gx, side * a4, extended);
        let b = select(0.5 * gy, side * b4, extended);
        let px = select(vec4f(0.0), gx, extended);
        let py = select(vec4f(0.0), gy, extended);
        let value = side * vec4f(dot(n0, to), dot(n1, to), dot(n2, to), dot(n3, to));
        // a face beside all of the lamp and the pixel hides nothing
        let most = value + abs(a) + abs(b) + 0.5 * (abs(px) + abs(py));
        let used = vec4u(select(0u, 0xffffffffu, counts && all(most >= vec4f(0.0))));
        var g = 0u;
        loop {
            let rows = shades.rows[g];
            let at = select(a, rows.way.x * a, extended) + 0.5 * py;
            var span = Span(vec4f(0.0), vec4f(32.0));
            span = cut_rows(span, value.x, at.x, b.x, px.x, rows);
            span = cut_rows(span, value.y, at.y, b.y, px.y, rows);
            span = cut_rows(span, value.z, at.z, b.z, px.z, rows);
            span = cut_rows(span, value.w, at.w, b.w, px.w, rows);
            let bits = covered0 | (used & bits_from(span.low) & ~bits_from(span.high));
            // each turn takes the first four rows and puts them last
            covered0 = covered1;
            covered1 = covered2;
            covered2 = covered3;
            covered3 = bits;
            g++;
            if (g >= shades.groups) { break; }
        }
        let open = (lamp.mask[0] & ~covered0) | (lamp.mask[1] & ~covered1)
            | (lamp.mask[2] & ~covered2) | (lamp.mask[3] & ~covered3);
        i++;
        if (i >= list.x + list.y || all(open == vec4u(0u))) { break; }
    }
    let seen = countOneBits(lamp.mask[0] & ~covered0) + countOneBits(lamp.mask[1] & ~covered1)
        + countOneBits(lamp.mask[2] & ~covered2) + countOneBits(lamp.mask[3] & ~covered3);
    return f32(seen.x + seen.y + seen.z + seen.w) / lamp.v.w;
}
