// Rectangles, lines, triangles and letters over a picture: convex quads with soft edges, and sprites
// whose pixels are copied. The NumPy form is gpusim/visualization/overlay.py.
struct Params {
    width: f32,
    height: f32,
}
struct Quad {
    // corners in order, px from the target's top left; the last one twice for a triangle
    ab: vec4f,
    cd: vec4f,
    color: vec4f,
    // of a letter: first byte of its coverage, columns (0: no letter), rows; then bits: edge k is hard
    sprite: vec4u,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> quads: array<Quad>;
@group(0) @binding(2) var<storage, read> letters: array<u32>;

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) quad: u32,
}

fn corner_of(quad: Quad, k: u32) -> vec2f {
    let pair = select(quad.ab, quad.cd, k % 4u > 1u);
    return select(pair.xy, pair.zw, k % 2u == 1u);
}

// 1 or -1: which way round the corners go
fn turn_of(quad: Quad) -> f32 {
    let across = quad.cd.xy - quad.ab.xy;
    let other = quad.cd.zw - quad.ab.zw;
    return select(-1.0, 1.0, across.x * other.y - across.y * other.x > 0.0);
}

// A corner moved outwards, so that both of its edges are a pixel farther out.
fn outward(quad: Quad, k: u32) -> vec2f {
    let own = corner_of(quad, k);
    var before = corner_of(quad, k + 3u);
    if (all(before == own)) { before = corner_of(quad, k + 2u); }
    var after = corner_of(quad, k + 1u);
    if (all(after == own)) { after = corner_of(quad, k + 2u); }
    let a = normalize(own - before);
    let b = normalize(after - own);
    let normal = turn_of(quad) * (vec2f(a.y, -a.x) + vec2f(b.y, -b.x));
    // at sharp tips less, not to go on for ever
    return own + normal / max(1.0 + dot(a, b), 0.1);
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let quad = quads[index / 6u];
    var order = array<u32, 6>(0u, 1u, 2u, 0u, 2u, 3u);
    let k = order[index % 6u];
    var at = corner_of(quad, k);
    if (quad.sprite.y == 0u) { at = outward(quad, k); }
    let place = vec2f(2.0 * at.x / params.width - 1.0, 1.0 - 2.0 * at.y / params.height);
    return Varying(vec4f(place, 0.0, 1.0), index / 6u);
}

// The share of a pixel at p that lies inside, by its distances to the edges.
fn coverage(quad: Quad, p: vec2f) -> f32 {
    let turn = turn_of(quad);
    var outside = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let from_corner = corner_of(quad, k);
        let edge = corner_of(quad, k + 1u) - from_corner;
        let size = length(edge);
        if (size > 0.0) {
            let d = p - from_corner;
            let inside = turn * (edge.x * d.y - edge.y * d.x) / size;
            let hard = ((quad.sprite.w >> k) & 1u) == 1u;
            outside += select(1.0 - clamp(inside + 0.5, 0.0, 1.0), f32(inside < 0.0), hard);
        }
    }
    return max(1.0 - outside, 0.0);
}

fn letter(quad: Quad, p: vec2f) -> f32 {
    let cell = vec2u(clamp(p - quad.ab.xy, vec2f(0.0), vec2f(quad.sprite.yz) - 0.5));
    let byte = quad.sprite.x + cell.y * quad.sprite.y + cell.x;
    return f32((letters[byte / 4u] >> (8u * (byte % 4u))) & 255u) / 255.0;
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4f {
    let quad = quads[in.quad];
    var share = 0.0;
    if (quad.sprite.y > 0u) {
        share = letter(quad, in.position.xy);
    } else {
        share = coverage(quad, in.position.xy);
    }
    return vec4f(quad.color.rgb, quad.color.a * share);
}
