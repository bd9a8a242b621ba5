// Speckle under footprints that may be large, as where a surface is seen at a grazing angle.
// The NumPy form is `grazing_cover` in gpusim/optics/paint/disc_coverage.py.
#import lib/paint/disc_coverage
#import lib/numeric/texel

// whether there are such
override grazing: u32;

const MOST_PIECES: f32 = 144.0;
const MOST_SIDE: f32 = 12.0;

// A region's cells (as in Paint), usual and longest sides of pieces, and the mean coverage.
struct SpeckleCells {
    cell: f32,
    lowest: vec2i,
    size: vec2i,
    first: u32,
    soft: bool,
    piece: f32,
    longest: f32,
    coverage: f32,
}

// The list of a place's cell, and the place relative to it; no list (first of 0) beyond the cells.
struct Found {
    first: u32,
    count: u32,
    local: vec2f,
}
fn found_at(cells: SpeckleCells, cell: vec2i, place: vec2f) -> Found {
    let k = floor(place / cells.cell);
    let at = cell + vec2i(k) - cells.lowest;
    if (at.x < 0 || at.y < 0 || at.x >= cells.size.x || at.y >= cells.size.y) {
        return Found(0u, 0u, place);
    }
    let slot = cells.first + u32(at.y * cells.size.x + at.x);
    let list = textureLoad(speckles, texel(slot));
    return Found(u32(list.x), u32(list.y), place - k * cells.cell);
}

// Covered share of the pixel with centre `place` (relative to cell `cell`), change ex, ey per
// column and row, and relative change q of 1 / z: in pieces that are equal in the image, each with
// the list of its own cell. A footprint that would take too many gets the mean.
fn grazing_cover(
    cells: SpeckleCells, cell: vec2i, place: vec2f, ex: vec2f, ey: vec2f, q: vec2f
) -> f32 {
    let sides = vec2f(length(ex), length(ey));
    let wanted = max(ceil(min(sides / cells.piece, vec2f(1e6)) - 1e-4), vec2f(1.0));
    let short = min(min(wanted.x, wanted.y), MOST_SIDE);
    let long = min(max(wanted.x, wanted.y), floor(MOST_PIECES / short));
    let n = select(vec2f(short, long), vec2f(long, short), wanted.x >= wanted.y);
    let size = sides / n;
    if (max(size.x, size.y) > cells.longest) { return cells.coverage; }
    let total = u32(n.x) * u32(n.y);
    var sum = 0.0;
    var k = 0u;
    loop {
        let row = floor((f32(k) + 0.5) / n.x);
        let o = (vec2f(f32(k) - row * n.x, row) + 0.5) / n - 0.5;
        let w = 1.0 / (1.0 + dot(q, o));
        let move_by = (o.x * ex + o.y * ey) * w;
        let x = (w / n.x) * (ex - move_by * q.x);
        let y = (w / n.y) * (ey - move_by * q.y);
        let found = found_at(cells, cell, place + move_by);
        var covered = cells.coverage;
        if (speckle == 2u || (speckle == 3u && !cells.soft)) {
            let hard = hard_cover(found.first, found.count, found.local, x, y);
            covered = select(covered, hard, found.first > 0u);
        } else {
            let soft = soft_cover(found.first, found.count, found.local, x, y);
            covered = select(covered, soft, found.first > 0u);
        }
        sum += covered;
        k++;
        if (k >= total) { break; }
    }
    return sum / f32(total);
}
