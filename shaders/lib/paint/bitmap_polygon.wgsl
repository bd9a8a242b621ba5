// The mean of a bitmap over what a pixel sees of a triangle that ends within it.
// The NumPy form is `mean_over_polygons` in gpusim/optics/paint/bitmap.py.
#import lib/paint/bitmap

const POLYGON: f32 = 1.2;   // texels that a triangle may span before it is cut
const CUTS: i32 = 8;        // into so many parts a side; larger polygons are weighed by their sides

// A convex polygon relative to its centroid, in texels; its corners all differ.
struct BitmapOutline {
    count: i32,
    p: array<vec2f, 8>,
}

// By the triangles of a fan, each cut into n x n equal ones.
fn bitmap_fan(bitmap: Bitmap, place: vec2f, outline: ptr<function, BitmapOutline>) -> Color {
    let level = bitmap_level(bitmap, 0);
    let first = outline.p[0];
    var sum = BitmapSum(Color(0.0), 0.0);
    for (var k = 1; k + 1 < outline.count; k++) {
        let a = outline.p[k] - first;
        let b = outline.p[k + 1] - first;
        let area = abs(a.x * b.y - a.y * b.x);
        let reach = max(max(abs(a), abs(b)), abs(a - b));
        let n = clamp(i32(ceil(max(reach.x, reach.y) / POLYGON)), 1, CUTS);
        let part = 1.0 / f32(n);
        let u = (a + b) * (part / 3.0);
        let v = (b - 2.0 * a) * (part / 3.0);
        let w = (a - 2.0 * b) * (part / 3.0);
        let square = u * u + v * v + w * w;
        let mixed = (u.x * u.y + v.x * v.y + w.x * w.y) * (1.0 / 12.0);
        var total = BitmapSum(Color(0.0), 0.0);
        // row by row: an upright triangle, then the one upside down beside it
        for (var j = 0; j < n; j++) {
            for (var i = 0; i < 2 * (n - j) - 1; i++) {
                let third = f32(1 + (i & 1)) / 3.0;
                let at = (f32(i >> 1u) + third) * a + (f32(j) + third) * b;
                let own = bitmap_piece(level, place + first + part * at, square, mixed);
                total.value += own.value;
                total.weight += own.weight;
            }
        }
        sum.value += area * part * part * total.value;
        sum.weight += area * part * part * total.weight;
    }
    return bitmap_mean(sum);
}

// As bitmap_wide, with any number of sides.
fn bitmap_wide_polygon(
    bitmap: Bitmap, place: vec2f, low: vec2f, high: vec2f, outline: ptr<function, BitmapOutline>
) -> Color {
    let w = bitmap_window(bitmap, place, low, high);
    var twice = 0.0;
    for (var k = 1; k + 1 < outline.count; k++) {
        let a = outline.p[k] - outline.p[0];
        let b = outline.p[k + 1] - outline.p[0];
        twice += a.x * b.y - a.y * b.x;
    }
    var sides: BitmapSides;
    var a = outline.p[outline.count - 1];
    for (var k = 0; k < outline.count; k++) {
        let b = outline.p[k];
        let side = b - a;
        let size = length(side) * select(-1.0, 1.0, twice > 0.0);
        if (size != 0.0) {
            let n = vec2f(-side.y, side.x) / size;
            sides.s[sides.count] = vec3f(n, -dot(n, a) * w.level.scale);
            sides.count++;
        }
        a = b;
    }
    return bitmap_inside(w, sides);
}

// Mean of the bitmap over the polygon, which lies at `place` relative to the bitmap's cell.
fn bitmap_polygon(bitmap: Bitmap, place: vec2f, outline: ptr<function, BitmapOutline>) -> Color {
    var low = outline.p[0];
    var high = outline.p[0];
    for (var k = 1; k < outline.count; k++) {
        low = min(low, outline.p[k]);
        high = max(high, outline.p[k]);
    }
    if (max(high.x - low.x, high.y - low.y) > POLYGON * f32(CUTS)) {
        return bitmap_wide_polygon(bitmap, place, low, high, outline);
    }
    return bitmap_fan(bitmap, place, outline);
}
