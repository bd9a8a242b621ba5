// The same as polygon_speckle where polygons may be large on the paint.
// The NumPy form is `polygon_cover` in gpusim/optics/paint/disc_coverage.py.
#import lib/paint/anisotropic_footprint
#import lib/raster/polygon_clipping
#import lib/paint/polygon_discs
#import lib/light/surface

const LONGEST_SOFT_ROW: f32 = 4.0;
const LONGEST_HARD_ROW: f32 = 8.0;

// Pieces of a row of a length.
fn row_pieces(cells: SpeckleCells, length: f32) -> f32 {
    let side = cells.piece * select(2.0, 1.0, cells.soft);
    let most = select(LONGEST_HARD_ROW, LONGEST_SOFT_ROW, cells.soft);
    return clamp(ceil(min(length / side, 1e6) - 1e-4), 1.0, most);
}

// Share of a polygon (px from the pixel's centre, at offset d from the anchor) that speckle covers:
// rows in pieces, each with the list of its own cell.
fn polygon_grazing(
    t: Triangle, d: vec2f, polygon: ptr<function, Polygon>, cells: SpeckleCells, hard_rows: u32
) -> f32 {
    var sum = 0.0;
    var whole = 0.0;
    let origin = paint_position(t, d + polygon.p[0]);
    for (var k = 1; k + 1 < polygon.count; k++) {
        let a = polygon.p[k] - polygon.p[0];
        let b = polygon.p[k + 1] - polygon.p[0];
        let area = a.x * b.y - a.y * b.x;
        if (area == 0.0) { continue; }
        let far = max(length(paint_position(t, d + polygon.p[k]) - origin),
            length(paint_position(t, d + polygon.p[k + 1]) - origin));
        var steps = hard_rows;
        if (cells.soft) { steps = 3u * u32(row_pieces(cells, far)); }
        for (var j = 0u; j < steps; j++) {
            let row = row_step(j, steps, cells.soft);
            let p0 = d + polygon.p[0] + row.x * a;
            let p1 = d + polygon.p[0] + row.x * b;
            let covered = grazing_row(t, p0, p1, cells);
            sum += area * 2.0 * row.x * row.y * covered;
        }
        whole += area;
    }
    if (whole == 0.0) { return cells.coverage; }
    return clamp(sum / whole, 0.0, 1.0);
}

// Covered share of the row from p0 to p1, px from the anchor.
fn grazing_row(t: Triangle, p0: vec2f, p1: vec2f, cells: SpeckleCells) -> f32 {
    let extent = length(paint_position(t, p1) - paint_position(t, p0));
    let count = row_pieces(cells, extent);
    let shrink = min(1.0, 2.0 * cells.longest * count / max(extent, 1e-37));
    let half = shrink * select(0.5, GAUSS, cells.soft);
    var sum = 0.0;
    for (var i = 0.0; i < count; i += 1.0) {
        let u = (i + 0.5 + half * vec3f(-1.0, 0.0, 1.0)) / count;
        let middle = paint_position(t, mix(p0, p1, u.y));
        let found = found_at(cells, t.place.zw, middle);
        let start = found.local + paint_position(t, mix(p0, p1, u.x)) - middle;
        let end = found.local + paint_position(t, mix(p0, p1, u.z)) - middle;
        let last = found.first + found.count;
        var covered = cells.coverage;
        if (found.first > 0u && speckle != 2u && cells.soft) {
            var open = vec3f(1.0);
            for (var n = found.first; n < last; n++) {
                let disc = textureLoad(speckles, texel(n));
                let m0 = start - disc.xy;
                let m1 = found.local - disc.xy;
                let m2 = end - disc.xy;
                let square = vec3f(dot(m0, m0), dot(m1, m1), dot(m2, m2));
                open *= leaves((disc.z * disc.z - square) * disc.w);
            }
            covered = 1.0 - dot(open, vec3f(END, MIDDLE, END));
        }
        if (found.first > 0u && speckle != 1u && !cells.soft) {
            let along = end - start;
            var rows = no_rows();
            for (var n = found.first; n < last; n++) {
                let disc = textureLoad(speckles, texel(n));
                let m = start - disc.xy;
                rows = cover_rows(rows, dot(along, along), vec4f(dot(m, along)),
                    vec4f(dot(m, m) - disc.z * disc.z));
            }
            covered = union_rows(rows).x;
        }
        sum += covered;
    }
    return sum / count;
}
