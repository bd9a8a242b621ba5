// Light that falls on a point whose shares of the lamps are known (optics/shadow).
// The NumPy form is `Lighting.reflect` in gpusim/optics/shading/lighting.py.
#import lib/light/lighting

// per receiver, one lamp after the other
@group(0) @binding(69) var<storage, read> lamp_shares: array<f32>;

// A receiver among `count`. Bits of the lamps of which its share is listed, and of those of which it
// sees nothing: of the others it sees all. Lamps from the 32nd on cast no shadows.
struct Known {
    place: u32,
    count: u32,
    listed: u32,
    dark: u32,
}
fn known_share(k: Known, lamp: u32) -> f32 {
    let bit = select(0u, 1u << (lamp & 31u), lamp < 32u);
    let found = (k.listed & bit) != 0u;
    let plain = select(1.0, 0.0, (k.dark & bit) != 0u);
    return select(plain, lamp_shares[select(0u, lamp * k.count + k.place, found)], found);
}

// What is reflected, and what a matte surface would reflect of all lamps; whether some lamp is seen
// in part.
struct Lit {
    r: Reflection,
    whole: Color,
    half: bool,
}
fn reflection_known(x: vec3f, n: vec3f, g: Gloss, open: f32, k: Known) -> Lit {
    var total = surroundings(n, g, open);
    var whole = total.matte;
    var half = false;
    for (var i = 0u; i < emitter_count; i++) {
        let share = known_share(k, u32(lamps.emitters[3u * i + 2u].w));
        let all = emitter_reflection(i, x, n, g);
        total = plus(total, share, all);
        whole += all.matte;
        half = half || (share > 0.0 && share < 1.0);
    }
    return Lit(total, whole, half);
}
