// The last word of a triangle's plane: in 24 bits the occluder that it is part of, or NO_OWNER, and in the
// others how far normals for shading are from its own, in steps. gpusim/optics/shadow/receivers.py packs it, too.
const NO_OWNER: u32 = 0xffffffu;
const LEAN: f32 = 170.0;
