// Paint: a ground albedo and features (checker patches, discs, sectors) found through a grid of cells.
// Features of one layer don't overlap (the host checks it), and what lies on another says how much
// it changes: so their shares add.
//
// Loops test at their end: software drivers pass over the body until no lane is left, so that a
// test at the beginning costs one pass more than there are turns.
// The NumPy form is gpusim/optics/paint/feature_grid.py (tables) and gpusim/optics/paint/footprint_mean.py.
#import lib/light/color
#import lib/paint/area_integrals
#import lib/paint/anisotropic_footprint
#import lib/paint/disc_coverage
#import lib/numeric/texel

struct Paint {
    ground: f32,
    cell: f32,
    i0: i32,
    j0: i32,
    columns: i32,
    rows: i32,
    first: u32,
    featured: u32,
    dot: f32,
    cuts: u32,
    // 0 where no footprint of speckle is larger than its table was made for
    piece: f32,
    longest: f32,
    coverage: f32,
}

// four texels per paint: its members in order
@group(0) @binding(1) var paints: texture_2d<u32>;
fn paint_at(number: u32) -> Paint {
    let a = textureLoad(paints, texel(4u * number), 0);
    let b = textureLoad(paints, texel(4u * number + 1u), 0);
    let c = textureLoad(paints, texel(4u * number + 2u), 0);
    let d = textureLoad(paints, texel(4u * number + 3u), 0);
    return Paint(bitcast<f32>(a.x), bitcast<f32>(a.y), bitcast<i32>(a.z), bitcast<i32>(a.w),
        bitcast<i32>(b.x), bitcast<i32>(b.y), b.z, b.w, bitcast<f32>(c.x), c.y,
        bitcast<f32>(c.z), bitcast<f32>(c.w), bitcast<f32>(d.x));
}

// kind 0, checker patch: a = (corner relative to the cell, cos, sin), b = (square width, height,
// columns, rows), c = (albedo of even squares, of odd squares, kind, covers), d = (index of the corner)
// kind 1, disc: a = (centre relative to the cell, radius, -), c = (albedo, -, kind, covers)
// even, odd: the colours of both albedos
// covers: 1, or 0 for what lies on another feature, -1 for what two of them cover
// kind 2, sector of a disc: as a disc, and b = (cos, sin) of its first and of its last side
struct Feature {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    d: vec4f,
    even: Color,
    odd: Color,
}

// Which kinds of features a view has, and whether any square is smaller than a pixel: software
// rasterisers execute both sides of an `if`, so that what isn't there must not be compiled in.
override checkers: u32;
// discs: 0 none, 1 of any size, 2 only large against a pixel
override discs: u32;
override sectors: u32;
override fine: u32;

// per cell (first texel of its features, their count, -, -), then four texels per feature: where
// lanes read addresses of their own, a texel of four numbers costs as much as one of a buffer
@group(0) @binding(2) var patterns: texture_storage_2d<rgba32float, read>;

// First texel and count of a cell's features.
fn feature_list(slot: u32) -> vec2u {
    return vec2u(textureLoad(patterns, texel(slot)).xy);
}

fn feature_at(i: u32) -> Feature {
    let c = textureLoad(patterns, texel(i + 2u));
    return Feature(
        textureLoad(patterns, texel(i)), textureLoad(patterns, texel(i + 1u)),
        c, textureLoad(patterns, texel(i + 3u)), color_of(c.x), color_of(c.y),
    );
}

// Share of the footprint that prints cover, added up by what finds its albedo.
var<private> printed: f32 = 0.0;

// Albedo times share, and share, of squares.
struct Squares {
    albedo: Color,
    share: f32,
}

