// The mean of a paint over what a pixel sees of a triangle that ends within it. The NumPy form is
// gpusim/optics/paint/footprint_mean.py; `range` belongs to the stage that imports this.
#import lib/paint/bitmap_polygon
#import lib/paint/feature_grid
#import lib/raster/polygon_clipping
#import lib/paint/polygon_footprint
#import lib/paint/polygon_discs
#import lib/light/surface

override patterned: u32;

// A polygon on the paint and 1 / z at its corners, relative to that at its centroid.
struct Outline {
    polygon: Polygon,
    w: array<f32, 8>,
}

// Share of a polygon's image right of and above the point o. Scaled by 1 / z relative to o, the
// polygon is an affine picture of what is seen, whatever the perspective.
fn quadrant_share(outline: ptr<function, Outline>, o: vec2f) -> f32 {
    let last = outline.polygon.count - 1;
    let c = (outline.polygon.p[0] - o) * outline.w[0];
    var area = 0.0;
    var sum = 0.0;
    var a = (outline.polygon.p[last] - o) * outline.w[last] - c;
    var i = 0;
    loop {
        let b = (outline.polygon.p[i] - o) * outline.w[i] - c;
        area += 0.5 * (a.x * b.y - a.y * b.x);
        sum += quadrant_edge(a + c, b + c);
        a = b;
        i++;
        if (i > last) { break; }
    }
    if (area == 0.0) { return 0.0; }
    return clamp(sum / area, 0.0, 1.0);
}

// A checker patch over a polygon (patch axes): corner by corner where it spans several squares.
fn polygon_checker(feature: Feature, shape: ptr<function, Outline>) -> Squares {
    var f = feature;
    var outline = *shape;
    let count = outline.polygon.count;
    var low = outline.polygon.p[0];
    var high = outline.polygon.p[0];
    for (var i = 1; i < count; i++) {
        low = min(low, outline.polygon.p[i]);
        high = max(high, outline.polygon.p[i]);
    }
    let spans = (high - low) / f.b.xy;
    if (max(spans.x, spans.y) > f32(FINEST)) {
        let m = as_one_square(f, vec2f(0.0));
        for (var i = 0; i < count; i++) { outline.polygon.p[i] += m.p; }
        low += m.p;
        high += m.p;
        f = m.f;
    }
    let first = max(floor(low / f.b.xy), -f.d.xy);
    let last = min(floor(high / f.b.xy), f.b.zw - f.d.xy - 1.0);
    var sum = Squares(Color(0.0), 0.0);
    if (any(last < first)) { return sum; }
    var j = first.y;
    loop {
        var i = first.x;
        loop {
            // the square is the signed sum of the quadrants at its corners
            var share = 0.0;
            var c = 0u;
            loop {
                let at = vec2f(f32(c & 1u), f32(c >> 1u));
                let sign = select(-1.0, 1.0, at.x == at.y);
                share += sign * quadrant_share(&outline, (vec2f(i, j) + at) * f.b.xy);
                c++;
                if (c >= range.corners) { break; }
            }
            share = max(share, 0.0);
            let k = i + j + f.d.x + f.d.y;
            sum.albedo += share * select(f.odd, f.even, k - 2.0 * floor(0.5 * k) == 0.0);
            sum.share += share;
            i += 1.0;
            if (!(i <= last.x)) { break; }
        }
        j += 1.0;
        if (!(j <= last.y)) { break; }
    }
    return sum;
}

fn polygon_disc(f: Feature, outline: ptr<function, Outline>) -> f32 {
    let r = f.a.z;
    var centre = vec2f(0.0);
    for (var i = 0; i < outline.polygon.count; i++) { centre += outline.polygon.p[i]; }
    centre /= f32(outline.polygon.count);
    var reach = 0.0;
    for (var i = 0; i < outline.polygon.count; i++) { reach = max(reach, distance(outline.polygon.p[i], centre)); }
    let dist = length(centre);
    if (dist >= r + reach) { return 0.0; }
    if (dist <= r - reach) { return 1.0; }
    let n = centre / max(dist, 1e-30);
    let large = discs == 2u || r > 3.0 * reach;
    var area = 0.0;
    var sum = 0.0;
    var a = outline.polygon.p[outline.polygon.count - 1];
    var i = 0;
    loop {
        let b = outline.polygon.p[i];
        let u = a - centre;
        let v = b - centre;
        area += 0.5 * (u.x * v.y - u.y * v.x);
        if (large) {
            let p = vec2f(n.y * u.x - n.x * u.y, dot(n, u));
            let q = vec2f(n.y * v.x - n.x * v.y, dot(n, v));
            sum += large_disc_edge(p, q, r, r - dist);
        } else {
            sum += small_disc_edge(a, b, r);
        }
        a = b;
        i++;
        if (i >= outline.polygon.count) { break; }
    }
    if (area == 0.0) { return 0.0; }
    return clamp(sum / area, 0.0, 1.0);
}

