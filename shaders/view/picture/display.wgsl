// Radiance as colours of a screen: exposed, with the curve of sRGB, pixel for pixel.
// The NumPy form is gpusim/view/picture/display.py.
#import lib/light/srgb

override coloured: u32;  // 0: one plane, which all three bindings hold

struct Params {
    size: vec2f,      // of the target, px
    place: vec2i,     // of the band's first pixel on the target
    width: u32,       // of the band, px
    rows: u32,
    stride: u32,
    exposure: f32,    // what 1 / radiance of white is
    weights: vec4f,   // of red, green and blue in a grey picture; 0: it has colours
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> red: array<f32>;
@group(0) @binding(2) var<storage, read> green: array<f32>;
@group(0) @binding(3) var<storage, read> blue: array<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    var corners = array<vec2f, 6>(
        vec2f(0.0, 0.0), vec2f(1.0, 0.0), vec2f(0.0, 1.0),
        vec2f(0.0, 1.0), vec2f(1.0, 0.0), vec2f(1.0, 1.0),
    );
    let at = vec2f(params.place) + corners[index] * vec2f(f32(params.width), f32(params.rows));
    return vec4f(2.0 * at.x / params.size.x - 1.0, 1.0 - 2.0 * at.y / params.size.y, 0.0, 1.0);
}

fn shown(radiance: f32) -> f32 {
    return encoded(clamp(params.exposure * radiance, 0.0, 1.0));
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(vec2i(position.xy) - params.place);
    let place = min(pixel.y, params.rows - 1u) * params.stride + min(pixel.x, params.width - 1u);
    if (coloured == 0u) { return vec4f(vec3f(shown(red[place])), 1.0); }
    let radiance = vec3f(red[place], green[place], blue[place]);
    if (any(params.weights > vec4f(0.0))) {
        return vec4f(vec3f(shown(dot(params.weights.rgb, radiance))), 1.0);
    }
    return vec4f(shown(radiance.r), shown(radiance.g), shown(radiance.b), 1.0);
}
