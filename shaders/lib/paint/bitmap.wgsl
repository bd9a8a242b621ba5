// The mean of a bitmap's quintic B-spline surface over what a pixel sees of it.
// The NumPy form is gpusim/optics/paint/bitmap.py, which also says how the coefficients are laid out.
#import lib/light/color
#import lib/paint/area_integrals
#import lib/numeric/texel

@group(0) @binding(20) var bitmap_texels: texture_2d<f32>;

// 0 no bitmaps, 1 none that is much smaller than the pixels, 2 any
override bitmaps: u32;

const BITMAP: u32 = 4u;          // Paint.featured of a bitmap
const BITMAP_MARGIN: i32 = 8;    // coefficients beyond each side of a level
const WIDEST: f32 = 2.9;         // cells of a level that one piece of a footprint may span
const NARROWEST: f32 = 0.03125;
const TURNED: f32 = 0.1;
const PIECES: f32 = 16.0;
const TINY: f32 = 1e-6;          // smallest weight of a mean
const WINDOW: f32 = 32.0;        // cells that a footprint may span before a coarser level is taken

// A bitmap seen from the texel `cell` that positions are relative to.
struct Bitmap {
    cell: vec2i,
    size: vec2i,
    header: u32,
    last: i32,
}

// One level of it: the texel where it starts, texels a row, its own cell and size, and what
// positions in texels are multiplied by once `shift` is added.
struct BitmapLevel {
    start: i32,
    stride: i32,
    cell: vec2i,
    size: vec2i,
    shift: vec2f,
    scale: f32,
    // texels from the coefficients of one band to those of the next
    plane: i32,
}

// A sum over coefficients, and the weight of them all.
struct BitmapSum {
    value: Color,
    weight: f32,
}
fn bitmap_mean(sum: BitmapSum) -> Color { return sum.value / max(sum.weight, TINY); }
// A mean as the albedo that is seen: where the spline swings over, it is black or white.
fn albedo_of(mean: Color) -> Color { return clamp(mean, Color(0.0), Color(1.0)); }

fn bitmap_level(bitmap: Bitmap, number: i32) -> BitmapLevel {
    let k = u32(number);
    let head = textureLoad(bitmap_texels, texel(bitmap.header + k), 0);
    let cell = vec2i(bitmap.cell.x >> k, bitmap.cell.y >> k);
    let shift = bitmap.cell - vec2i(cell.x << k, cell.y << k);
    let round_up = vec2i((1 << k) - 1);
    let size = vec2i((bitmap.size.x + round_up.x) >> k, (bitmap.size.y + round_up.y) >> k);
    return BitmapLevel(i32(head.x) * 4096, i32(head.y), cell, size, vec2f(shift),
        1.0 / f32(1 << k), i32(head.z));
}

// A position relative to the coefficients, kept near the bitmap.
fn on_level(level: BitmapLevel, place: vec2f) -> vec2f {
    let p = (place + level.shift) * level.scale;
    return clamp(p, vec2f(-level.cell) - 1.0, vec2f(level.size - level.cell) + 1.0) - 0.5;
}

// Integral of the quintic B-spline from -3 to y, and the spline itself.
fn spline_integral(y: vec4f) -> vec4f {
    let z = 3.0 - min(abs(y), vec4f(3.0));
    let a = max(z - 1.0, vec4f(0.0));
    let b = max(z - 2.0, vec4f(0.0));
    let z2 = z * z;
    let a2 = a * a;
    let b2 = b * b;
    let tail = (z2 * z2 * z2 - 6.0 * a2 * a2 * a2 + 15.0 * b2 * b2 * b2) * (1.0 / 720.0);
    return select(tail, 1.0 - tail, y > vec4f(0.0));
}
fn spline(y: vec4f) -> vec4f {
    let z = 3.0 - min(abs(y), vec4f(3.0));
    let a = max(z - 1.0, vec4f(0.0));
    let b = max(z - 2.0, vec4f(0.0));
    let z2 = z * z;
    let a2 = a * a;
    let b2 = b * b;
    return (z2 * z2 * z - 6.0 * a2 * a2 * a + 15.0 * b2 * b2 * b) * (1.0 / 120.0);
}

