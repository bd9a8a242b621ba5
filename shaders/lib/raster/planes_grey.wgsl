// Where pixels are written to: one plane of radiance. `#import lib/raster/planes` stands for this file,
// or for planes_rgb.wgsl where something has a colour; both have the same functions.
// The NumPy form is gpusim/optics/shading/shading_pass.py.
#import lib/light/color

struct Pixel {
    @location(0) radiance: f32,
}
struct NumberedPixel {
    @location(0) radiance: f32,
    @location(1) number: u32,
}
struct MarkedPixel {
    @location(0) radiance: f32,
    @location(1) mark: vec2u,
}
fn pixel_of(c: Color) -> Pixel { return Pixel(c); }
fn numbered_pixel(c: Color, number: u32) -> NumberedPixel { return NumberedPixel(c, number); }

// With its triangle, its albedo, and the share of it that shows the paint's ground where some are `shiny`.
fn marked_pixel(c: Color, number: u32, albedo: Color, bare: f32, shiny: bool) -> MarkedPixel {
    let both = pack2x16unorm(vec2f(albedo, bare));
    return MarkedPixel(c, vec2u(number, select(u32(albedo * 4294967040.0), both, shiny)));
}
struct Mark {
    albedo: Color,
    bare: f32,
}
fn mark_of(mark: vec4u, shiny: bool) -> Mark {
    let both = unpack2x16unorm(mark.y);
    return Mark(select(f32(mark.y) * 0x1p-32, both.x, shiny), both.y);
}
// Whether marks hold the albedo of matte paints, too.
const MATTE_MARKED: bool = true;

@group(0) @binding(74) var<storage, read_write> plane0: array<f32>;
fn radiance_at(i: u32) -> Color { return plane0[i]; }
fn set_radiance(i: u32, c: Color) { plane0[i] = c; }

// An edge pixel's radiance, and 1 if the host has to resolve it.
alias EdgePixel = vec2f;
fn edge_pixel(c: Color, unsure: f32) -> EdgePixel { return vec2f(c, unsure); }
fn radiance_found(f: EdgePixel) -> Color { return f.x; }
fn unsure_found(f: EdgePixel) -> f32 { return f.y; }

// Of pieces of pixels the area, the paint's mean albedo, what of it is printed, and flags.
struct Painted {
    area: f32,
    albedo: Color,
    printed: f32,
    flags: u32,
}
@group(0) @binding(14) var<storage, read_write> painted: array<vec4u>;
fn set_painted(piece: u32, p: Painted) {
    painted[piece] = vec4u(bitcast<vec3u>(vec3f(p.area, p.albedo, p.printed)), p.flags);
}
fn painted_at(piece: u32) -> Painted {
    let words = painted[piece];
    let own = bitcast<vec3f>(words.xyz);
    return Painted(own.x, own.y, own.z, words.w);
}