fn polygon_sector(f: Feature, outline: ptr<function, Outline>) -> f32 {
    let inside = polygon_disc(f, outline);
    let l = vec2f(-f.b.y, f.b.x);
    let m = vec2f(f.b.w, -f.b.z);
    let last = outline.polygon.count - 1;
    let c = outline.polygon.p[0] * outline.w[0];
    var areas = vec2f(0.0);   // seen straight, and on the paint
    var sides = vec2f(0.0);
    var swept = 0.0;
    var p = outline.polygon.p[last];
    var a = p * outline.w[last];
    var i = 0;
    loop {
        let q = outline.polygon.p[i];
        let b = q * outline.w[i];
        let u = a - c;
        let v = b - c;
        let s = p - outline.polygon.p[0];
        let t = q - outline.polygon.p[0];
        areas += 0.5 * vec2f(u.x * v.y - u.y * v.x, s.x * t.y - s.y * t.x);
        let step = b - a;
        sides += vec2f(relu_mean(dot(a, l), dot(b, l)) * (step.y * l.x - step.x * l.y),
            relu_mean(dot(a, m), dot(b, m)) * (step.y * m.x - step.x * m.y));
        swept += sector_edge(p, q, l, m, f.a.z);
        p = q;
        a = b;
        i++;
        if (i > last) { break; }
    }
    if (areas.x == 0.0 || areas.y == 0.0) { return 0.0; }
    let share = vec3f(inside, clamp(sides / areas.x, vec2f(0.0), vec2f(1.0)));
    let product = share.x * share.y * share.z;
    let partly = select(vec3f(0.0), vec3f(1.0), share < vec3f(1.0 - 1e-6));
    if (product <= 0.0 || partly.x + partly.y + partly.z <= 1.0) { return product; }
    return clamp(swept / areas.y, 0.0, 1.0);
}

// The same where the paint is a bitmap: its mean, and the exact share that lies on it.
fn paint_bitmap(t: Triangle, paint: Paint, d: vec2f, polygon: ptr<function, Polygon>, centroid: vec2f) -> Color {
    let place = paint_position(t, d + centroid);
    let middle = 1.0 / weight(t, d + centroid);
    var local: Outline;
    var outline: BitmapOutline;
    local.polygon.count = polygon.count;
    outline.count = polygon.count;
    for (var j = 0; j < polygon.count; j++) {
        let at = d + polygon.p[j];
        local.polygon.p[j] = paint_position(t, at) - place;
        local.w[j] = weight(t, at) * middle;
        outline.p[j] = local.polygon.p[j];
    }
    let size = vec2i(paint.columns, paint.rows);
    var share = 0.0;
    var c = 0u;
    loop {
        let corner = vec2i(i32(c & 1u), i32(c >> 1u));
        let sign = select(-1.0, 1.0, corner.x == corner.y);
        share += sign * quadrant_share(&local, vec2f(corner * size - t.place.zw) - place);
        c++;
        if (c >= range.corners) { break; }
    }
    let bitmap = Bitmap(t.place.zw, size, paint.first, paint.i0);
    let value = bitmap_polygon(bitmap, place, &outline);
    let ground = color_of(paint.ground);
    return ground + (albedo_of(value) - ground) * clamp(share, 0.0, 1.0);
}

// Mean albedo over a polygon given in pixels relative to the pixel's centre, which lies at
// offset d from the triangle's anchor; `centroid` decides the pattern cell.
fn paint_polygon(t: Triangle, d: vec2f, polygon: ptr<function, Polygon>, centroid: vec2f) -> Color {
    if (patterned == 0u || t.more.y == 0.0) { return ground_of(t); }
    let paint = paint_at(u32(t.ny.w));
    if (bitmaps != 0u && paint.featured == BITMAP) {
        return paint_bitmap(t, paint, d, polygon, centroid);
    }
    let ground = color_of(paint.ground);
    if (grazing != 0u && paint.piece > 0.0) {
        let covered = polygon_grazing(t, d, polygon, cells_of(paint), range.hard_rows);
        return mix(ground, color_of(paint.dot), covered);
    }
    let st = paint_position(t, d + centroid);
    let k = floor(st / paint.cell);
    let at = t.place.zw + vec2i(k) - vec2i(paint.i0, paint.j0);
    if (at.x < 0 || at.y < 0 || at.x >= paint.columns || at.y >= paint.rows) {
        return ground;
    }
    let slot = paint.first + u32(at.y * paint.columns + at.x);
    if (speckle != 0u && paint.featured > 1u) {
        let corner = vec2f(k) * paint.cell;
        let covered = polygon_speckle(t, d, polygon, slot, corner, paint.cuts, paint.featured,
            range.hard_rows);
        return mix(ground, color_of(paint.dot), covered);
    }
    var albedo = ground;
    let list = feature_list(slot);
    if (list.y == 0u) { return albedo; }
    var i = 0u;
    loop {
        let f = feature_at(list.x + 4u * i);
        var local: Outline;
        local.polygon.count = polygon.count;
        let middle = 1.0 / weight(t, d + centroid);
        for (var j = 0; j < polygon.count; j++) {
            let at = d + polygon.p[j];
            local.polygon.p[j] = paint_position(t, at) - k * paint.cell - f.a.xy;
            local.w[j] = weight(t, at) * middle;
        }
        if (checkers != 0u && f.c.z == 0.0) {
            let turn = mat2x2f(f.a.z, -f.a.w, f.a.w, f.a.z);
            for (var j = 0; j < polygon.count; j++) { local.polygon.p[j] = turn * local.polygon.p[j]; }
            let s = polygon_checker(f, &local);
            albedo += s.albedo - ground * s.share;
            printed += s.share * f.c.w;
        }
        if (discs != 0u && f.c.z == 1.0) {
            let share = polygon_disc(f, &local);
            albedo += (f.even - ground) * share;
            printed += share * f.c.w;
        }
        if (sectors != 0u && f.c.z == 2.0) {
            let share = polygon_sector(f, &local);
            albedo += (f.even - ground) * share;
            printed += share * f.c.w;
        }
        i++;
        if (i >= list.y) { break; }
    }
    return albedo;
}
