// Where entry i of an array of texels lies (gpusim/gpu/texture_array.py). Textures that a kernel reads most
// are storage textures, four with those it writes: they are read twice as fast as sampled ones.
fn texel(i: u32) -> vec2u { return vec2u(i & 4095u, i >> 12u); }