// Integral and area over what lies on the bitmap of a piece of area 1 at `place`; `square`: twelve
// times its variances, `mixed`: its covariance.
fn bitmap_piece(level: BitmapLevel, place: vec2f, square: vec2f, mixed: f32) -> BitmapSum {
    let p = on_level(level, place);
    let width = clamp(sqrt(square), vec2f(NARROWEST), vec2f(WIDEST));
    let border_low = vec2f(-level.cell) - 0.5;
    let border_high = vec2f(level.size - level.cell) - 0.5;
    // what only just misses the border takes the bitmap's value there
    let low = clamp(p - 0.5 * width, border_low, border_high - NARROWEST);
    let high = clamp(p + 0.5 * width, border_low + NARROWEST, border_high);
    let first = vec2i(floor(low)) - 2;
    let last = i32(floor(high.y)) + 3;
    // the coefficients lie four to a texel: three texels hold all that the piece needs of a row
    let block = (first.x + level.cell.x + BITMAP_MARGIN) >> 2u;
    let x0 = vec4f(0.0, 1.0, 2.0, 3.0) + f32((block << 2u) - BITMAP_MARGIN - level.cell.x);
    let x1 = x0 + 4.0;
    let x2 = x0 + 8.0;
    let across = 1.0 / width;
    let a0 = (spline_integral(high.x - x0) - spline_integral(low.x - x0)) * across.x;
    let a1 = (spline_integral(high.x - x1) - spline_integral(low.x - x1)) * across.x;
    let a2 = (spline_integral(high.x - x2) - spline_integral(low.x - x2)) * across.x;
    let s0 = (spline(high.x - x0) - spline(low.x - x0)) * across.x;
    let s1 = (spline(high.x - x1) - spline(low.x - x1)) * across.x;
    let s2 = (spline(high.x - x2) - spline(low.x - x2)) * across.x;
    var at = level.start + (first.y + level.cell.y + BITMAP_MARGIN) * level.stride + block;
    var sum = Color(0.0);
    var j = first.y;
    loop {
        let c0 = coefficients_at(bitmap_texels, at, level.plane);
        let c1 = coefficients_at(bitmap_texels, at + 1, level.plane);
        let c2 = coefficients_at(bitmap_texels, at + 2, level.plane);
        let y = vec4f(high.y, low.y, 9.0, 9.0) - f32(j);
        let total = spline_integral(y);
        let value = spline(y);
        sum += (total.x - total.y) * across.y * (weighed(a0, c0) + weighed(a1, c1) + weighed(a2, c2))
            + mixed * (value.x - value.y) * across.y * (weighed(s0, c0) + weighed(s1, c1) + weighed(s2, c2));
        at += level.stride;
        j++;
        if (j > last) { break; }
    }
    let inside = (high - low) * across;
    return BitmapSum(sum, inside.x * inside.y);
}

// Squared sine of twice the angle between a vector and the nearest axis.
fn turned(e: vec2f) -> f32 {
    let square = dot(e, e);
    let sine = 2.0 * e.x * e.y / select(1.0, square, square > 0.0);
    return sine * sine;
}

// The coefficients that a footprint reaches, on a level that makes them few enough.
struct BitmapWindow {
    level: BitmapLevel,
    p: vec2f,
    first: vec2i,
    last: vec2i,
}

fn bitmap_window(bitmap: Bitmap, place: vec2f, low: vec2f, high: vec2f) -> BitmapWindow {
    let extent = max(high.x - low.x, high.y - low.y);
    let number = clamp(i32(ceil(log2(max(extent / WINDOW, 1e-9)))), 0, bitmap.last);
    let level = bitmap_level(bitmap, number);
    let p = on_level(level, place);
    let first = max(vec2i(floor(p + low * level.scale)) - 2, -level.cell - BITMAP_MARGIN);
    let last = min(vec2i(floor(p + high * level.scale)) + 3,
        level.size + BITMAP_MARGIN - 1 - level.cell);
    return BitmapWindow(level, p, first, last);
}

// What the bitmap's own borders leave of the coefficients of a row, and of four in a row; none of
// those beyond the window.
fn bitmap_border(w: BitmapWindow, y: f32) -> f32 {
    let low = f32(-w.level.cell.y) - 0.5;
    let high = f32(w.level.size.y - w.level.cell.y) - 0.5;
    let part = spline_integral(vec4f(y - low, high - y, 9.0, 9.0));
    return part.x * part.y;
}
fn bitmap_across(w: BitmapWindow, x: vec4f) -> vec4f {
    let low = f32(-w.level.cell.x) - 0.5;
    let high = f32(w.level.size.x - w.level.cell.x) - 0.5;
    let part = spline_integral(x - low) * spline_integral(high - x);
    let own = (x >= vec4f(f32(w.first.x))) & (x <= vec4f(f32(w.last.x)));
    return select(vec4f(0.0), part, own);
}

// The sides of a convex shape that spans many texels: each s.x * x + s.y * y + s.z is the distance
// inwards in texels of the level, from where the window's place is.
struct BitmapSides {
    count: i32,
    s: array<vec3f, 8>,
}

