// The light on flat matte surfaces, tile by tile of 8 x 8 px: it changes so little there that what
// falls on the tile's corners tells all between. Described in gpusim/optics/shading/tile_light.py.
#import lib/light/surface
#import lib/raster/undistortion_table

struct Params {
    rays: Rays,
    columns: u32,
    rows: u32,
    owner_columns: u32,
    owner_tiles: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// per square of owner_tiles x owner_tiles tiles the number + 1 of a triangle of the plane seen there
@group(0) @binding(1) var<storage, read> owners: array<u32>;
// per tile, and band of it, the coefficients of 1, x, y and x y, from 0 to 1 over the tile: of
// radiance by albedo
@group(0) @binding(7) var light: texture_storage_2d<rgba32float, write>;

fn at_corner(t: Triangle, tile: vec2u, corner: vec2i) -> Color {
    let pixel = vec2i(8u * tile) + 7 * corner;
    let shift = undistort(bend_at(pixel), vec2f(corner) - 0.5);
    let d = vec2f(pixel - t.place.xy) + shift;
    return reflection_at(t, params.rays, vec2f(pixel) + shift, d).matte;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let number = gid.y * (groups.x * 64u) + gid.x;
    if (number >= params.columns * params.rows) { return; }
    let tile = vec2u(number % params.columns, number / params.columns);
    let square = tile / params.owner_tiles;
    let owner = owners[square.y * params.owner_columns + square.x];
    if (owner == 0u) { return; }
    let t = triangle_at(owner - 1u);
    let a = at_corner(t, tile, vec2i(0, 0));
    let b = at_corner(t, tile, vec2i(1, 0));
    let c = at_corner(t, tile, vec2i(0, 1));
    let d = at_corner(t, tile, vec2i(1, 1));
    for (var k = 0u; k < BANDS; k++) {
        let one = band_of(a, k);
        let across = band_of(b, k) - one;
        let down = band_of(c, k) - one;
        let both = one - band_of(b, k) - band_of(c, k) + band_of(d, k);
        textureStore(light, texel(BANDS * number + k), vec4f(one, across, down, both));
    }
}
