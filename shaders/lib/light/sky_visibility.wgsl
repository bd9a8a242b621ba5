// Which share of the surroundings' light reaches a place on a triangle.
// The NumPy form is gpusim/optics/ambient/sky_visibility.py, which explains it.
#import lib/numeric/texel

override sheltered: u32;
// per triangle (place along its first edge, affine in the position), (along its last edge) and
// (cells n of an edge, first piece, -, -); per piece (first node, cells m of an edge, -, -); per node
// the shares at the corners of the cell that it begins
@group(0) @binding(68) var openness: texture_2d<u32>;

// Of a place in a triangle of n cells an edge: the cell, and the place in it.
struct Cell {
    at: vec2u,
    part: vec2f,
}
fn cell_of(place: vec2f, n: u32) -> Cell {
    let most = 1.0 - 1e-5;
    let p = max(place, vec2f(0.0));
    let uv = p * (f32(n) * most / max(p.x + p.y, most));
    let at = floor(uv);
    return Cell(vec2u(at), uv - at);
}

fn openness_at(id: u32, x: vec3f) -> f32 {
    if (sheltered == 0u) { return 1.0; }
    let a = bitcast<vec4f>(textureLoad(openness, texel(3u * id), 0));
    let b = bitcast<vec4f>(textureLoad(openness, texel(3u * id + 1u), 0));
    let head = textureLoad(openness, texel(3u * id + 2u), 0).xy;
    let outer = cell_of(vec2f(dot(a.xyz, x) + a.w, dot(b.xyz, x) + b.w), head.x);
    let upper = outer.part.x + outer.part.y > 1.0;
    let number = 2u * (outer.at.y * head.x + outer.at.x) + select(0u, 1u, upper);
    let piece = textureLoad(openness, texel(head.y + number), 0).xy;
    let inner = cell_of(select(outer.part, 1.0 - outer.part, upper), piece.y);
    let node = piece.x + inner.at.y * (piece.y + 1u) + inner.at.x;
    let v = bitcast<vec4f>(textureLoad(openness, texel(node), 0));
    let p = inner.part;
    let low = v.x + p.x * (v.y - v.x) + p.y * (v.z - v.x);
    let high = v.w + (1.0 - p.x) * (v.z - v.w) + (1.0 - p.y) * (v.y - v.w);
    return select(low, high, p.x + p.y > 1.0);
}
