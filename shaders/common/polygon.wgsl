// Convex polygons inside a pixel: clipping, moments.
// The NumPy form is gpusim/optics/polygon.py.

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
