// Fine relief: how it turns the normal over a pixel. The NumPy form is gpusim/optics/paint/relief_normals.py, which
// explains it.
#import lib/raster/aperture
#import lib/numeric/texel

override bumpy: u32;

// wave vectors and phases; how many, which no compiler knows: unrolled, the loop would take seconds
struct Relief {
    waves: array<vec4f, 32>,
    count: u32,
}
@group(0) @binding(66) var<uniform> relief: Relief;
// per triangle three texels: affine functions of the offset from its anchor, for x, y and z of the
// relief's coordinates, by the depth as in `Triangle`; then the amplitude of a wave
@group(0) @binding(67) var bumps: texture_2d<f32>;

// A unit normal, and what to add to the square of GGX's alpha for the relief below the pixel.
struct Leaning {
    n: vec3f,
    widened: f32,
}

// Of the mean over the pixel's sensitive square.
fn filtered(turn: f32) -> f32 {
    let half = 0.5 * aperture * turn;
    let square = half * half;
    // sin(x) / x
    return select(sin(half) / half, 1.0 - square / 6.0, square < 1e-4);
}

// n: unit normal; dx, dy: how the place changes per column and row; w: the reciprocal depth at the
// offset d, by the triangle's, and rate how that changes.
fn leaning(id: u32, d: vec2f, w: f32, rate: vec2f, n: vec3f, dx: vec3f, dy: vec3f) -> Leaning {
    let a = textureLoad(bumps, texel(3u * id), 0);
    let b = textureLoad(bumps, texel(3u * id + 1u), 0);
    let c = textureLoad(bumps, texel(3u * id + 2u), 0);
    let amplitude = c.y;
    let across = vec3f(a.y, b.x, b.w);
    let down = vec3f(a.z, b.y, c.x);
    let place = (vec3f(a.x, a.w, b.z) + across * d.x + down * d.y) / w;
    let ex = (across - place * rate.x) / w;
    let ey = (down - place * rate.y) / w;
    let inner = vec3f(dot(dx, dx), dot(dx, dy), dot(dy, dy));
    let inverse = vec3f(inner.z, -inner.y, inner.x) / max(inner.x * inner.z - inner.y * inner.y, 1e-30);
    var slope = vec2f(0.0);
    var left = 0.0;
    for (var k = 0u; k < relief.count; k++) {
        let wave = relief.waves[k];
        let turn = vec2f(dot(wave.xyz, ex), dot(wave.xyz, ey));
        let kept = filtered(turn.x) * filtered(turn.y);
        slope -= turn * (kept * sin(dot(wave.xyz, place) + wave.w));
        let square = turn * turn;
        left += (1.0 - kept * kept)
            * (inverse.x * square.x + 2.0 * inverse.y * turn.x * turn.y + inverse.z * square.y);
    }
    let rise = amplitude * vec2f(
        inverse.x * slope.x + inverse.y * slope.y, inverse.y * slope.x + inverse.z * slope.y);
    return Leaning(normalize(n - rise.x * dx - rise.y * dy), 0.5 * amplitude * amplitude * left);
}