// Of the four squares that meet at a lattice corner, from the shares of
// the pixel right of it, above it, and both.
fn corner_squares(f: Feature, corner: vec2f, right: f32, above: f32, both: f32) -> Squares {
    let shares = vec4f(both, right - both, above - both, 1.0 - right - above + both);
    let i = vec4f(corner.x, corner.x, corner.x - 1.0, corner.x - 1.0);
    let j = vec4f(corner.y, corner.y - 1.0, corner.y, corner.y - 1.0);
    let inside = (i >= vec4f(0.0)) & (i < vec4f(f.b.z)) & (j >= vec4f(0.0)) & (j < vec4f(f.b.w));
    let parity = (i + j) - 2.0 * floor(0.5 * (i + j));
    let share = select(vec4f(0.0), shares, inside);
    return Squares(squares_color(f.even, f.odd, parity, share), dot(share, vec4f(1.0)));
}

// Share of the pixel with centre d and change ex, ey per column and row that is right of x = 0 and
// above y = 0, from the shares of both sides.
fn corner_share(d: vec2f, ex: vec2f, ey: vec2f, right: f32, above: f32) -> f32 {
    let area = ex.x * ey.y - ex.y * ey.x;
    let p0 = d - 0.5 * ex - 0.5 * ey;
    let p1 = d + 0.5 * ex - 0.5 * ey;
    let p2 = d + 0.5 * ex + 0.5 * ey;
    let p3 = d - 0.5 * ex + 0.5 * ey;
    let sum = quadrant_edge(p0, p1) + quadrant_edge(p1, p2)
        + quadrant_edge(p2, p3) + quadrant_edge(p3, p0);
    return clamp(sum / area, max(0.0, right + above - 1.0), min(right, above));
}

// A checker patch over the pixel with centre p and change ex, ey per column and row (patch axes).
// q is the relative change of 1 / z per column and row: a line of the pattern at distance d from p
// is straight on screen, with gradient e + d q, so that perspective inside the pixel is exact.
fn checker_share(f: Feature, p: vec2f, dx: vec2f, dy: vec2f, q: vec2f) -> Squares {
    let size = f.b.xy;
    let low = -f.d.xy;
    let corner = clamp(round(p / size), low, low + f.b.zw);
    let d = p - corner * size;
    let ex = dx + d * q.x;
    let ey = dy + d * q.y;
    let right = half_plane_share(d.x, vec2f(ex.x, ey.x));
    let above = half_plane_share(d.y, vec2f(ex.y, ey.y));
    var both = right * above;
    if (right > 0.0 && right < 1.0 && above > 0.0 && above < 1.0) {
        both = corner_share(d, ex, ey, right, above);
    }
    return corner_squares(f, corner + f.d.xy, right, above, both);
}

// The whole patch as one square of its mean albedo, p moved to its first corner.
struct Mean {
    f: Feature,
    p: vec2f,
}
fn as_one_square(f: Feature, p: vec2f) -> Mean {
    var m = Mean(f, p + f.d.xy * f.b.xy);
    m.f.b = vec4f(f.b.xy * f.b.zw, 1.0, 1.0);
    m.f.even = 0.5 * (f.even + f.odd);
    m.f.d = vec4f(0.0);
    return m;
}

// The same where squares may be smaller than the footprint: it is cut into n x n pieces, each
// smaller than a square; a pattern finer than FINEST squares a pixel is taken as grey.
const FINEST: i32 = 8;
fn checker_shares(
    feature: Feature, centre: vec2f, ex: vec2f, ey: vec2f, q: vec2f
) -> Squares {
    let reach = (abs(ex) + abs(ey)) / feature.b.xy;
    if (fine == 0u) { return checker_share(feature, centre, ex, ey, q); }
    var n = max(i32(min(ceil(max(reach.x, reach.y)), 1e6)), 1);
    var m = Mean(feature, centre);
    if (n > FINEST) {
        m = as_one_square(feature, centre);
        n = 1;
    }
    let step = 1.0 / f32(n);
    var sum = Squares(Color(0.0), 0.0);
    // row by row in one loop; a division of integers takes longer than all of this
    let total = n * n;
    var k = 0;
    loop {
        let row = floor((f32(k) + 0.5) * step);
        let o = (vec2f(f32(k) - row * f32(n), row) + 0.5) * step - 0.5;
        let w = 1.0 / (1.0 + dot(q, o));
        let offset = (o.x * ex + o.y * ey) * w;
        let s = step * w;
        let own = checker_share(m.f, m.p + offset, s * (ex - offset * q.x),
            s * (ey - offset * q.y), s * q);
        sum.albedo += own.albedo;
        sum.share += own.share;
        k++;
        if (k >= total) { break; }
    }
    return Squares(sum.albedo * step * step, sum.share * step * step);
}

