// Convex polygons inside a pixel: clipping, moments, sample masks.
// The NumPy form is in gpusim/optics/edges.py.

const MOST: i32 = 8;

struct Polygon {
    count: i32,
    p: array<vec2f, 8>,
}

// Keep the part of a polygon where d.x * x + d.y * y + d.z >= 0 (Sutherland and Hodgman 1974).
fn clip(polygon: Polygon, d: vec3f) -> Polygon {
    var result: Polygon;
    result.count = 0;
    if (polygon.count == 0) { return result; }
    var a = polygon.p[polygon.count - 1];
    var da = dot(d.xy, a) + d.z;
    for (var i = 0; i < polygon.count; i++) {
        let b = polygon.p[i];
        let db = dot(d.xy, b) + d.z;
        if ((da < 0.0) != (db < 0.0) && result.count < MOST) {
            result.p[result.count] = a + (da / (da - db)) * (b - a);
            result.count++;
        }
        if (db >= 0.0 && result.count < MOST) {
            result.p[result.count] = b;
            result.count++;
        }
        a = b;
        da = db;
    }
    return result;
}

// Signed area and centroid: (area, x, y).
fn moments(polygon: Polygon) -> vec3f {
    var sum = vec3f(0.0);
    let o = polygon.p[0];
    for (var i = 1; i + 1 < polygon.count; i++) {
        let a = polygon.p[i] - o;
        let b = polygon.p[i + 1] - o;
        let twice = a.x * b.y - a.y * b.x;
        sum += twice * vec3f(3.0, a + b);
    }
    let area = sum.x / 6.0;
    if (sum.x == 0.0) { return vec3f(0.0, o); }
    return vec3f(area, o + sum.yz / sum.x);
}

// Samples (bits, 32 a row) of a row of the mask inside three half planes.
// Sample k of row r sits at x = (k + shift(r)) / 32 - 1/2, y = (r + 1/2) / 16 - 1/2.
fn mask_row(r: i32, d0: vec3f, d1: vec3f, d2: vec3f) -> u32 {
    let y = (f32(r) + 0.5) / 16.0 - 0.5;
    let shift = (f32((r * 7) % 16) + 0.5) / 16.0;
    var low = -1.0;
    var high = 1.0;
    var some = true;
    for (var k = 0; k < 3; k++) {
        let d = select(select(d2, d1, k == 1), d0, k == 0);
        let c = d.y * y + d.z;
        if (d.x > 0.0) { low = max(low, -c / d.x); }
        else if (d.x < 0.0) { high = min(high, -c / d.x); }
        else if (c < 0.0) { some = false; }
    }
    if (!some || !(low < high)) { return 0u; }
    let first = i32(clamp(ceil((low + 0.5) * 32.0 - shift), 0.0, 32.0));
    let last = i32(clamp(ceil((high + 0.5) * 32.0 - shift), 0.0, 32.0));
    return below(last) & ~below(first);
}

fn below(k: i32) -> u32 {
    if (k >= 32) { return 0xffffffffu; }
    return (1u << u32(k)) - 1u;
}
