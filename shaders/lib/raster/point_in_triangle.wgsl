// Which of a box's pixels have their centres in a triangle, one after another, row by row.
#import lib/raster/pixel_box

// The edges' functions, the areas opposite to r, p and q, at a pixel: how they change to the next one of
// a row and from a row's last to the next row, and what all have to be above. `area`: twice the
// triangle's; `turned`: its second and third corner are the other way round.
struct Inside {
    here: vec3i,
    right: vec3i,
    next: vec3i,
    limits: vec3i,
    area: i32,
    turned: bool,
}

// Twice the area of (0, a, b): above 0 where b is on the inner side of the edge along a.
fn cross_of(a: vec2i, b: vec2i) -> i32 {
    return a.x * b.y - a.y * b.x;
}

// What the edge function has to be above: an edge's own points are inside where it is a left or an
// upper one.
fn limit(edge: vec2i) -> i32 {
    return select(0, -1, edge.y < 0 || (edge.y == 0 && edge.x > 0));
}

// From the first pixel of the box on.
fn inside_of(at: Places, box: Box) -> Inside {
    // from there on numbers are small
    let p = at.p - (box.low << vec2u(8u));
    var q = at.q - (box.low << vec2u(8u));
    var r = at.r - (box.low << vec2u(8u));
    let area = cross_of(q - p, r - p);
    if (area < 0) {
        let other = q;
        q = r;
        r = other;
    }
    let limits = vec3i(limit(q - p), limit(r - q), limit(p - r));
    let here = vec3i(cross_of(q - p, -p), cross_of(r - q, -q), cross_of(p - r, -r));
    let right = 256 * vec3i(p.y - q.y, q.y - r.y, r.y - p.y);
    let down = 256 * vec3i(q.x - p.x, r.x - q.x, p.x - r.x);
    return Inside(here, right, down - box.size.x * right, limits, abs(area), area < 0);
}
