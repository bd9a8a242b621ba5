// Light that falls on a point: emitters, surroundings, and which share of each lamp is seen.
// The NumPy form is gpusim/optics/lighting.py.
#import common/occlusion

// Per emitter three vectors: (position, axial intensity), (axis, 1 if it follows Lambert's law) and
// (1 if it is near, cosine where its beam ends, 1 / what the cosine grows by until it is full,
// lamp). Positions are relative to the camera's eye. They are uniform and their count is a
// constant: the loop unrolls and every lane shares the loads.
struct Lamps {
    ambient: vec4f,
    emitters: array<vec4f, 768>,
}
@group(0) @binding(5) var<uniform> lamps: Lamps;
override emitter_count: u32;

// Irradiance from one emitter at x with unit normal n.
fn emitter_light(i: u32, x: vec3f, n: vec3f) -> f32 {
    let at = lamps.emitters[3u * i];
    let axis = lamps.emitters[3u * i + 1u];
    let more = lamps.emitters[3u * i + 2u];
    let to = at.xyz - more.x * x;
    let square = max(dot(to, to), 1e-30);
    let inverse = inverseSqrt(square);
    let falling = max(dot(to, n) * inverse, 0.0);
    let along = -dot(to, axis.xyz) * inverse;
    let leaving = select(1.0, max(along, 0.0), axis.w != 0.0);
    let t = clamp((along - more.y) * more.z, 0.0, 1.0);
    let spread = select(1.0, inverse * inverse, more.x != 0.0);
    return at.w * leaving * t * t * (3.0 - 2.0 * t) * falling * spread;
}

// Irradiance at camera-relative position x with unit normal n, from the lamps whose bit is set.
fn irradiance(x: vec3f, n: vec3f, bits: u32) -> f32 {
    var total = lamps.ambient.x;
    for (var i = 0u; i < emitter_count; i++) {
        let light = emitter_light(i, x, n);
        if (shadowed != 0u) {
            let lamp = u32(lamps.emitters[3u * i + 2u].w);
            total += select(0.0, light, ((bits >> lamp) & 1u) != 0u);
        } else {
            total += light;
        }
    }
    return total;
}

// The same where lamps may be half hidden: dx, dy is how x changes over the pixel, tile what
// `shadow_tile` found for it.
fn irradiance_seen(x: vec3f, n: vec3f, dx: vec3f, dy: vec3f, tile: vec2u) -> f32 {
    var total = lamps.ambient.x;
    for (var l = 0u; l < shades.count; l++) {
        let share = lamp_share(l, x, dx, dy, tile);
        let part = shades.lamps[l].part;
        var light = 0.0;
        for (var i = part.x; i < part.y; i++) { light += emitter_light(i, x, n); }
        total += share * light;
    }
    return total;
}
