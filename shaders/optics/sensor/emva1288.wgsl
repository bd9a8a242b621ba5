// Digital numbers with the noise of a camera: EMVA 1288 release 4.0, linear model.
//
// electrons = Poisson((signal (1 + PRNU) + dark) ), at most the full well; + DSNU + read noise;
// grey value = round(gain electrons + black level), clipped. What a camera doesn't have is left out
// by the constants. Random words are those of the pixel: the counter is (pixel, frame, stream), the
// key (seed, camera); offsets and gains that stay from frame to frame leave the frame out.
#import lib/numeric/philox

override bits: u32;
override shot: u32;
override readout: u32;
override pattern: u32;   // DSNU and PRNU
override mosaic: u32;    // Bayer
override curved: u32;    // gamma

struct Params {
    count: u32,
    width: u32,
    stride: u32,
    first: u32,          // number of the first pixel in the whole image
    row0: u32,
    frame: u32,
    seed: u32,
    camera: u32,
    electrons: f32,      // per unit of radiance
    dark: f32,           // electrons
    full_well: f32,
    read_noise: f32,
    dsnu: f32,
    prnu: f32,
    gain: f32,
    black: f32,
    exponent: f32,       // 1 / gamma
    tile: vec4f,         // relative responses at (even row, even column), (even, odd), (odd, ..)
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> radiance: array<f32>;
@group(0) @binding(2) var<storage, read_write> words: array<u32>;

// The quantile of the normal distribution, sqrt(2) erfinv(2 p - 1), by Giles' single precision
// polynomials ("Approximating the erfinv function", GPU Computing Gems, 2011).
fn normal_quantile(p: f32) -> f32 {
    let w = -log(4.0 * p * (1.0 - p));
    let a = w - 2.5;
    let central = (((((((2.81022636e-08 * a + 3.43273939e-07) * a - 3.5233877e-06) * a
        - 4.39150654e-06) * a + 0.00021858087) * a - 0.00125372503) * a - 0.00417768164) * a
        + 0.246640727) * a + 1.50140941;
    let b = sqrt(max(w, 0.0)) - 3.0;
    let tail = (((((((-0.000200214257 * b + 0.000100950558) * b + 0.00134934322) * b
        - 0.00367342844) * b + 0.00573950773) * b - 0.0076224613) * b + 0.00943887047) * b
        + 1.00167406) * b + 2.83297682;
    return 1.4142135 * (2.0 * p - 1.0) * select(tail, central, w < 5.0);
}

const SMALL: f32 = 12.0;

// The u-quantile of the Poisson distribution: summed where the mean is small, else the asymptotic
// expansion in the normal quantile (Giles, "Algorithm 955", ACM TOMS 42, 2016, equation 8).
fn poisson_quantile(mean: f32, u: f32) -> f32 {
    let z = normal_quantile(u);
    let root = sqrt(mean);
    let safe = max(mean, SMALL);
    let large = mean + root * z + (1.0 / 3.0 + z * z / 6.0)
        - (z / 36.0 + z * z * z / 72.0) / sqrt(safe)
        + (z * z * (7.0 / 810.0 + z * z / 270.0) - 8.0 / 405.0) / safe;
    if (mean >= SMALL) { return max(floor(large), 0.0); }
    var k = 0.0;
    var term = exp(-mean);
    var sum = term;
    loop {
        if (u <= sum || k >= 60.0) { break; }
        k += 1.0;
        term *= mean / k;
        sum += term;
    }
    return k;
}

fn digital(i: u32, full: f32) -> u32 {
    if (i >= params.count) { return 0u; }
    let row = i / params.width;
    let column = i % params.width;
    let value = radiance[row * params.stride + column];
    if ((bitcast<u32>(value) & 0x7f800000u) == 0x7f800000u) { return u32(full); }
    let key = vec2u(params.seed, params.camera);
    var signal = max(value, 0.0) * params.electrons;
    if (mosaic == 1u) {
        signal *= params.tile[2u * ((row + params.row0) & 1u) + (column & 1u)];
    }
    var offset = 0.0;
    if (pattern == 1u) {
        let fixed = philox(vec4u(params.first + i, 0u, 1u, 0u), key);
        offset = params.dsnu * normal_quantile(uniform_of(fixed.x));
        signal *= max(1.0 + params.prnu * normal_quantile(uniform_of(fixed.y)), 0.0);
    }
    signal += params.dark;
    var random = vec4u(0u);
    if (shot == 1u || readout == 1u) {
        random = philox(vec4u(params.first + i, params.frame, 0u, 0u), key);
    }
    if (shot == 1u) { signal = poisson_quantile(signal, uniform_of(random.x)); }
    signal = min(signal, params.full_well) + offset;
    if (readout == 1u) { signal += params.read_noise * normal_quantile(uniform_of(random.y)); }
    var grey = params.gain * signal + params.black;
    if (curved == 1u) {
        grey = full * pow(clamp(grey / full, 0.0, 1.0), params.exponent);
    }
    return u32(clamp(round(grey), 0.0, full));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let word = gid.y * (groups.x * 64u) + gid.x;
    let per_word = select(2u, 4u, bits <= 8u);
    if (per_word * word >= params.count) { return; }
    let full = f32((1u << bits) - 1u);
    var packed = 0u;
    for (var k = 0u; k < per_word; k++) {
        packed |= digital(per_word * word + k, full) << (k * (32u / per_word));
    }
    words[word] = packed;
}
