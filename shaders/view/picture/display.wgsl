// Radiance as colours of a screen: scaled to the target's size, exposed, with the curve of sRGB.
// The NumPy form is gpusim/view/picture/display.py.
#import lib/light/srgb

override coloured: u32;  // 0: one plane, which all three bindings hold

struct Params {
    width: u32,       // of the picture, px
    height: u32,
    row0: u32,        // of the picture: the first row that the buffers hold
    rows: u32,
    stride: u32,
    blend: u32,       // 1: interpolated between pixels, 0: the nearest one
    left: f32,        // where the picture begins on the target, px
    top: f32,
    scale: f32,       // pixels of the picture for one of the target
    exposure: f32,    // what 1 / radiance of white is
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> red: array<f32>;
@group(0) @binding(2) var<storage, read> green: array<f32>;
@group(0) @binding(3) var<storage, read> blue: array<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // one triangle over all of the target
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}

fn pixel(x: i32, y: i32) -> vec3f {
    let column = u32(clamp(x, 0, i32(params.width) - 1));
    let row = u32(clamp(y, 0, i32(params.height) - 1));
    let inside = clamp(row, params.row0, params.row0 + params.rows - 1u) - params.row0;
    let place = inside * params.stride + column;
    if (coloured == 0u) { return vec3f(red[place], 0.0, 0.0); }
    return vec3f(red[place], green[place], blue[place]);
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let at = (position.xy - vec2f(params.left, params.top)) * params.scale;
    let nearest = vec2i(floor(at));
    let first_row = i32(params.row0);
    let beside = nearest.x < 0 || nearest.x >= i32(params.width);
    if (beside || nearest.y < first_row || nearest.y >= first_row + i32(params.rows)) { discard; }
    var value = pixel(nearest.x, nearest.y);
    if (params.blend == 1u) {
        let corner = floor(at - 0.5);
        let t = at - 0.5 - corner;
        let first = vec2i(corner);
        let above = mix(pixel(first.x, first.y), pixel(first.x + 1, first.y), t.x);
        let below = mix(pixel(first.x, first.y + 1), pixel(first.x + 1, first.y + 1), t.x);
        value = mix(above, below, t.y);
    }
    value = clamp(params.exposure * value, vec3f(0.0), vec3f(1.0));
    if (coloured == 0u) { return vec4f(vec3f(encoded(value.x)), 1.0); }
    return vec4f(encoded(value.x), encoded(value.y), encoded(value.z), 1.0);
}
