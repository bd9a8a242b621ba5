// Pixels that an edge crosses: exact polygon areas of the triangles over them, front to back.
//
// Each triangle is clipped to the pixel's square and loses what those in front of it hide, as long
// as that leaves it convex, or as these are seen as a whole. The paint's mean is taken over what is
// left, the light at its centroid; what no triangle takes of the pixel shows the background. A pixel
// that depends on another shape is noted: the host resolves it.
#import lib/raster/planes
#import lib/raster/visible_polygons
#import lib/light/lamp_shares
#import lib/paint/polygon_mean
#import lib/light/surface
#import lib/raster/undistortion_table

override lit: u32;
// 1 where lamps cast shadows: pieces of pixels are listed, for `light_pieces`
override listing: u32 = 0u;

struct Params {
    rays: Rays,
    width: u32,
    background: f32,
}
// Loop bounds that never change are uniforms here: compilers would unroll the loops otherwise,
// and software rasterisers then spend seconds compiling what runs in milliseconds.
struct Range {
    // edge pixels first … count - 1
    first: u32,
    count: u32,
    sides: u32,
    corners: u32,
    hard_rows: u32,
    thin: f32,
    sure: f32,
    // how many pieces may be listed, and bits of the lamps that cast shadows
    slots: u32,
    casting: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(6) var<uniform> range: Range;
// vertices in 1/65536 px, and three of them per triangle
@group(0) @binding(7) var<storage, read> screen: array<vec2i>;
@group(0) @binding(10) var<storage, read> corners: array<u32>;
// per edge pixel two words: its index in the image, and where its triangles start in this list
// (one more pair ends the last); the numbers of the triangles follow, nearest first
@group(0) @binding(8) var<storage, read> lists: array<u32>;
// of every edge pixel
@group(0) @binding(9) var<storage, read_write> found: array<EdgePixel>;

// per piece, as bits: its place (w: the occluder that it lies on), unit normal, and how the place
// changes over the piece, twice
@group(0) @binding(11) var<storage, read_write> receivers: array<vec4u>;
// per triangle in 24 bits of w the occluder that it is part of, or these
@group(0) @binding(12) var owners: texture_2d<u32>;

// per edge pixel the number of its first piece: those of neighbouring pixels lie side by side
@group(0) @binding(13) var<storage, read> slot_of: array<u32>;

// Flags of a piece: more shows of it, or less, than can be told here; it is lit in its middle though it goes round a corner;
// it lies behind others in doubt; its light isn't even
const DOUBT: u32 = 1u;
const CORNER: u32 = 2u;
const BEHIND: u32 = 4u;
const UNEVEN: u32 = 8u;

fn list_piece(slot: u32, t: Triangle, s: Spot, extent: mat2x2f) {
    let sides = mat2x3f(s.dx, s.dy) * extent;
    let own = textureLoad(owners, texel(t.id), 0).w & 0xffffffu;
    receivers[4u * slot] = vec4u(bitcast<vec3u>(s.x), select(own, 0xffffffffu, own == 0xffffffu));
    receivers[4u * slot + 1u] = vec4u(bitcast<vec3u>(s.n), bitcast<u32>(s.widened));
    receivers[4u * slot + 2u] = vec4u(bitcast<vec3u>(sides[0]), 0u);
    receivers[4u * slot + 3u] = vec4u(bitcast<vec3u>(sides[1]), 0u);
}
fn listed_spot(slot: u32) -> Spot {
    let x = receivers[4u * slot];
    let n = receivers[4u * slot + 1u];
    let at = bitcast<vec3f>(x.xyz);
    return Spot(at, bitcast<vec3f>(n.xyz), vec3f(0.0), vec3f(0.0), bitcast<f32>(n.w));
}

// What pieces of a pixel add up to. `doubtful`: how many are in doubt, `doubted` their light and
// `share` their area; `dimmest` and `brightest`: of the others.
struct Sum {
    value: Color,
    seen: f32,
    behind: f32,
    doubtful: u32,
    dimmest: Color,
    brightest: Color,
    doubted: Color,
    share: f32,
    unsure: bool,
}
fn empty_sum() -> Sum {
    var sum = Sum();
    sum.dimmest = Color(1e30);
    return sum;
}
// One more; `half`: some lamp is seen in part, and what is in front may end where its shadow begins.
fn added(before: Sum, area: f32, light: Color, flags: u32, half: bool) -> Sum {
    var sum = before;
    let doubt = (flags & DOUBT) != 0u;
    sum.seen += select(area, 0.0, doubt);
    sum.value += select(area * light, Color(0.0), doubt);
    sum.behind += select(0.0, area, doubt && (flags & BEHIND) == 0u);
    sum.doubtful += select(0u, 1u, doubt);
    sum.dimmest = select(sum.dimmest, min(sum.dimmest, light), doubt);
    sum.brightest = select(sum.brightest, max(sum.brightest, light), doubt);
    sum.doubted += select(Color(0.0), area * light, doubt);
    sum.share += select(0.0, area, doubt);
    sum.unsure = sum.unsure || (doubt && (half || (flags & UNEVEN) != 0u));
    return sum;
}
// Radiance, and 1 if the host has to resolve the pixel.
fn finished(sum: Sum) -> EdgePixel {
    let behind = behind_all(params.background);
    let open = 1.0 - sum.seen;
    // what is open is a seam between neighbours, shows the background, or the doubtful ones
    if (open <= range.thin) { return edge_pixel(sum.value / sum.seen, 0.0); }
    if (sum.doubtful == 0u) { return edge_pixel(sum.value + open * behind, 0.0); }
    var dimmest = sum.dimmest;
    var brightest = sum.brightest;
    if (sum.behind < FULL) {
        dimmest = min(dimmest, behind);
        brightest = max(brightest, behind);
    }
    // of a single one nothing tells how much the light differs over it
    let apart = above((brightest - dimmest) * open, range.sure * brightest);
    let doubts = sum.unsure || sum.doubtful == 1u || apart;
    return edge_pixel(sum.value + open * sum.doubted / sum.share, select(0.0, 1.0, doubts));
}

// px^2 of a triangle that are taken to be hidden.
const LEFT_OUT: f32 = 1e-5;

// px^2 of a triangle round a corner that may be lit as a rectangle.
const SMALL: f32 = 0.01;

// Seen share of a pixel from which on nothing behind can matter.
const FULL: f32 = 1.0 - 1e-6;

// A triangle's corner from the middle of a pixel, in sides of its sensitive square: areas here are
// shares of that.
fn corner_from(place: u32, pixel: vec2i) -> vec2f {
    return vec2f(screen[corners[place]] - pixel * 65536) / (65536.0 * aperture);
}

fn start_of(n: u32) -> u32 {
    return lists[2u * n + 1u];
}

fn triangle_sides(id: u32, pixel: vec2i) -> Sides {
    return sides_of(
        corner_from(3u * id, pixel), corner_from(3u * id + 1u, pixel),
        corner_from(3u * id + 2u, pixel),
    );
}

// One of the 64 triangles over a pixel (`MAX_DEPTH` in resolve.py).
fn bit_of(k: u32) -> vec2u {
    let bit = 1u << (k & 31u);
    return select(vec2u(0u, bit), vec2u(bit, 0u), k < 32u);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let n = range.first + gid.y * (groups.x * 64u) + gid.x;
    if (n >= range.count) { return; }
    let index = lists[2u * n];
    let stop = start_of(n + 1u);
    let pixel = vec2i(i32(index % params.width), i32(index / params.width));

    let bend = bend_at(pixel);
    let change = undistort_change(bend);
    let nearest = start_of(n);
    var sum = empty_sum();
    // first and second moments of what is seen, as `spread_of` has these
    var first = vec2f(0.0);
    var second = vec3f(0.0);
    // those of which more shows, or less, than can be told here
    var doubtful = vec2u(0u);
    // those that nothing hides any of: none of these lies over another
    var clear = vec2u(0u);

    // tests of loops come last: see paint.wgsl
    var c = nearest;
    loop {
        if (c >= stop) { break; }
        let id = lists[c];
        let t = triangle_at(id);
        var own = triangle_sides(id, pixel);
        var polygon: Polygon;
        polygon.count = 4;
        polygon.p[0] = vec2f(-0.5, -0.5);
        polygon.p[1] = vec2f(0.5, -0.5);
        polygon.p[2] = vec2f(0.5, 0.5);
        polygon.p[3] = vec2f(-0.5, 0.5);
        var k = 0u;
        loop {
            polygon = clip(&polygon, own.s[k]);
            k++;
            if (k >= range.sides) { break; }
        }

        // one or two lines leave it convex
        let reach = reach_of(&polygon);
        var cuts = 0;
        var line0 = vec3f(0.0);
        var line1 = vec3f(0.0);
        var gone = polygon.count < 3;
        var doubt = false;
        var met = vec2u(0u);
        if (!gone && c > nearest) {
            var b = nearest;
            loop {
                let m = meeting(reach, own, triangle_sides(lists[b], pixel));
                gone = gone || m.kind == 1u;
                doubt = doubt || m.kind == 3u;
                if (m.kind == 2u) {
                    line1 = line0;
                    line0 = m.line;
                    cuts++;
                }
                if (m.kind != 0u) { met |= bit_of(b - nearest); }
                b++;
                if (b >= c) { break; }
            }
        }
        doubt = doubt || cuts > 2 || (cuts > 0 && polygon.count > 6);
        if (!gone && !doubt && cuts > 0) {
            var n = 0;
            loop {
                polygon = clip(&polygon, select(-line1, -line0, n == 0));
                n++;
                if (n >= cuts) { break; }
            }
            gone = polygon.count < 3;
        }
        let layer = met & doubtful;
        var corner = false;
        var m = vec3f(0.0);
        if (!gone) { m = moments(&polygon); }
        var spread = vec3f(0.0);
        if (listing != 0u && m.x > SMALLEST) { spread = spread_of(&polygon, m); }
        let plain = bumpy == 0u && (patterned == 0u || t.more.y == 0.0);
        if (doubt && plain && all(doubtful == vec2u(0u)) && m.x > FULL) {
            // what is left by all others
            doubt = false;
            m.x = 1.0 - sum.seen;
            corner = m.x > SMALL;
            m = vec3f(m.x, clamp(-first / m.x, vec2f(-0.5), vec2f(0.5)));
            spread = vec3f(1.0, 0.0, 1.0) - second - spread_at(m);
        }
        if (doubt && m.x > SMALLEST && polygon.count <= 5 && any((met & clear) != vec2u(0u))) {
            // less what each of these hides; the rest is all that is seen if no others do
            var rest = vec3f(m.x, m.x * m.yz);
            var rest2 = spread + spread_at(m);
            var b = nearest;
            loop {
                if (any((met & clear & bit_of(b - nearest)) != vec2u(0u))) {
                    var other = triangle_sides(lists[b], pixel);
                    var part = polygon;
                    var k = 0u;
                    loop {
                        part = clip(&part, other.s[k]);
                        k++;
                        if (k >= range.sides) { break; }
                    }
                    if (part.count > 2) {
                        let own = moments(&part);
                        rest -= vec3f(own.x, own.x * own.yz);
                        if (listing != 0u) { rest2 -= spread_of(&part, own) + spread_at(own); }
                    }
                }
                b++;
                if (b >= c) { break; }
            }
            if (rest.x <= LEFT_OUT) {
                doubt = false;
                m = vec3f(0.0);
            } else if (all((met & ~clear) == vec2u(0u)) && plain) {
                doubt = false;
                corner = rest.x > SMALL;
                m = vec3f(rest.x, clamp(rest.yz / rest.x, vec2f(-0.5), vec2f(0.5)));
                spread = max(rest2 - spread_at(m), vec3f(0.0, -1e30, 0.0));
            }
        }
        if (m.x > SMALLEST) {
            first += m.x * m.yz;
            if (listing != 0u) { second += spread + spread_at(m); }
            let d = vec2f(pixel - t.place.xy);
            let middle = undistort_within(bend, m.yz);
            var extent = change;
            if (listing != 0u) { extent = change * rectangle_of(m, spread); }
            if (distorted != 0u || aperture != 1.0) {
                for (var n = 0; n < polygon.count; n++) {
                    polygon.p[n] = undistort_within(bend, polygon.p[n]);
                }
            }
            printed = 0.0;
            var light = paint_polygon(t, d, &polygon, middle);
            let uneven = bumpy != 0u || (patterned != 0u && t.more.y != 0.0);
            let flags = select(0u, DOUBT, doubt) | select(0u, CORNER, corner)
                | select(0u, BEHIND, any(layer != vec2u(0u))) | select(0u, UNEVEN, uneven);
            if (listing != 0u) {
                let slot = slot_of[n - range.first] + c - nearest;
                list_piece(slot, t, spot(t, params.rays, vec2f(pixel) + middle, d + middle), extent);
                set_painted(slot, Painted(m.x, light, printed, flags));
            } else if (lit != 0u) {
                let r = reflection_at(t, params.rays, vec2f(pixel) + middle, d + middle);
                light = piece_radiance(t, r, light);
            }
            if (!doubt && cuts == 0 && all(met == vec2u(0u))) { clear |= bit_of(c - nearest); }
            if (doubt) { doubtful |= bit_of(c - nearest); }
            sum = added(sum, m.x, light, flags, false);
        }
        c++;
        if (!(c < stop && sum.seen < FULL && sum.behind < FULL)) { break; }
    }
    if (listing == 0u) { found[n] = finished(sum); }
}

// Of a piece of mean albedo `albedo`, of which some is `printed`.
fn piece_radiance(t: Triangle, r: Reflection, albedo: Color) -> Color {
    let whole = paint_at(u32(t.ny.w)).featured > 1u;
    let ground = select(ground_of(t), albedo, whole);
    return radiance_of(t, r, albedo, ground, clamp(1.0 - printed, 0.0, 1.0));
}

// Pixels of which `main` has listed the pieces, once it is known what these see of the lamps.
@compute @workgroup_size(64)
fn light_pieces(
    @builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u
) {
    let n = range.first + gid.y * (groups.x * 64u) + gid.x;
    if (n >= range.count) { return; }
    let nearest = start_of(n);
    let stop = start_of(n + 1u);
    var sum = empty_sum();
    var unknown = false;
    var c = nearest;
    loop {
        if (c >= stop) { break; }
        let slot = slot_of[n - range.first] + c - nearest;
        let paint = painted_at(slot);
        if (paint.area > 0.0) {
            let t = triangle_at(lists[c]);
            let s = listed_spot(slot);
            let known = Known(slot, range.slots, range.casting, 0u);
            let light = reflection_known(s.x, s.n, gloss_at(t, s), openness_at(t.id, s.x), known);
            printed = paint.printed;
            let value = piece_radiance(t, light.r, paint.albedo);
            sum = added(sum, paint.area, value, paint.flags, light.half);
            unknown = unknown || (light.half && (paint.flags & CORNER) != 0u);
        }
        c++;
        if (c >= stop) { break; }
    }
    let result = finished(sum);
    found[n] = edge_pixel(radiance_found(result), select(unsure_found(result), 1.0, unknown));
}
