// Which share of a lamp a point sees: the outlines of the faces between, on a mask of 16 x 32
// samples. The NumPy form is gpusim/optics/occlusion.py, which explains it; the tables are made by
// gpusim/optics/shadow_tiles.py.
#import common/lamp_samples
#import common/texel

override shadowed: u32;
// 1 where some lamp is hidden by what is told by its outline alone
override chained: u32 = 0u;

struct Shades {
    count: u32,
    columns: u32,
    tolerance: f32,
    lamps: array<LampFace, 16>,
}
@group(0) @binding(60) var<uniform> shades: Shades;
// edges of the faces that may hide a lamp from a tile, three texels each: where it begins relative to
// the eye (w: 1 for the last one of a face, 2 more if the inside hides as well), where it goes (w: 0 for
// those of a face of which three are there at least, else 1), and the face's plane: unit normal, offset
// from the eye; then those of outlines: both ends (w of the
// first one: 1 for the last edge of an outline), and a plane beyond which it hides the lamp
@group(0) @binding(61) var occluders: texture_storage_2d<rgba32float, read>;
// per tile in half shadow a texel per lamp: first and number of these, the lamp, and in the lowest byte
// how many lamps the tile sees in part, which come first, above it how many edges are those of faces
@group(0) @binding(62) var shadow_lists: texture_2d<u32>;
// per tile of 8 x 8 px (bits of the lamps that light it, number among the half shadowed + 1, -, -)
@group(0) @binding(63) var shadow_tiles: texture_2d<u32>;

const AGAINST: f32 = -0.5;   // cosine between the normals of what lies against each other
const BESIDE: f32 = 0.5;     // above which a receiver may be part of a sheet that goes on with a face

fn shadow_tile(pixel: vec2i) -> vec2u {
    let tile = vec2u(pixel) / 8u;
    return textureLoad(shadow_tiles, texel(tile.y * shades.columns + tile.x), 0).xy;
}

// How often edges wind round samples, modulo 8, in three bits.
struct Turns {
    ones: vec4u,
    twos: vec4u,
    fours: vec4u,
}
// One turn more, or less where the edge goes the other way, for the samples between its ends, in the
// lamp's direction u, that lie before it.
fn wound(turns: Turns, first: vec4u, last: vec4u, edge: vec4u) -> Turns {
    let ones = (first ^ last) & ~(first ^ edge);
    let twos = ones & (turns.ones ^ last);
    return Turns(turns.ones ^ ones, turns.twos ^ twos, turns.fours ^ (twos & (turns.twos ^ last)));
}

// What outlines hide: the samples that their edges wind round. Of edges i … stop - 1, one at least.
fn chained_cover(lamp: LampFace, begin: u32, stop: u32, x: vec3f, to: vec3f, dx: vec3f, dy: vec3f) -> Samples {
    var covered = Samples();
    var turns0 = Turns();
    var turns1 = Turns();
    var turns2 = Turns();
    var turns3 = Turns();
    var i = begin;
    loop {
        let first = textureLoad(occluders, texel(3u * i));
        let last = textureLoad(occluders, texel(3u * i + 1u));
        let plane = textureLoad(occluders, texel(3u * i + 2u));
        let d = first.xyz - x;
        let e = last.xyz - x;
        // the same numbers for an end of two edges, so that no row of samples falls between them
        let one = samples_of(lamp, to, cross(d, lamp.u.xyz), lamp.u.xyz, dx, dy);
        let other = samples_of(lamp, to, cross(e, lamp.u.xyz), lamp.u.xyz, dx, dy);
        let edge = samples_of(lamp, to, cross(d, e), e - d, dx, dy);
        turns0 = wound(turns0, one.rows0, other.rows0, edge.rows0);
        turns1 = wound(turns1, one.rows1, other.rows1, edge.rows1);
        turns2 = wound(turns2, one.rows2, other.rows2, edge.rows2);
        turns3 = wound(turns3, one.rows3, other.rows3, edge.rows3);
        let ends = 0u - u32(first.w);
        let used = vec4u(select(0u, ends, dot(plane.xyz, x) > plane.w));
        covered.rows0 |= used & (turns0.ones | turns0.twos | turns0.fours);
        covered.rows1 |= used & (turns1.ones | turns1.twos | turns1.fours);
        covered.rows2 |= used & (turns2.ones | turns2.twos | turns2.fours);
        covered.rows3 |= used & (turns3.ones | turns3.twos | turns3.fours);
        let kept = vec4u(~ends);
        turns0 = Turns(turns0.ones & kept, turns0.twos & kept, turns0.fours & kept);
        turns1 = Turns(turns1.ones & kept, turns1.twos & kept, turns1.fours & kept);
        turns2 = Turns(turns2.ones & kept, turns2.twos & kept, turns2.fours & kept);
        turns3 = Turns(turns3.ones & kept, turns3.twos & kept, turns3.fours & kept);
        i++;
        if (i >= stop) { break; }
    }
    return covered;
}

