// Triangles of chessboards that lie within one field (gpusim/optics/shading/looks.py).
#import lib/numeric/texel
#import lib/raster/vertex

// per paint three texels: (size of a field, half the largest pixel, albedo beside the board, 1: a board),
// (the board's origin, first lines), (last lines, dark, light)
@group(0) @binding(43) var boards: texture_2d<f32>;

// What float32 may be off by, of the paint coordinates.
const ROUNDING: f32 = 5e-7;
// In place of a field's number, beside the board.
const OUTSIDE: i32 = 0x7fffffff;

struct Lattice {
    size: f32,
    origin: vec2f,
    first: vec2f,
    last: vec2f,
}
// The field that a place lies in; `close` if a line is within the margin.
struct Field {
    number: vec2i,
    close: bool,
}
fn field_of(lattice: Lattice, v: Vertex, reach: f32) -> Field {
    let whole = vec2f(v.cell) * v.side;
    let at = whole + v.st - lattice.origin;
    let turn = at / lattice.size;
    let line = clamp(round(turn), lattice.first, lattice.last);
    let before = clamp(floor(turn), lattice.first - 1.0, lattice.last);
    let margin = vec2f(reach) + ROUNDING * (abs(whole) + abs(lattice.origin) + lattice.size);
    let close = abs(turn - line) * lattice.size <= margin;
    // which side it is beside: 1 or 2 along the first axis, 4 or 8 along the second
    let side = select(select(vec2i(0), vec2i(2, 8), before == lattice.last), vec2i(1, 4),
        before < lattice.first);
    let beside = select(side, vec2i(0), close);
    let out = beside.x + beside.y;
    return Field(select(vec2i(before), vec2i(OUTSIDE, select(out, beside.y, beside.y != 0)), out != 0),
        any(close) && out == 0);
}

// How numbers at the corners change per column and row, times twice the triangle's area.
fn slope_of(u: vec2f, v: vec2f, one: f32, two: f32) -> vec2f {
    return vec2f(one * v.y - two * u.y, two * u.x - one * v.x);
}

// Half of the largest pixel on a triangle, in paint coordinates; `stretch`: by what the lens stretches
// a pixel at most.
fn footprint_of(a: Vertex, b: Vertex, c: Vertex, stretch: f32) -> f32 {
    let anchor = anchor_of(a, b, c);
    let p = offset_from(anchor, a);
    let u = offset_from(anchor, b) - p;
    let v = offset_from(anchor, c) - p;
    let w = 1.0 + vec3f(a.offset, b.offset, c.offset);
    // s / z and 1 / z are affine in the image
    let rate = slope_of(u, v, b.offset - a.offset, c.offset - a.offset);
    let one = vec2f(b.cell - a.cell) * a.side + (b.st - a.st);
    let two = vec2f(c.cell - a.cell) * a.side + (c.st - a.st);
    let near = 1.0 / w;
    let sizes = max(sizes_of(slope_of(u, v, one.x * w.y, two.x * w.z), rate, one.x, two.x),
        sizes_of(slope_of(u, v, one.y * w.y, two.y * w.z), rate, one.y, two.y)) * near;
    return 0.5 * stretch * max(sizes.x, max(sizes.y, sizes.z)) / abs(u.x * v.y - u.y * v.x);
}
// A coordinate's changes per column and row together, at the corners, times depth; of what is 0 at the
// first corner, `one` and `two` at the others.
fn sizes_of(change: vec2f, rate: vec2f, one: f32, two: f32) -> vec3f {
    let first = abs(change);
    let second = abs(change - one * rate);
    let third = abs(change - two * rate);
    return vec3f(first.x + first.y, second.x + second.y, third.x + third.y);
}

struct Look {
    albedo: f32,
    // whether pixels on it may reach over a line
    near: bool,
    // whether they may be larger than its paint says
    larger: bool,
}
fn look_of(a: Vertex, b: Vertex, c: Vertex, paint: u32, stretch: f32, margin: f32) -> Look {
    let traits = textureLoad(boards, texel(3u * paint), 0);
    if (traits.w == 0.0) { return Look(traits.z, false, false); }
    let more = textureLoad(boards, texel(3u * paint + 1u), 0);
    let most = textureLoad(boards, texel(3u * paint + 2u), 0);
    let lattice = Lattice(traits.x, more.xy, more.zw, most.xy);
    let reach = footprint_of(a, b, c, stretch);
    let one = field_of(lattice, a, margin * reach);
    let two = field_of(lattice, b, margin * reach);
    let three = field_of(lattice, c, margin * reach);
    let near = one.close || two.close || three.close
        || any(one.number != two.number) || any(one.number != three.number);
    let field = select(most.z, most.w, ((one.number.x + one.number.y) & 1) != 0);
    // it is larger where it isn't a number
    return Look(select(field, traits.z, near || one.number.x == OUTSIDE), near, !(reach <= traits.y));
}
