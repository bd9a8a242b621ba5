// The pixels whose centres a small triangle may cover, its corners snapped to 1/256 px.
#import lib/numeric/texel

// three vertices per triangle
@group(0) @binding(12) var<storage, read> corners: array<u32>;
// per vertex (column, row in 1/65536 px, near / z, what places leave of that in 16 bits each), or, where
// depth doesn't matter, the first of three texels of lib/raster/vertex.wgsl
@group(0) @binding(18) var places: texture_storage_2d<rgba32uint, read>;

override spacing: u32 = 1u;

// The corners in 1/256 px from the first row of the band on, and their near / z.
struct Places {
    p: vec2i,
    q: vec2i,
    r: vec2i,
    depth: vec3f,
}
fn places_of(id: u32, row0: i32) -> Places {
    let a = textureLoad(places, texel(spacing * corners[3u * id]));
    let b = textureLoad(places, texel(spacing * corners[3u * id + 1u]));
    let c = textureLoad(places, texel(spacing * corners[3u * id + 2u]));
    let band = vec2i(0, 256 * row0);
    return Places(snapped(a) - band, snapped(b) - band, snapped(c) - band,
        bitcast<vec3f>(vec3u(a.z, b.z, c.z)));
}
fn snapped(at: vec4u) -> vec2i {
    let rest = vec2u(at.w & 65535u, at.w >> 16u);
    return (vec2i(at.xy + (rest >> vec2u(15u))) + 128) >> vec2u(8u);
}

// The first pixel and how many columns and rows follow it; below 0 where there is none.
struct Box {
    low: vec2i,
    size: vec2i,
}
fn box_of(at: Places, size: vec2i) -> Box {
    let low = max((min(min(at.p, at.q), at.r) + 255) >> vec2u(8u), vec2i(0));
    let high = min(max(max(at.p, at.q), at.r) >> vec2u(8u), size - 1);
    return Box(low, high - low);
}
