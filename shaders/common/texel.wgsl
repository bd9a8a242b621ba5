// Where entry i of an array of texels lies (gpusim/gpu/texels.py).
fn texel(i: u32) -> vec2u { return vec2u(i & 4095u, i >> 12u); }
