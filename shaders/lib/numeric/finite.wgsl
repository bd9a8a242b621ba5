// NaN and infinity by their bits: drivers may take x != x for false and clamp NaN away. The sign is shifted
// out, not masked: one driver knows `bits & 0x7f800000` for a test of finiteness and answers it with true.
fn is_finite_f32(x: f32) -> bool { return (bitcast<u32>(x) << 1u) < 0xff000000u; }
