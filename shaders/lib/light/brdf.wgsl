// Glossy reflection. The NumPy forms are gpusim/optics/light/microfacet_material.py and gpusim/optics/light/environment.py.
#import lib/light/color
#import lib/numeric/texel

// per paint 64 texels (a, b, -, -) of reflectances, then its map of the surroundings, row by row
@group(0) @binding(64) var gloss_table: texture_2d<f32>;
override glossy: u32;

const NODES: u32 = 64u;

// What is sent towards the eye: of a matte print of albedo a it is a * matte, of the paint's ground
// of albedo g it is g * p + q.
struct Reflection {
    matte: Color,
    p: Color,
    q: Color,
}

// A glossy paint as seen from the unit direction `view`: a dielectric's base gets `base`.
struct Gloss {
    view: vec3f,
    nv: f32,
    alpha: f32,
    metallic: f32,
    a: f32,
    b: f32,
    base: f32,
    first: u32,
}

fn gloss_of(paint: u32, per_paint: u32, alpha: f32, metallic: f32, view: vec3f, n: vec3f) -> Gloss {
    let first = paint * per_paint;
    let nv = clamp(dot(n, view), 0.0, 1.0);
    let at = clamp(nv * f32(NODES) - 0.5, 0.0, f32(NODES - 1u));
    let low = min(u32(at), NODES - 2u);
    let c0 = textureLoad(gloss_table, texel(first + low), 0).xy;
    let c1 = textureLoad(gloss_table, texel(first + low + 1u), 0).xy;
    let c = mix(c0, c1, at - f32(low));
    return Gloss(view, nv, alpha, metallic, c.x, c.y, 1.0 - 0.04 * c.x - c.y, first);
}

// Light from the unit direction l of irradiance e.
fn lamp_gloss(g: Gloss, n: vec3f, l: vec3f, e: f32) -> vec2f {
    let h = normalize(l + g.view);
    let nl = max(dot(n, l), 1e-6);
    let nv = max(g.nv, 1e-6);
    let nh = clamp(dot(n, h), 0.0, 1.0);
    let vh = clamp(dot(g.view, h), 0.0, 1.0);
    let a2 = g.alpha * g.alpha;
    let spread = nh * nh * (a2 - 1.0) + 1.0;
    let mask = nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2);
    let mirrored = e * a2 * 0.3183098861837907 / (spread * spread) * 0.5 / mask;
    let k = 1.0 - vh;
    let k2 = k * k;
    let fresnel = k2 * k2 * k;
    let p = (1.0 - g.metallic) * g.base * e * 0.3183098861837907
        + g.metallic * mirrored * (1.0 - fresnel);
    return vec2f(p, mirrored * (fresnel + 0.04 * (1.0 - g.metallic) * (1.0 - fresnel)));
}

// Surroundings of irradiance e, whose radiance in the mirrored direction is `radiance`.
fn surroundings_gloss(g: Gloss, e: Color, radiance: Color) -> Reflection {
    let p = (1.0 - g.metallic) * g.base * e * 0.3183098861837907 + g.metallic * g.a * radiance;
    let q = (0.04 * (1.0 - g.metallic) * g.a + g.b) * radiance;
    return Reflection(e * 0.3183098861837907, p, q);
}

// Value between four texels of the map of rows x columns at `first`, in the direction d given in
// the map's axes (right, forward, up).
fn mirrored_map(first: u32, rows: u32, columns: u32, d: vec3f) -> Color {
    let v = clamp(acos(clamp(d.z, -1.0, 1.0)) * 0.3183098861837907 * f32(rows) - 0.5,
        0.0, f32(rows) - 1.0);
    let u = (atan2(d.x, d.y) * 0.15915494309189535 + 0.5) * f32(columns) - 0.5;
    let j = min(u32(v), rows - 2u);
    let i = floor(u);
    let left = u32(i + f32(columns)) % columns;
    let right = (left + 1u) % columns;
    let top = first + j * columns;
    let low = top + columns;
    let s = u - i;
    let upper = mix(color_in(textureLoad(gloss_table, texel(top + left), 0)),
        color_in(textureLoad(gloss_table, texel(top + right), 0)), s);
    let lower = mix(color_in(textureLoad(gloss_table, texel(low + left), 0)),
        color_in(textureLoad(gloss_table, texel(low + right), 0)), s);
    return mix(upper, lower, v - f32(j));
}