// Share of the parallelogram with centre p (relative to the disc's centre) inside the disc.
fn disc_share(p: vec2f, ex: vec2f, ey: vec2f, r: f32) -> f32 {
    let reach = 0.5 * max(length(ex + ey), length(ex - ey));
    let dist = length(p);
    if (dist >= r + reach) { return 0.0; }
    if (dist <= r - reach) { return 1.0; }
    if (discs == 2u || r > 3.0 * reach) { return large_disc_share(p, ex, ey, r); }
    let area = ex.x * ey.y - ex.y * ey.x;
    let p0 = p - 0.5 * ex - 0.5 * ey;
    let p1 = p + 0.5 * ex - 0.5 * ey;
    let p2 = p + 0.5 * ex + 0.5 * ey;
    let p3 = p - 0.5 * ex + 0.5 * ey;
    let sum = small_disc_edge(p0, p1, r) + small_disc_edge(p1, p2, r)
        + small_disc_edge(p2, p3, r) + small_disc_edge(p3, p0, r);
    return clamp(sum / area, 0.0, 1.0);
}

// What the edge p -> q sweeps over, seen from the apex, of a sector with inward normals l and m.
// The sector's straight sides sweep nothing.
fn sector_edge(p: vec2f, q: vec2f, l: vec2f, m: vec2f, r: f32) -> f32 {
    let a = vec2f(dot(p, l), dot(p, m));
    let b = vec2f(dot(q, l), dot(q, m));
    if ((a.x < 0.0 && b.x < 0.0) || (a.y < 0.0 && b.y < 0.0)) { return 0.0; }
    let t = a / select(vec2f(1.0), a - b, a != b);
    let start = max(select(0.0, t.x, a.x < 0.0), select(0.0, t.y, a.y < 0.0));
    let stop = min(select(1.0, t.x, b.x < 0.0), select(1.0, t.y, b.y < 0.0));
    if (start >= stop) { return 0.0; }
    return small_disc_edge(p + start * (q - p), p + stop * (q - p), r);
}

// Share of the parallelogram with centre p (relative to the apex) inside a sector.
fn sector_share(f: Feature, p: vec2f, ex: vec2f, ey: vec2f, q: vec2f) -> f32 {
    let r = f.a.z;
    let l = vec2f(-f.b.y, f.b.x);
    let m = vec2f(f.b.w, -f.b.z);
    let inside = disc_share(p, ex, ey, r);
    let gl = vec2f(dot(ex, l), dot(ey, l)) + dot(p, l) * q;
    let gm = vec2f(dot(ex, m), dot(ey, m)) + dot(p, m) * q;
    let share = vec3f(inside, half_plane_share(dot(p, l), gl), half_plane_share(dot(p, m), gm));
    let product = share.x * share.y * share.z;
    // whole in two of them: the third one's share is the answer
    let partly = select(vec3f(0.0), vec3f(1.0), share < vec3f(1.0));
    if (product <= 0.0 || partly.x + partly.y + partly.z <= 1.0) { return product; }
    let p0 = p - 0.5 * ex - 0.5 * ey;
    let p1 = p + 0.5 * ex - 0.5 * ey;
    let p2 = p + 0.5 * ex + 0.5 * ey;
    let p3 = p - 0.5 * ex + 0.5 * ey;
    let sum = sector_edge(p0, p1, l, m, r) + sector_edge(p1, p2, l, m, r)
        + sector_edge(p2, p3, l, m, r) + sector_edge(p3, p0, l, m, r);
    return clamp(sum / (ex.x * ey.y - ex.y * ey.x), 0.0, 1.0);
}

