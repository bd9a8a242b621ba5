// Radiance of every pixel of a band that sees small matte triangles with speckle on them: the share that
// discs cover, times the triangle's light as a function of the pixel. Both come in 64 bytes a triangle,
// which optics/shading/glance.wgsl found. Described in gpusim/optics/shading/speckled.py.
#import lib/paint/footprint
#import lib/light/glance
#import lib/paint/feature_grid
#import lib/numeric/texel
#import lib/raster/undistortion_table

struct Params {
    width: u32,
    row0: i32,
    background: f32,
    paint: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// per pixel of the band what compute_raster.wgsl found, the lower half first
@group(0) @binding(9) var<storage, read> nearest: array<vec2u>;
// `seen` has four texels per triangle: the first as lib/light/glance.wgsl has it; (s0, sx, sy, t0), (tx, ty,
// wx, wy) as lib/paint/footprint.wgsl has them, w0 is 1; the light's terms of second degree, and the cell,
// counted from the one before the lowest, in 16 bits each

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    return vec4f(4.0 * corner - 1.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) at: vec4f) -> @location(0) f32 {
    let place = vec2u(at.xy);
    let number = 0u - nearest[place.y * params.width + place.x].x;
    return select(params.background, radiance_at(place, max(number, 1u) - 1u), number > 0u);
}

// per pixel of the band a triangle's mark, or what is its radiance already
@group(0) @binding(10) var<storage, read> marks: array<u32>;
@fragment
fn fragment_layer(@builtin(position) at: vec4f) -> @location(0) f32 {
    let place = vec2u(at.xy);
    let mark = marks[place.y * params.width + place.x];
    let own = (mark & MARK) == MARK;
    return select(bitcast<f32>(mark), radiance_at(place, select(0u, mark & ~MARK, own)), own);
}

fn radiance_at(place: vec2u, id: u32) -> f32 {
    let i = 4u * id;
    let a = textureLoad(seen, texel(i));
    let b = bitcast<vec4f>(textureLoad(seen, texel(i + 1u)));
    let c = bitcast<vec4f>(textureLoad(seen, texel(i + 2u)));
    let e = textureLoad(seen, texel(i + 3u));
    let anchor = vec2i(i32(a.w << 16u), i32(a.w)) >> vec2u(16u);
    let pixel = vec2i(place) + vec2i(0, params.row0);
    let bend = bend_at(pixel);
    let d = vec2f(pixel - anchor) + undistort(bend, vec2f(0.0));
    let f = bent_footprint(footprint_of_planes(b, c, 1.0, d), undistort_change(bend));
    let paint = paint_at(params.paint);
    let cell = vec2i(vec2u(e.w & 65535u, e.w >> 16u)) - 1 + vec2i(paint.i0, paint.j0);
    let albedo = paint_pixel(paint, cell, f.st, f.ex, f.ey, f.q);
    return albedo * glance_of(Glance(bitcast<vec3f>(a.xyz), bitcast<vec3f>(e.xyz), anchor, false), d);
}