// Mean over such a shape: a coefficient's weight is the product over the sides of the spline's
// integral up to the side.
fn bitmap_inside(w: BitmapWindow, sides: BitmapSides) -> Color {
    let start = (w.first.x + w.level.cell.x + BITMAP_MARGIN) >> 2u;
    let stop = (w.last.x + w.level.cell.x + BITMAP_MARGIN) >> 2u;
    var sum = BitmapSum(Color(0.0), 0.0);
    for (var j = w.first.y; j <= w.last.y; j++) {
        let row = w.level.start + (j + w.level.cell.y + BITMAP_MARGIN) * w.level.stride;
        let y = f32(j) - w.p.y;
        let inside = bitmap_border(w, f32(j));
        for (var block = start; block <= stop; block++) {
            let c = coefficients_at(bitmap_texels, row + block, w.level.plane);
            let i = vec4f(0.0, 1.0, 2.0, 3.0) + f32((block << 2u) - BITMAP_MARGIN - w.level.cell.x);
            let x = i - w.p.x;
            var weight = inside * bitmap_across(w, i);
            for (var k = 0; k < sides.count; k++) {
                let s = sides.s[k];
                weight *= spline_integral(s.x * x + (s.y * y + s.z));
            }
            sum.value += weighed(weight, c);
            sum.weight += dot(weight, vec4f(1.0));
        }
    }
    return bitmap_mean(sum);
}

// The same over a parallelogram.
fn bitmap_wide(bitmap: Bitmap, place: vec2f, ex: vec2f, ey: vec2f) -> Color {
    let reach = 0.5 * (abs(ex) + abs(ey));
    let w = bitmap_window(bitmap, place, -reach, reach);
    let area = abs(ex.x * ey.y - ex.y * ey.x) * w.level.scale;
    let nx = vec2f(-ex.y, ex.x) / length(ex);
    let ny = vec2f(-ey.y, ey.x) / length(ey);
    // half the distance between opposite sides
    let gap = 0.5 * area / vec2f(length(ex), length(ey));
    var sides: BitmapSides;
    sides.count = 4;
    sides.s[0] = vec3f(-nx, gap.x);
    sides.s[1] = vec3f(nx, gap.x);
    sides.s[2] = vec3f(-ny, gap.y);
    sides.s[3] = vec3f(ny, gap.y);
    return bitmap_inside(w, sides);
}

// Mean albedo over the pixel with centre `place` (relative to the bitmap's cell), change ex, ey
// per column and row, and relative change q of 1 / z; `ground` beyond the bitmap.
fn bitmap_pixel(
    bitmap: Bitmap, ground: Color, place: vec2f, ex: vec2f, ey: vec2f, q: vec2f
) -> Color {
    let turn = max(max(turned(ex), turned(ey)), 1e-8);
    let width = min(WIDEST, sqrt(sqrt(TURNED / turn)));
    let count = max(ceil(min(vec2f(length(ex), length(ey)) / width, vec2f(1e6))), vec2f(1.0));
    let few = count.x * count.y <= PIECES;
    var value = Color(0.0);
    var sum = BitmapSum(Color(0.0), 0.0);
    if (bitmaps == 1u || few) {
        let level = bitmap_level(bitmap, 0);
        let n = vec2i(count);
        let step = 1.0 / count;
        // the test comes last: see feature_grid.wgsl
        var k = 0;
        loop {
            let row = floor((f32(k) + 0.5) * step.x);
            let o = (vec2f(f32(k) - row * count.x, row) + 0.5) * step - 0.5;
            let w = 1.0 / (1.0 + dot(q, o));
            let offset = (o.x * ex + o.y * ey) * w;
            let fx = (ex - offset * q.x) * (w * step.x);
            let fy = (ey - offset * q.y) * (w * step.y);
            let bend = (fx * q.x * step.x + fy * q.y * step.y) * (1.0 / 12.0);
            let mixed = (fx.x * fx.y + fy.x * fy.y) * (1.0 / 12.0);
            let own = bitmap_piece(level, place + offset - bend, fx * fx + fy * fy, mixed);
            sum.value += own.value;
            sum.weight += own.weight;
            k++;
            if (k >= n.x * n.y) { break; }
        }
        value = bitmap_mean(sum);
    }
    if (bitmaps == 2u && !few) {
        let bend = (ex * q.x + ey * q.y) * (1.0 / 12.0);
        value = bitmap_wide(bitmap, place - bend, ex, ey);
    }
    let low = place + vec2f(bitmap.cell);
    let high = vec2f(bitmap.size - bitmap.cell) - place;
    let gx = vec2f(ex.x, ey.x);
    let gy = vec2f(ex.y, ey.y);
    let share = max(half_plane_share(low.x, gx) + half_plane_share(high.x, gx) - 1.0, 0.0)
        * max(half_plane_share(low.y, gy) + half_plane_share(high.y, gy) - 1.0, 0.0);
    return ground + (albedo_of(value) - ground) * share;
}
