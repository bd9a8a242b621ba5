// A field's colours over a picture. First all triangles are drawn with the colour of their values,
// those without a field as nothing, some samples to a pixel; then their mean is put over the picture,
// as light as the radiance says. The NumPy form is gpusim/visualization/field_colors.py.
#import lib/light/srgb
#import lib/raster/screen

struct Params {
    // samples
    width: f32,
    height: f32,
    near: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> screen: array<vec2i>;
@group(0) @binding(2) var<storage, read> inverse_depth: array<f32>;
// three vertices per triangle
@group(0) @binding(3) var<storage, read> corners: array<u32>;
// at every corner: 0 to 1 between the ends of the scale; NONE on what has no field
@group(0) @binding(4) var<storage, read> values: array<f32>;
// linear, from one end of the scale to the other, and how opaque
@group(0) @binding(5) var<storage, read> colors: array<vec4f>;

const NONE = -1e30;

struct Varying {
    @builtin(position) position: vec4f,
    // over the depth, which is straight on the screen
    @location(0) value: f32,
    @location(1) inverse: f32,
    @location(2) @interpolate(flat, either) shown: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let corner = corners[index];
    let inverse = params.near * inverse_depth[corner];
    let place = band_position(screen[corner], 0, vec2f(params.width, params.height), inverse);
    let shown = values[index] > NONE;
    return Varying(place, select(0.0, values[index] * inverse, shown), inverse, u32(shown));
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4f {
    if (in.shown == 0u) { return vec4f(0.0); }
    let last = arrayLength(&colors) - 1u;
    let at = clamp(in.value / in.inverse, 0.0, 1.0) * f32(last);
    let i = min(u32(at), last - 1u);
    return mix(colors[i], colors[i + 1u], at - f32(i));
}

struct Placing {
    // px of the target, and what part of it may change
    size: vec2f,
    low: vec2f,
    high: vec2f,
    // where the picture lies on the target, and how many px one of its pixels is wide there
    origin: vec2f,
    scale: f32,
    // along a side of a pixel
    samples: u32,
    // pixels of the picture
    width: u32,
    height: u32,
    // float32 in a row of the radiance
    stride: u32,
    // radiance that is shown white; what is left of a colour where there is none
    white: f32,
    shade: f32,
    opacity: f32,
    // 1: the target takes values as sRGB encodes them
    encode: u32,
}
@group(0) @binding(6) var<uniform> placing: Placing;
@group(0) @binding(7) var layer: texture_2d<f32>;
@group(0) @binding(8) var<storage, read> radiance: array<f32>;

@vertex
fn vertex_over(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let right = index == 1u || index == 2u || index == 4u;
    let down = index == 2u || index == 4u || index == 5u;
    let at = select(placing.low, placing.high, vec2<bool>(right, down));
    return vec4f(2.0 * at.x / placing.size.x - 1.0, 1.0 - 2.0 * at.y / placing.size.y, 0.0, 1.0);
}

@fragment
fn fragment_over(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let samples = i32(placing.samples);
    let at = (position.xy - placing.origin) / placing.scale;
    let picture = vec2i(i32(placing.width), i32(placing.height));
    var sum = vec4f(0.0);
    for (var j = 0; j < samples; j++) {
        for (var i = 0; i < samples; i++) {
            let step = (vec2f(f32(i), f32(j)) + 0.5) / f32(samples) - 0.5;
            let cell = vec2i(floor((at + step / placing.scale) * f32(samples)));
            let own = textureLoad(layer, clamp(cell, vec2i(0), picture * samples - 1), 0);
            sum += vec4f(own.a * own.rgb, own.a);
        }
    }
    if (sum.a == 0.0) { discard; }
    let pixel = clamp(vec2i(floor(at)), vec2i(0), picture - 1);
    let seen = radiance[u32(pixel.y) * placing.stride + u32(pixel.x)] / placing.white;
    let light = placing.shade + (1.0 - placing.shade) * sqrt(clamp(seen, 0.0, 1.0));
    let color = light * sum.rgb / sum.a;
    let share = placing.opacity * sum.a / f32(samples * samples);
    let shown = vec3f(encoded(color.r), encoded(color.g), encoded(color.b));
    return vec4f(select(color, shown, placing.encode == 1u), share);
}
