// Light that falls on a point: emitters and surroundings.
// The NumPy form is `Lighting.reflect` in gpusim/optics/shading/lighting.py.
#import lib/light/brdf
#import lib/light/sky_visibility

// Per emitter three vectors: (position, axial intensity), (axis, 1 if it follows Lambert's law) and
// (1 if it is near, cosine where its beam ends, 1 / what the cosine grows by until it is full,
// lamp). Positions are relative to the camera's eye. They are uniform and their count is a
// constant: the loop unrolls and every lane shares the loads.
// ambient = (irradiance from everywhere, its radiance, rows and columns of the maps); the sky's
// irradiance is linear.w + linear . n + n . quadratic n (diagonal, then yz, zx, xy); per_paint = (texels of the gloss
// table per paint, -, -, -); axes are those of the maps.
struct Lamps {
    ambient: vec4f,
    linear: vec4f,
    diagonal: vec4f,
    mixed: vec4f,
    per_paint: vec4u,
    axes: array<vec4f, 3>,
    emitters: array<vec4f, 768>,
}
@group(0) @binding(5) var<uniform> lamps: Lamps;
override emitter_count: u32;
override sky: u32;

struct Ray {
    to: vec3f,
    irradiance: f32,
}

// Irradiance from one emitter at x with unit normal n, and the unit direction to it.
fn emitter_light(i: u32, x: vec3f, n: vec3f) -> Ray {
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
    return Ray(to * inverse, at.w * leaving * t * t * (3.0 - 2.0 * t) * falling * spread);
}

fn emitter_reflection(i: u32, x: vec3f, n: vec3f, g: Gloss) -> Reflection {
    let ray = emitter_light(i, x, n);
    let matte = tinted(i, ray.irradiance * 0.3183098861837907);
    if (glossy == 0u) { return Reflection(matte, matte, Color(0.0)); }
    let pq = lamp_gloss(g, n, ray.to, ray.irradiance);
    return Reflection(matte, tinted(i, pq.x), tinted(i, pq.y));
}

// `open` is the share of them that surfaces leave.
fn surroundings(n: vec3f, g: Gloss, open: f32) -> Reflection {
    var e = even_light(lamps.ambient.x);
    var radiance = even_light(lamps.ambient.y);
    if (sky != 0u) {
        e += sky_light(n, max(lamps.linear.w + dot(lamps.linear.xyz, n) + dot(lamps.diagonal.xyz, n * n)
            + 2.0 * dot(lamps.mixed.xyz, n.yzx * n.zxy), 0.0));
        if (glossy != 0u) {
            let r = 2.0 * g.nv * n - g.view;
            let d = vec3f(dot(lamps.axes[0].xyz, r), dot(lamps.axes[1].xyz, r),
                dot(lamps.axes[2].xyz, r));
            let rows = u32(lamps.ambient.z);
            radiance += mirrored_map(g.first + NODES, rows, u32(lamps.ambient.w), normalize(d));
        }
    }
    if (sheltered != 0u) {
        e *= open;
        radiance *= open;
    }
    let matte = e * 0.3183098861837907;
    if (glossy == 0u) { return Reflection(matte, matte, Color(0.0)); }
    return surroundings_gloss(g, e, radiance);
}

fn plus(a: Reflection, share: f32, b: Reflection) -> Reflection {
    return Reflection(a.matte + share * b.matte, a.p + share * b.p, a.q + share * b.q);
}

// What is reflected at camera-relative position x with unit normal n, of the surroundings and all
// lamps.
fn reflection(x: vec3f, n: vec3f, g: Gloss, open: f32) -> Reflection {
    var total = surroundings(n, g, open);
    for (var i = 0u; i < emitter_count; i++) {
        total = plus(total, 1.0, emitter_reflection(i, x, n, g));
    }
    return total;
}
