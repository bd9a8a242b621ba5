// From a pixel of the lens to the ideal image: a cubic per tile (gpusim/optics/camera/undistortion_table.py).
#import lib/raster/aperture
#import lib/numeric/texel

override distorted: u32;

struct Tiles {
    last: vec2f,
    middle: vec2f,
    size: i32,
    columns: i32,
}
@group(0) @binding(40) var<uniform> tiles: Tiles;
// five texels per tile: two coefficients each, x and y of both
@group(0) @binding(41) var undistortion: texture_2d<f32>;

// A pixel's cubic and its place in the tile.
struct Bend {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    d: vec4f,
    e: vec4f,
    w: vec2f,
}

fn bend_at(pixel: vec2i) -> Bend {
    if (distorted == 0u) {
        return Bend(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0), vec2f(0.0));
    }
    let tile = pixel / tiles.size;
    let w = vec2f(pixel) - min(vec2f(tile * tiles.size), tiles.last) - tiles.middle;
    let i = 5u * u32(tile.y * tiles.columns + tile.x);
    return Bend(
        textureLoad(undistortion, texel(i), 0), textureLoad(undistortion, texel(i + 1u), 0),
        textureLoad(undistortion, texel(i + 2u), 0), textureLoad(undistortion, texel(i + 3u), 0),
        textureLoad(undistortion, texel(i + 4u), 0), w,
    );
}

// Where the point at offset `at` from the pixel's centre lies in the ideal image, from that centre.
fn undistort(f: Bend, at: vec2f) -> vec2f {
    if (distorted == 0u) { return at; }
    let u = f.w.x + at.x;
    let v = f.w.y + at.y;
    var shift = f.a.xy + u * (f.a.zw + u * (f.b.zw + u * f.d.xy + v * f.d.zw) + v * (f.c.xy + v * f.e.xy));
    shift += v * (f.b.xy + v * (f.c.zw + v * f.e.zw));
    return at + shift;
}

// The same of an offset in sides of the pixel's sensitive square.
fn undistort_within(f: Bend, at: vec2f) -> vec2f {
    return undistort(f, aperture * at);
}

// Columns: how the ideal position of the pixel's centre changes along the sides of its sensitive square.
fn undistort_change(f: Bend) -> mat2x2f {
    if (distorted == 0u) { return mat2x2f(aperture, 0.0, 0.0, aperture); }
    let u = f.w.x;
    let v = f.w.y;
    let per_column = f.a.zw + u * (2.0 * f.b.zw + 3.0 * u * f.d.xy + 2.0 * v * f.d.zw)
        + v * (f.c.xy + v * f.e.xy);
    let per_row = f.b.xy + v * (2.0 * f.c.zw + 3.0 * v * f.e.zw + 2.0 * u * f.e.xy)
        + u * (f.c.xy + u * f.d.zw);
    return aperture * mat2x2f(per_column + vec2f(1.0, 0.0), per_row + vec2f(0.0, 1.0));
}