// Mean albedo over a pixel of discs alone: those out of reach are sorted out first, so that the
// costly part runs for one or two of them only.
fn paint_discs(ground: Color, list: vec2u, p: vec2f, ex: vec2f, ey: vec2f) -> Color {
    let reach = 0.5 * max(length(ex + ey), length(ex - ey));
    var albedo = ground;
    if (list.y == 0u) { return ground; }
    var done = 0u;
    loop {
        let count = min(list.y - done, 32u);
        var near = 0u;
        var i = 0u;
        loop {
            let a = textureLoad(patterns, texel(list.x + 4u * (done + i)));
            near |= select(0u, 1u << i, length(p - a.xy) - a.z < reach);
            i++;
            if (i >= count) { break; }
        }
        if (near != 0u) {
            loop {
                let f = feature_at(list.x + 4u * (done + firstTrailingBit(near)));
                let share = disc_share(p - f.a.xy, ex, ey, f.a.z);
                albedo += (f.even - ground) * share;
                printed += share * f.c.w;
                near &= near - 1u;
                if (near == 0u) { break; }
            }
        }
        done += 32u;
        if (done >= list.y) { break; }
    }
    return albedo;
}

fn cells_of(paint: Paint) -> SpeckleCells {
    return SpeckleCells(
        paint.cell, vec2i(paint.i0, paint.j0), vec2i(paint.columns, paint.rows), paint.first,
        paint.featured == 2u, paint.piece, paint.longest, paint.coverage,
    );
}

// Mean albedo over the pixel with centre `st` (relative to cell `cell`), change ex, ey per column
// and row, and relative change q of 1 / z.
fn paint_pixel(
    paint: Paint, cell: vec2i, st: vec2f, ex: vec2f, ey: vec2f, q: vec2f
) -> Color {
    let ground = color_of(paint.ground);
    if (grazing != 0u) {
        let covered = grazing_cover(cells_of(paint), cell, st, ex, ey, q);
        return mix(ground, color_of(paint.dot), covered);
    }
    let k = floor(st / paint.cell);
    let at = cell + vec2i(k) - vec2i(paint.i0, paint.j0);
    if (at.x < 0 || at.y < 0 || at.x >= paint.columns || at.y >= paint.rows) {
        return ground;
    }
    let slot = paint.first + u32(at.y * paint.columns + at.x);
    let local = st - k * paint.cell;
    if (speckle != 0u) {
        let covered = speckle_cover(slot, local, ex, ey, paint.cuts);
        return mix(ground, color_of(paint.dot), covered);
    }
    var albedo = ground;
    let list = feature_list(slot);
    if (checkers == 0u && sectors == 0u) { return paint_discs(ground, list, local, ex, ey); }
    if (list.y == 0u) { return ground; }
    var i = 0u;
    loop {
        let f = feature_at(list.x + 4u * i);
        let p = local - f.a.xy;
        if (checkers != 0u && f.c.z == 0.0) {
            let turn = mat2x2f(f.a.z, -f.a.w, f.a.w, f.a.z);
            let s = checker_shares(f, turn * p, turn * ex, turn * ey, q);
            albedo += s.albedo - ground * s.share;
            printed += s.share * f.c.w;
        }
        if (discs != 0u && f.c.z == 1.0) {
            let share = disc_share(p, ex, ey, f.a.z);
            albedo += (f.even - ground) * share;
            printed += share * f.c.w;
        }
        if (sectors != 0u && f.c.z == 2.0) {
            let share = sector_share(f, p, ex, ey, q);
            albedo += (f.even - ground) * share;
            printed += share * f.c.w;
        }
        i++;
        if (i >= list.y) { break; }
    }
    return albedo;
}
