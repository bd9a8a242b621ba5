// Colour where all of a scene is grey: one number. `#import lib/light/color` stands for this file, or
// for color_rgb.wgsl where something has a colour; both have the same functions.
// The NumPy form is gpusim/optics/shading/spectrum.py: band by band.
#import lib/numeric/texel
alias Color = f32;
const BANDS: u32 = 1u;

// Of an albedo as tables hold it.
fn color_of(albedo: f32) -> Color { return albedo; }

// What a texel of a table of light holds.
fn color_in(texel: vec4f) -> Color { return texel.x; }

// Light of emitter `i` that would be `e` if it were grey; of even surroundings; of the sky at faces of
// normal n; behind all surfaces.
fn tinted(i: u32, e: f32) -> Color { return e; }
fn even_light(e: f32) -> Color { return e; }
fn sky_light(n: vec3f, e: f32) -> Color { return e; }
fn behind_all(e: f32) -> Color { return e; }

// One band of it, and the same colour with another value there.
fn band_of(c: Color, k: u32) -> f32 { return c; }
fn with_band(c: Color, k: u32, value: f32) -> Color { return value; }

// Whether a is above b in some band.
fn above(a: Color, b: Color) -> bool { return a > b; }

// Sum of four squares of an even or odd colour, of which a pixel has shares.
fn squares_color(even: Color, odd: Color, parity: vec4f, share: vec4f) -> Color {
    return dot(mix(vec4f(even), vec4f(odd), parity), share);
}

// Four coefficients of a bitmap's spline, and their sum by weights; `plane`: texels from a band to the next.
alias Coefficients = vec4f;
fn coefficients_at(table: texture_2d<f32>, at: i32, plane: i32) -> Coefficients {
    return textureLoad(table, texel(u32(at)), 0);
}
fn weighed(weight: vec4f, c: Coefficients) -> Color { return dot(weight, c); }
