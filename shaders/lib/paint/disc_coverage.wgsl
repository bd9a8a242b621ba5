// Speckle: the share of a footprint that discs cover, from lists of discs per cell.
// The NumPy form is gpusim/optics/paint/disc_coverage.py.
#import lib/paint/area_integrals
#import lib/numeric/texel

// 0 none, 1 discs with soft edges, 2 with hard ones, 3 both kinds in one view
override speckle: u32;

// a cell's texel is (start, count, smallest, -) of its list, where discs differ the radius of the
// smallest; a disc's is (s, t, radius, 1 / (2 r h)), s and t from the cell's corner, h the half width
// of its edge
@group(0) @binding(16) var speckles: texture_storage_2d<rgba32float, read>;

const GAUSS: f32 = 0.3872983346207417;
const END: f32 = 0.2777777777777778;
const MIDDLE: f32 = 0.4444444444444444;

// What a soft disc leaves open: 1 - S(u) = S(-u).
fn leaves(u: vec3f) -> vec3f {
    let x = clamp(u, vec3f(-1.0), vec3f(1.0));
    let v = x * x;
    return 0.5 - x * (1.09375 + v * (v * (0.65625 - 0.15625 * v) - 1.09375));
}

// Covered share of the parallelogram with centre p and sides ex, ey: 3 x 3 Gauss points.
fn soft_cover(first: u32, count: u32, p: vec2f, ex: vec2f, ey: vec2f) -> f32 {
    let x = GAUSS * ex;
    let y = GAUSS * ey;
    let across = vec3f(dot(x, x), 0.0, dot(x, x));
    let mixed = vec3f(-2.0, 0.0, 2.0) * dot(x, y);
    let square0 = across - mixed + dot(y, y);
    let square2 = across + mixed + dot(y, y);
    var t0 = vec3f(1.0);
    var t1 = vec3f(1.0);
    var t2 = vec3f(1.0);
    if (count == 0u) { return 0.0; }
    // tests come last, here and below: see feature_grid.wgsl
    var i = first;
    loop {
        let disc = textureLoad(speckles, texel(i));
        let m = p - disc.xy;
        let row = disc.z * disc.z - dot(m, m) - vec3f(-2.0, 0.0, 2.0) * dot(m, x);
        let up = 2.0 * dot(m, y);
        t0 *= leaves((row + up - square0) * disc.w);
        t1 *= leaves((row - across) * disc.w);
        t2 *= leaves((row - up - square2) * disc.w);
        i++;
        if (i >= first + count) { break; }
    }
    let w = vec3f(END, MIDDLE, END);
    return 1.0 - (END * (dot(t0, w) + dot(t2, w)) + MIDDLE * dot(t1, w));
}

// Covered parts of four segments: from the start to `left`, from `right` to the end, and between
// `low` and `high`; `total` counts every disc.
struct Rows {
    left: vec4f,
    right: vec4f,
    low: vec4f,
    high: vec4f,
    total: vec4f,
}

fn no_rows() -> Rows {
    return Rows(vec4f(0.0), vec4f(1.0), vec4f(1.0), vec4f(0.0), vec4f(0.0));
}

// Put a disc over segments: |m + x d|^2 = r^2 with a = d.d, b = m.d, c = m.m - r^2, x in 0 ... 1.
fn cover_rows(rows: Rows, a: f32, b: vec4f, c: vec4f) -> Rows {
    let square = b * b - a * c;
    let root = sqrt(max(square, vec4f(0.0)));
    let inverse = 1.0 / max(a, 1e-37);
    let low = (-b - root) * inverse;
    let high = (root - b) * inverse;
    let meets = (square > vec4f(0.0)) & (high > vec4f(0.0)) & (low < vec4f(1.0));
    let starts = meets & (low <= vec4f(0.0));
    let ends = meets & (high >= vec4f(1.0));
    let between = meets & !starts & !ends;
    let from_start = min(high, vec4f(1.0));
    let to_end = max(low, vec4f(0.0));
    return Rows(
        max(rows.left, select(vec4f(0.0), from_start, starts)),
        min(rows.right, select(vec4f(1.0), to_end, ends)),
        min(rows.low, select(vec4f(1.0), low, between)),
        max(rows.high, select(vec4f(0.0), high, between)),
        rows.total + select(vec4f(0.0), from_start - to_end, meets),
    );
}

fn union_rows(rows: Rows) -> vec4f {
    let middle = min(rows.high, rows.right) - max(rows.low, rows.left);
    return 1.0 - max(rows.right - rows.left, vec4f(0.0)) + max(middle, vec4f(0.0));
}

