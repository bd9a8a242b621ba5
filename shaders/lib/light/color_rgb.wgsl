// Colour as red, green and blue: see color_grey.wgsl. Albedos of tables are numbers of a palette's
// colours, which leaves the tables as they are where all is grey.
// The NumPy form is gpusim/optics/shading/spectrum.py.
#import lib/numeric/texel
alias Color = vec3f;
const BANDS: u32 = 3u;

@group(0) @binding(72) var palette: texture_2d<f32>;
fn color_of(albedo: f32) -> Color {
    return textureLoad(palette, texel(u32(albedo)), 0).xyz;
}

fn color_in(texel: vec4f) -> Color { return texel.xyz; }

// By what light that would be grey is multiplied, and of each band what lib/light/lighting.wgsl has of the sky.
struct Tints {
    even: vec4f,
    behind: vec4f,
    linear: array<vec4f, 3>,
    diagonal: array<vec4f, 3>,
    mixed: array<vec4f, 3>,
    emitters: array<vec4f, 256>,
}
@group(0) @binding(73) var<uniform> tints: Tints;

fn tinted(i: u32, e: f32) -> Color { return e * tints.emitters[i].xyz; }
fn even_light(e: f32) -> Color { return e * tints.even.xyz; }
fn behind_all(e: f32) -> Color { return tints.behind.xyz; }

fn sky_band(k: u32, n: vec3f) -> f32 {
    let linear = tints.linear[k];
    return max(linear.w + dot(linear.xyz, n) + dot(tints.diagonal[k].xyz, n * n)
        + 2.0 * dot(tints.mixed[k].xyz, n.yzx * n.zxy), 0.0);
}
fn sky_light(n: vec3f, e: f32) -> Color {
    return vec3f(sky_band(0u, n), sky_band(1u, n), sky_band(2u, n));
}

fn band_of(c: Color, k: u32) -> f32 { return c[k]; }
fn with_band(c: Color, k: u32, value: f32) -> Color {
    var result = c;
    result[k] = value;
    return result;
}

fn above(a: Color, b: Color) -> bool { return any(a > b); }

fn squares_color(even: Color, odd: Color, parity: vec4f, share: vec4f) -> Color {
    return even * dot(1.0 - parity, share) + odd * dot(parity, share);
}

alias Coefficients = mat3x4f;
fn coefficients_at(table: texture_2d<f32>, at: i32, plane: i32) -> Coefficients {
    return mat3x4f(
        textureLoad(table, texel(u32(at)), 0), textureLoad(table, texel(u32(at + plane)), 0),
        textureLoad(table, texel(u32(at + 2 * plane)), 0),
    );
}
fn weighed(weight: vec4f, c: Coefficients) -> Color { return weight * c; }
