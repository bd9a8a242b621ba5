// The vertices that a view's triangles share (gpusim/optics/raster/triangle_records.py).
#import lib/numeric/texel

// per vertex three texels: (column, row in 1/65536 px, relative offset of 1 / depth, what places leave in
// 16 bits each), (cells of the pattern along s and t, s and t within the cell),
// (normal, side of a cell)
@group(0) @binding(3) var vertices: texture_storage_2d<rgba32uint, read>;

const PIXEL: f32 = 65536.0;

struct Vertex {
    at: vec2i,
    rest: vec2f,
    // of 1 / depth
    offset: f32,
    cell: vec2i,
    st: vec2f,
    normal: vec3f,
    side: f32,
}
fn vertex_at(number: u32) -> Vertex {
    let a = textureLoad(vertices, texel(3u * number));
    let b = textureLoad(vertices, texel(3u * number + 1u));
    let c = bitcast<vec4f>(textureLoad(vertices, texel(3u * number + 2u)));
    let rest = vec2f(vec2u(a.w & 65535u, a.w >> 16u)) / PIXEL;
    return Vertex(bitcast<vec2i>(a.xy), rest, bitcast<f32>(a.z), bitcast<vec2i>(b.xy),
        bitcast<vec2f>(b.zw), c.xyz, c.w);
}

// The pixel next to the middle of a triangle.
fn anchor_of(p: Vertex, q: Vertex, r: Vertex) -> vec2i {
    // no division of whole numbers, which is done one by one
    let middle = p.at + vec2i(vec2f(q.at - p.at + r.at - p.at) / 3.0);
    return (middle + vec2i(32768)) >> vec2u(16u);
}

// Where a vertex lies from a pixel's middle, px.
fn offset_from(pixel: vec2i, v: Vertex) -> vec2f {
    return (vec2f(v.at - pixel * 65536) + v.rest) / PIXEL;
}