// Covered share of a parallelogram: circle segments in closed form, less what eight rows find
// covered twice. They run along the side that the circles' edges are more square to.
fn hard_cover(first: u32, count: u32, p: vec2f, ex: vec2f, ey: vec2f) -> f32 {
    let y0 = vec4f(-0.4375, -0.3125, -0.1875, -0.0625);
    let y1 = -y0;
    var along = ex;
    var across = ey;
    var steep = 0.0;
    var upper = no_rows();
    var lower = no_rows();
    var total = 0.0;
    let reach = 0.5 * max(length(ex + ey), length(ex - ey));
    var whole = false;
    if (count == 0u) { return 0.0; }
    var done = 0u;
    loop {
        // which discs' edges may cross: the costly part then runs for those alone
        let few = min(count - done, 32u);
        var crossing = 0u;
        var i = 0u;
        loop {
            let disc = textureLoad(speckles, texel(first + done + i));
            let m = p - disc.xy;
            let away = length(m);
            let gap = away - disc.z;
            whole = whole || gap <= -reach;
            let crosses = abs(gap) < reach;
            crossing |= select(0u, 1u << i, crosses);
            let slope = (abs(dot(m, ex)) - abs(dot(m, ey))) / max(away, 1e-37);
            steep += select(0.0, slope, crosses);
            i++;
            if (i >= few) { break; }
        }
        // the first 32 discs decide
        if (done == 0u && steep < 0.0) {
            along = ey;
            across = -ex;
        }
        let a = dot(along, along);
        let turn = dot(along, across);
        let tall = dot(across, across);
        if (crossing != 0u) {
            loop {
                let disc = textureLoad(speckles, texel(first + done + firstTrailingBit(crossing)));
                let r = disc.z;
                let m = p - disc.xy;
                total += large_disc_share(m, ex, ey, r);
                let start = m - 0.5 * along;
                let b = dot(start, along);
                let c = dot(start, start) - r * r;
                let slope = 2.0 * dot(start, across);
                upper = cover_rows(upper, a, b + y0 * turn, c + y0 * (slope + y0 * tall));
                lower = cover_rows(lower, a, b + y1 * turn, c + y1 * (slope + y1 * tall));
                crossing &= crossing - 1u;
                if (crossing == 0u) { break; }
            }
        }
        done += 32u;
        if (done >= count) { break; }
    }
    let twice = upper.total - union_rows(upper) + lower.total - union_rows(lower);
    let share = clamp(total - 0.125 * dot(twice, vec4f(1.0)), 0.0, 1.0);
    return select(share, 1.0, whole);
}

// How often a footprint is cut a side: `most` over the smallest disc, less where no edge of a small
// one crosses it.
fn cuts_under(first: u32, count: u32, p: vec2f, ex: vec2f, ey: vec2f, most: f32, smallest: f32) -> u32 {
    let reach = 0.5 * max(length(ex + ey), length(ex - ey));
    var n = 1.0;
    if (count == 0u) { return 1u; }
    var i = first;
    loop {
        let disc = textureLoad(speckles, texel(i));
        let crosses = abs(length(p - disc.xy) - disc.z) < reach;
        n = select(n, max(n, ceil(most * smallest / disc.z - 1e-4)), crosses);
        i++;
        if (i >= first + count) { break; }
    }
    return u32(n);
}

// Covered share of the parallelogram with centre p, from the corner of the cell whose texel is
// `cell`, and sides ex, ey, cut into pieces, at most `most` a side.
fn speckle_cover(cell: u32, p: vec2f, ex: vec2f, ey: vec2f, most: u32) -> f32 {
    let list = textureLoad(speckles, texel(cell));
    let first = u32(list.x);
    let count = u32(list.y);
    var n = most;
    if (speckle > 1u && list.z > 0.0) { n = cuts_under(first, count, p, ex, ey, f32(most), list.z); }
    let step = 1.0 / f32(n);
    var sum = 0.0;
    let pieces = n * n;
    var k = 0u;
    loop {
        // a division of integers would take many times as long
        let row = floor((f32(k) + 0.5) * step);
        let o = (vec2f(f32(k) - row * f32(n), row) + 0.5) * step - 0.5;
        let at = p + o.x * ex + o.y * ey;
        if (speckle == 2u) {
            sum += hard_cover(first, count, at, step * ex, step * ey);
        } else {
            sum += soft_cover(first, count, at, step * ex, step * ey);
        }
        k++;
        if (k >= pieces) { break; }
    }
    return sum * step * step;
}
