// Chessboards with fields larger than a pixel. Nearly all pixels lie within one field and take its
// albedo; triangles along the board's lines (gpusim/optics/paint/checker_lines.py), drawn in front of it,
// have those whose footprints reach over a line, with the closed form.
// What the pixels of a triangle share is found once, so that none of them reads a table.
#import lib/paint/feature_grid

// 0: triangles of other paints, 1: of such a board, 2: of its lines
override board: u32;

// `corner` of the lattice relative to a triangle's pattern cell, `index` its column and row.
struct Board {
    corner: vec2f,
    index: vec2f,
    squares: vec2f,
    size: f32,
    albedo: vec2f,
    covers: f32,
}

// The board of a paint that has one feature, seen from pattern cell `cell`.
fn board_of(paint: Paint, cell: vec2i) -> Board {
    let lowest = vec2i(paint.i0, paint.j0);
    let at = clamp(cell, lowest, lowest + vec2i(paint.columns, paint.rows) - 1);
    let slot = vec2u(at - lowest);
    let f = feature_at(feature_list(paint.first + slot.y * u32(paint.columns) + slot.x).x);
    let corner = vec2f(at - cell) * paint.cell + f.a.xy;
    return Board(corner, f.d.xy, f.b.zw, f.b.x, f.c.xy, f.c.w);
}

// The lattice as what the closed form takes.
fn squares_of(lattice: Board) -> Feature {
    return Feature(
        vec4f(0.0), vec4f(lattice.size, lattice.size, lattice.squares),
        vec4f(lattice.albedo, 0.0, lattice.covers), vec4f(lattice.index, 0.0, 0.0),
        color_of(lattice.albedo.x), color_of(lattice.albedo.y),
    );
}

// Mean albedo over the pixel with centre `st`, as `paint_pixel` finds it.
fn board_pixel(
    lattice: Board, ground: Color, st: vec2f, ex: vec2f, ey: vec2f, q: vec2f
) -> Color {
    let p = st - lattice.corner;
    if (board == 2u) {
        let share = checker_share(squares_of(lattice), p, ex, ey, q);
        printed += share.share * lattice.covers;
        return ground + (share.albedo - ground * share.share);
    }
    let field = floor(p / lattice.size) + lattice.index;
    let half = 0.5 * (field.x + field.y);
    let inside = all(field >= vec2f(0.0)) && all(field < lattice.squares);
    let albedo = color_of(select(lattice.albedo.y, lattice.albedo.x, half == floor(half)));
    printed += select(0.0, lattice.covers, inside);
    return select(ground, albedo, inside);
}
