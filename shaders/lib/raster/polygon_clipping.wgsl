// Convex polygons inside a pixel: clipping, moments.
// The NumPy form is gpusim/optics/geometry/polygon_clipping.py.
// Polygons are passed by pointer: a corner `p[i]` of a value costs a copy of all of them, at every
// place where one stands, in running and still more in compiling.

const MOST: i32 = 8;

struct Polygon {
    count: i32,
    p: array<vec2f, 8>,
}

// Keep the part of a polygon where d.x * x + d.y * y + d.z >= 0 (Sutherland and Hodgman 1974).
fn clip(polygon: ptr<function, Polygon>, d: vec3f) -> Polygon {
    var result: Polygon;
    result.count = 0;
    if (polygon.count == 0) { return result; }
    var a = polygon.p[polygon.count - 1];
    var da = dot(d.xy, a) + d.z;
    // tests of loops come last: see feature_grid.wgsl
    var i = 0;
    loop {
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
        i++;
        if (i >= polygon.count) { break; }
    }
    return result;
}

// Signed area and centroid: (area, x, y), of three corners or more.
fn moments(polygon: ptr<function, Polygon>) -> vec3f {
    var sum = vec3f(0.0);
    let o = polygon.p[0];
    var i = 1;
    loop {
        let a = polygon.p[i] - o;
        let b = polygon.p[i + 1] - o;
        let twice = a.x * b.y - a.y * b.x;
        sum += twice * vec3f(3.0, a + b);
        i++;
        if (i + 1 >= polygon.count) { break; }
    }
    let area = sum.x / 6.0;
    if (sum.x == 0.0) { return vec3f(0.0, o); }
    return vec3f(area, o + sum.yz / sum.x);
}

// Sides of the rectangle with a shape's second moments, as columns; m is its area and centroid, its
// spread as `spread_of` has it. The first side is the one nearer to the rows.
fn rectangle_of(m: vec3f, spread: vec3f) -> mat2x2f {
    let squares = max(spread / m.x, vec3f(0.0, -1e30, 0.0));
    let middle = 0.5 * (squares.x + squares.z);
    let off = vec2f(0.5 * (squares.x - squares.z), squares.y);
    let most = length(off);
    // what is nearly as long as it is wide keeps to rows and columns
    let turned = most > 1e-3 * middle;
    let angle = select(0.0, 0.5 * atan2(off.y, off.x), turned);
    let axis = vec2f(cos(angle), sin(angle));
    let long = sqrt(middle + select(0.0, most, turned)) * axis;
    let short = sqrt(max(middle - select(0.0, most, turned), 0.0)) * vec2f(-axis.y, axis.x);
    if (abs(axis.x) >= abs(axis.y)) { return mat2x2f(long, short); }
    return mat2x2f(-short, long) * sign(axis.y);
}

// What an area at a place adds to the spread about the origin: twelve times x x, x y and y y.
fn spread_at(m: vec3f) -> vec3f {
    return 12.0 * m.x * vec3f(m.y * m.y, m.y * m.z, m.z * m.z);
}

// Twelve times the integrals of x x, x y and y y over a polygon of area and centroid m, about that.
fn spread_of(polygon: ptr<function, Polygon>, m: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var a = polygon.p[polygon.count - 1] - m.yz;
    var i = 0;
    loop {
        let b = polygon.p[i] - m.yz;
        let both = vec3f(a.x * b.x, 0.5 * (a.x * b.y + a.y * b.x), a.y * b.y);
        let own = vec3f(a.x * a.x + b.x * b.x, a.x * a.y + b.x * b.y, a.y * a.y + b.y * b.y);
        sum += (a.x * b.y - a.y * b.x) * (own + both);
        a = b;
        i++;
        if (i >= polygon.count) { break; }
    }
    return sum;
}
