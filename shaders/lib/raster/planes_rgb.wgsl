// Where pixels are written to: planes of red, green and blue. See planes_grey.wgsl.
// The NumPy form is gpusim/optics/shading/shading_pass.py.
#import lib/light/color

struct Pixel {
    @location(0) red: f32,
    @location(1) green: f32,
    @location(2) blue: f32,
}
struct NumberedPixel {
    @location(0) red: f32,
    @location(1) green: f32,
    @location(2) blue: f32,
    @location(3) number: u32,
}
struct MarkedPixel {
    @location(0) red: f32,
    @location(1) green: f32,
    @location(2) blue: f32,
    @location(3) mark: vec4u,
}
fn pixel_of(c: Color) -> Pixel { return Pixel(c.x, c.y, c.z); }
fn numbered_pixel(c: Color, number: u32) -> NumberedPixel {
    return NumberedPixel(c.x, c.y, c.z, number);
}

fn marked_pixel(c: Color, number: u32, albedo: Color, bare: f32, shiny: bool) -> MarkedPixel {
    let words = vec2u(pack2x16unorm(albedo.xy), pack2x16unorm(vec2f(albedo.z, bare)));
    return MarkedPixel(c.x, c.y, c.z, vec4u(number, words, 0u));
}
struct Mark {
    albedo: Color,
    bare: f32,
}
fn mark_of(mark: vec4u, shiny: bool) -> Mark {
    let rest = unpack2x16unorm(mark.z);
    return Mark(vec3f(unpack2x16unorm(mark.y), rest.x), rest.y);
}
const MATTE_MARKED: bool = false;

@group(0) @binding(74) var<storage, read_write> plane0: array<f32>;
@group(0) @binding(75) var<storage, read_write> plane1: array<f32>;
@group(0) @binding(76) var<storage, read_write> plane2: array<f32>;
fn radiance_at(i: u32) -> Color { return vec3f(plane0[i], plane1[i], plane2[i]); }
fn set_radiance(i: u32, c: Color) {
    plane0[i] = c.x;
    plane1[i] = c.y;
    plane2[i] = c.z;
}

alias EdgePixel = vec4f;
fn edge_pixel(c: Color, unsure: f32) -> EdgePixel { return vec4f(c, unsure); }
fn radiance_found(f: EdgePixel) -> Color { return f.xyz; }
fn unsure_found(f: EdgePixel) -> f32 { return f.w; }

// Two words a piece.
struct Painted {
    area: f32,
    albedo: Color,
    printed: f32,
    flags: u32,
}
@group(0) @binding(14) var<storage, read_write> painted: array<vec4u>;
fn set_painted(piece: u32, p: Painted) {
    painted[2u * piece] = vec4u(bitcast<vec2u>(vec2f(p.area, p.printed)), p.flags, 0u);
    painted[2u * piece + 1u] = vec4u(bitcast<vec3u>(p.albedo), 0u);
}
fn painted_at(piece: u32) -> Painted {
    let words = painted[2u * piece];
    let own = bitcast<vec2f>(words.xy);
    return Painted(own.x, bitcast<vec3f>(painted[2u * piece + 1u].xyz), own.y, words.z);
}
