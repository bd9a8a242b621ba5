// Counter-based random numbers: Philox 4x32 with ten rounds (Salmon, Moraes, Dror and Shaw, "Parallel
// random numbers: as easy as 1, 2, 3", SC 2011). The same counter and key give the same four words
// on every device, in any order.

// The upper half of a 64-bit product, from 16-bit halves.
fn high_product(a: u32, b: u32) -> u32 {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let cross = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let other = (a & 0xffffu) * (b >> 16u) + (cross & 0xffffu);
    return (a >> 16u) * (b >> 16u) + (cross >> 16u) + (other >> 16u);
}

fn philox(counter: vec4u, key: vec2u) -> vec4u {
    var c = counter;
    var k = key;
    for (var turn = 0; turn < 10; turn++) {
        c = vec4u(
            high_product(0xcd9e8d57u, c.z) ^ c.y ^ k.x,
            0xcd9e8d57u * c.z,
            high_product(0xd2511f53u, c.x) ^ c.w ^ k.y,
            0xd2511f53u * c.x,
        );
        k += vec2u(0x9e3779b9u, 0xbb67ae85u);
    }
    return c;
}

// A word as a number in (0, 1), a multiple of 2^-24 plus half of one, but for the last, which would be rounded to 1.
fn uniform_of(word: u32) -> f32 {
    return min((f32(word >> 8u) + 0.5) * 5.9604644775390625e-8, 0.999999940395355224609375);
}