// n: the receiver's normal. A closed body hides from a receiver that lies against it, too. list: the
// lamp's texel.
fn lamp_share(list: vec4u, x: vec3f, n: vec3f, dx: vec3f, dy: vec3f) -> f32 {
    let lamp = shades.lamps[list.z];
    let to = lamp.centre.xyz - lamp.centre.w * x;
    let tolerance = shades.tolerance * length(x);
    var covered0 = vec4u(0u);
    var covered1 = vec4u(0u);
    var covered2 = vec4u(0u);
    var covered3 = vec4u(0u);
    var inside0 = vec4u(0xffffffffu);
    var inside1 = vec4u(0xffffffffu);
    var inside2 = vec4u(0xffffffffu);
    var inside3 = vec4u(0xffffffffu);
    let faces = list.x + (list.w >> 8u);
    if (chained != 0u && list.x + list.y > faces) {
        let outlined = chained_cover(lamp, faces, list.x + list.y, x, to, dx, dy);
        covered0 = outlined.rows0;
        covered1 = outlined.rows1;
        covered2 = outlined.rows2;
        covered3 = outlined.rows3;
    }
    // The tests of loops come last: software drivers pass over a loop's body until no lane is left,
    // so that a test at its beginning costs one pass more.
    let up = cross(dx, dy);
    let over = select(-up, up, dot(up, n) > 0.0);
    let sides = lamp.u.w * abs(dot(over, lamp.u.xyz)) + abs(dot(over, lamp.v.xyz));
    // at -1e30 all are above it
    let slack = select(-1e30, tolerance * length(over), dot(over, to) > sides);
    let level = vec2f(0.0, slack);
    var ahead = level;
    var i = list.x;
    loop {
        if (chained != 0u && i >= faces) { break; }
        let begin = textureLoad(occluders, texel(3u * i));
        let way = textureLoad(occluders, texel(3u * i + 1u));
        let plane = textureLoad(occluders, texel(3u * i + 2u));
        let d = begin.xyz - x;
        let both_sides = begin.w > 1.0;

        let height = plane.w - dot(plane.xyz, x);
        let against = !both_sides && abs(height) <= tolerance && dot(plane.xyz, n) < AGAINST;
        let side = select(-1.0, 1.0, height > 0.0 && !against);
        let above = select(-height, abs(height), both_sides);
        let apart = side * (dot(plane.xyz, to) - lamp.centre.w * height);
        let reach = lamp.u.w * abs(dot(plane.xyz, lamp.u.xyz)) + abs(dot(plane.xyz, lamp.v.xyz));
        let counts = (above > tolerance || against) && apart + reach > 0.0;
        // seen from beyond its plane, a face would seem to hide what lies behind the receiver
        let passes = abs(height) < abs(dot(plane.xyz, dx)) + abs(dot(plane.xyz, dy));
        let beside = abs(dot(plane.xyz, n)) > BESIDE;
        let moves = select(1.0, 0.0, both_sides && passes && beside);
        // seen edge-on, as its plane passes through the pixel, a face would seem to hide what lies on
        // its other side from the samples beyond the plane: it can't where no corner is towards the lamp,
        // or over the receiver's plane, as all of the lamp is
        let e = d + way.xyz;
        ahead = max(ahead, max(vec2f(dot(d, to), dot(d, over)), vec2f(dot(e, to), dot(e, over))));

        let edge = samples_of(lamp, to, side * cross(d, way.xyz), side * way.xyz, moves * dx, moves * dy);
        inside0 &= edge.rows0;
        inside1 &= edge.rows1;
        inside2 &= edge.rows2;
        inside3 &= edge.rows3;

        let last = vec4u(0u - (u32(begin.w) & 1u));
        let used = select(vec4u(0u), last, counts && (!passes || against || way.w > 0.0 || all(ahead > level)));
        covered0 |= used & inside0;
        covered1 |= used & inside1;
        covered2 |= used & inside2;
        covered3 |= used & inside3;
        ahead = select(ahead, level, last.x != 0u);
        inside0 |= last;
        inside1 |= last;
        inside2 |= last;
        inside3 |= last;
        let open = (lamp.mask[0] & ~covered0) | (lamp.mask[1] & ~covered1)
            | (lamp.mask[2] & ~covered2) | (lamp.mask[3] & ~covered3);
        i++;
        if (i >= faces || all(open == vec4u(0u))) { break; }
    }
    let seen = countOneBits(lamp.mask[0] & ~covered0) + countOneBits(lamp.mask[1] & ~covered1)
        + countOneBits(lamp.mask[2] & ~covered2) + countOneBits(lamp.mask[3] & ~covered3);
    return f32(seen.x + seen.y + seen.z + seen.w) / lamp.v.w;
}
