// A picture with fewer pixels over a larger target, interpolated between its pixels.
// The NumPy form is gpusim/view/picture/display.py.
struct Params {
    size: vec2f,    // of the target, px
    place: vec2f,   // of the picture's corner on the target, px
    scale: f32,     // pixels of the target for one of the picture
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var picture: texture_2d<f32>;
@group(0) @binding(2) var smooth_sampler: sampler;

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    var corners = array<vec2f, 6>(
        vec2f(0.0, 0.0), vec2f(1.0, 0.0), vec2f(0.0, 1.0),
        vec2f(0.0, 1.0), vec2f(1.0, 0.0), vec2f(1.0, 1.0),
    );
    let corner = corners[index];
    let at = params.place + params.scale * corner * vec2f(textureDimensions(picture));
    let there = vec2f(2.0 * at.x / params.size.x - 1.0, 1.0 - 2.0 * at.y / params.size.y);
    return Varying(vec4f(there, 0.0, 1.0), corner);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4f {
    return textureSample(picture, smooth_sampler, in.at);
}
