// What the receivers of each entry have in common, in a lamp's light space: a box, and a plane, the
// ground, at or below which nothing hides the lamp from any of them.
// The NumPy form is gpusim/optics/shadow/groups.py.
#import common/index
#import optics/shadow/receiver

// three of each entry: p and q ends | s low, s high, depth at which the farther half of a tile
// begins, `tolerance` as a length | ground: normal, offset; normal 0 where there is none
@group(0) @binding(14) var<storage, read_write> groups_of: array<vec4f>;

struct Group {
    low: vec3f,
    high: vec3f,
    plane: vec4f,
    heights: vec2f,
    far: f32,
}
fn empty_group() -> Group {
    let low = vec3f(UNLIMITED);
    return Group(low, -low, vec4f(0.0), vec2f(UNLIMITED, -UNLIMITED), 0.0);
}
fn plane_of(r: Receiver) -> vec4f {
    let n = upright(r);
    return vec4f(n, dot(n, r.x));
}
fn joined(g: Group, r: Receiver) -> Group {
    let reach = reach_of(r);
    var plane = g.plane;
    if (all(plane.xyz == vec3f(0.0))) { plane = plane_of(r); }
    let height = dot(plane.xyz, r.x) - plane.w;
    let wide = 0.5 * (abs(dot(plane.xyz, r.dx)) + abs(dot(plane.xyz, r.dy)));
    let heights = vec2f(min(g.heights.x, height - wide), max(g.heights.y, height + wide));
    return Group(min(g.low, reach.low), max(g.high, reach.high), plane, heights, max(g.far, length(r.x)));
}

fn store(entry: u32, g: Group, split: f32) {
    let tolerance = light.tolerance * g.far;
    let plane = plane_in_light_space(g.plane);
    // all of the lamp is above all of them
    let slack = select(ANGLE, light.rounding + g.heights.y, is_near());
    let sure = plane.z - lamp_extent(plane) > slack && any(g.plane.xyz != vec3f(0.0));
    groups_of[3u * entry] = vec4f(g.low.x, g.high.x, g.low.y, g.high.y);
    groups_of[3u * entry + 1u] = vec4f(g.low.z, g.high.z, split, tolerance);
    groups_of[3u * entry + 2u] = select(vec4f(0.0), vec4f(g.plane.xyz, g.plane.w + g.heights.x), sure);
}

@compute @workgroup_size(64)
fn pieces_alone(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= receivers.groups) { return; }
    let r = listed_receiver(i);
    var g = empty_group();
    if (r.asks) { g = joined(g, r); }
    store(i, g, 0.0);
}

// Depths that a tile's pixels see are two entries where they differ: where the farther ones begin.
fn split_of(tile: u32) -> f32 {
    var near = UNLIMITED;
    var far = 0.0;
    for (var k = 0u; k < 64u; k++) {
        let depth = pixel_depth(tile_pixel(tile, vec2u(k & 7u, k >> 3u)));
        near = min(near, select(UNLIMITED, depth, depth > 0.0));
        far = max(far, depth);
    }
    return select(UNLIMITED, 0.5 * (near + far), far > 1.01 * near);
}

@compute @workgroup_size(64)
fn tiles_of_pixels(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let tile = linear_id(gid, groups, 64u);
    if (tile >= receivers.groups) { return; }
    // of one triangle the corners tell all
    let id = pixel_id(tile_pixel(tile, vec2u(0u)));
    var alike = distorted == 0u;
    for (var k = 1u; k < 64u; k++) {
        alike = alike && pixel_id(tile_pixel(tile, vec2u(k & 7u, k >> 3u))) == id;
    }
    var one = empty_group();
    var other = empty_group();
    if (alike) {
        var asking = 0u;
        for (var k = 0u; k < 4u; k++) {
            let r = pixel_receiver(tile_pixel(tile, 7u * vec2u(k & 1u, k >> 1u)));
            asking += select(0u, 1u, r.asks);
            if (r.asks) { one = joined(one, r); }
        }
        // the lamp's plane may pass through
        alike = asking == 0u || asking == 4u;
    }
    var split = UNLIMITED;
    if (!alike) {
        one = empty_group();
        split = split_of(tile);
        // on what is bent the others are least apart from the plane in the middle
        let middle = pixel_receiver(tile_pixel(tile, vec2u(4u)));
        if (middle.asks) {
            if (middle.depth > split) { other.plane = plane_of(middle); } else { one.plane = plane_of(middle); }
        }
        for (var k = 0u; k < 64u; k++) {
            let r = pixel_receiver(tile_pixel(tile, vec2u(k & 7u, k >> 3u)));
            if (!r.asks) { continue; }
            if (r.depth > split) { other = joined(other, r); } else { one = joined(one, r); }
        }
    }
    store(tile, one, split);
    store(tile + receivers.groups, other, split);
}
