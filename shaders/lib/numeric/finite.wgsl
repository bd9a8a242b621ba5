// NaN and infinity by their bits: drivers may take x != x for false and clamp NaN away.
fn is_finite_f32(x: f32) -> bool { return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u; }
