// A lamp's tree over triangles in Morton order: the boxes of its leaves and, seven levels a dispatch,
// of what is above them. Node 1 is the root, node i has the children 2 i and 2 i + 1.
// The NumPy form is gpusim/optics/shadow/occluders.py.
#import lib/numeric/index
#import optics/shadow/light_space

struct Tree {
    count: u32,    // triangles
    leaves: u32,   // a power of two, those without a triangle among them
    first: u32,    // of the level that is read
}
@group(0) @binding(2) var<uniform> tree: Tree;
// places of vertices relative to the eye; per triangle its vertices and whether its surface is open
@group(0) @binding(3) var<storage, read> vertices: array<f32>;
@group(0) @binding(4) var<storage, read> triangles: array<vec4u>;
@group(0) @binding(5) var gathered: texture_storage_2d<rgba32float, write>;
// per triangle what lies across its edges
@group(0) @binding(6) var neighbours: texture_storage_2d<rgba32uint, read>;
// two of each node: p and q ends | s low, s high, lowest s with its neighbours', word
@group(0) @binding(7) var<storage, read_write> boxes: array<vec4f>;
@group(0) @binding(8) var nodes: texture_storage_2d<rgba32float, write>;
// of each open surface: 1 where a triangle isn't turned towards all of the lamp, 2 where one isn't away
@group(0) @binding(9) var<storage, read_write> sides: array<atomic<u32>>;

fn vertex(i: u32) -> vec3f { return vec3f(vertices[3u * i], vertices[3u * i + 1u], vertices[3u * i + 2u]); }

@compute @workgroup_size(64)
fn gather(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= tree.count) { return; }
    let t = triangles[i];
    let a = vertex(t.x);
    let b = vertex(t.y);
    let c = vertex(t.z);
    let way = cross(b - a, c - a);
    let size = length(way);
    let n = select(vec3f(0.0), way / size, size > 0.0);
    textureStore(gathered, texel(4u * i), vec4f(a, f32(t.w)));
    textureStore(gathered, texel(4u * i + 1u), vec4f(b, 0.0));
    textureStore(gathered, texel(4u * i + 2u), vec4f(c, 0.0));
    textureStore(gathered, texel(4u * i + 3u), vec4f(n, dot(n, (a + b + c) / 3.0)));
}

fn is_behind(x: vec3f) -> bool { return is_near() && ahead(x) < light.axis.w; }

fn facing(o: Occluder) -> u32 {
    let plane = plane_in_light_space(o.plane);
    let slack = select(ANGLE, on_face(), is_near());
    let reach = lamp_extent(plane) + slack;
    var result = select(SPLIT, SPLIT_OPEN, o.open);
    if (plane.z + reach < 0.0) { result = select(AWAY, AWAY_OPEN, o.open); }
    if (plane.z - reach > 0.0) { result = select(NONE, TOWARDS, o.open); }
    // it may lie on a closed body's face
    if (is_near() && !o.open && plane.z - lamp_extent(plane) > -slack) { result = NONE; }
    let behind = vec3<bool>(is_behind(o.a), is_behind(o.b), is_behind(o.c));
    if (any(behind) && result != NONE) { result = select(CROSSING, NONE, all(behind)); }
    return result;
}

// Of a corner and the edge from there: the box of what is before the lamp's plane. Where an edge
// meets the plane it goes on to infinity.
struct Ends { low: vec3f, high: vec3f }
fn with_edge(ends: Ends, a: vec3f, b: vec3f) -> Ends {
    var result = ends;
    let start = ahead(a);
    let stop = ahead(b);
    if (!is_near() || start >= light.axis.w) {
        let at = to_light_space(a);
        let slack = rounding_at(at);
        result = Ends(min(ends.low, at - slack), max(ends.high, at + slack));
    }
    if (is_near() && (start < light.axis.w) != (stop < light.axis.w)) {
        let cut = mix(a, b, clamp((light.axis.w - start) / (stop - start), 0.0, 1.0)) - light.centre.xyz;
        let beside = vec2f(dot(light.across.xyz, cut), dot(light.along.xyz, cut));
        let slack = vec2f(light.axis.w);
        let low = select(vec2f(UNLIMITED), vec2f(-UNLIMITED), beside - slack < vec2f(0.0));
        let high = select(vec2f(-UNLIMITED), vec2f(UNLIMITED), beside + slack > vec2f(0.0));
        let near = beside / light.axis.w;
        result.low = min(result.low, vec3f(min(low, near), UNLIMITED));
        result.high = max(result.high, vec3f(max(high, near), UNLIMITED));
    }
    return result;
}
fn ends_of(o: Occluder) -> Ends {
    var ends = Ends(vec3f(UNLIMITED), vec3f(-UNLIMITED));
    ends = with_edge(ends, o.a, o.b);
    ends = with_edge(ends, o.b, o.c);
    return with_edge(ends, o.c, o.a);
}

fn store(i: u32, ends: Ends, ring: f32, word: u32) {
    boxes[2u * i] = vec4f(ends.low.x, ends.high.x, ends.low.y, ends.high.y);
    boxes[2u * i + 1u] = vec4f(ends.low.z, ends.high.z, ring, f32(word));
    textureStore(nodes, texel(2u * i), boxes[2u * i]);
    textureStore(nodes, texel(2u * i + 1u), boxes[2u * i + 1u]);
}

@compute @workgroup_size(64)
fn leaves(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= tree.leaves) { return; }
    var ends = Ends(vec3f(UNLIMITED), vec3f(-UNLIMITED));
    var ring = UNLIMITED;
    var word = NONE;
    if (i < tree.count) {
        let o = occluder(i);
        let kind = facing(o);
        let surface = surface_of(i);
        let side = select(0u, 1u, kind != TOWARDS) | select(0u, 2u, kind != AWAY_OPEN);
        let place = max(surface, 1u) - 1u;
        if (surface > 0u && (atomicLoad(&sides[place]) & side) != side) { atomicOr(&sides[place], side); }
        if (kind != NONE) {
            ends = ends_of(o);
            ring = ends.low.z;
            var same = kind == AWAY || kind == TOWARDS || kind == AWAY_OPEN;
            let next = textureLoad(neighbours, texel(i));
            for (var k = 0u; k < 3u; k++) {
                if (next[k] == NOBODY) { same = false; continue; }
                let other = occluder(next[k]);
                same = same && facing(other) == kind;
                ring = min(ring, ends_of(other).low.z);
            }
            word = kind | select(0u, UNIFORM, same) | select(CLOSED, 0u, o.open);
            word |= select(0u, OPEN, same && o.open) | (SHEET * surface);
        }
    }
    store(tree.leaves + i, ends, ring, word);
}

fn joined(i: u32) {
    let a = boxes[4u * i];
    let b = boxes[4u * i + 1u];
    let c = boxes[4u * i + 2u];
    let d = boxes[4u * i + 3u];
    let low = min(vec3f(a.x, a.z, b.x), vec3f(c.x, c.z, d.x));
    let high = max(vec3f(a.y, a.w, b.y), vec3f(c.y, c.w, d.y));
    let one = u32(b.w);
    let other = u32(d.w);
    // what is empty agrees with all
    var word = 0u;
    if (one == 0u) { word = other; }
    else if (other == 0u || (one == other && (one & UNIFORM) != 0u)) { word = one; }
    // inside there is neither a leaf's kind nor a half of what is uniform
    let mixed = (word & UNIFORM) == 0u;
    if (mixed) { word = (one | other) & CLOSED; }
    // zero is empty
    if (word == 0u && (one | other) != 0u) { word = KIND; }
    let same = one == 0u || other == 0u || sheet_of(one) == sheet_of(other);
    word |= select(0u, SHEET * sheet_of(one | other), mixed && same);
    store(i, Ends(low, high), min(b.z, d.z), word);
}

@compute @workgroup_size(64)
fn levels(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3u) {
    var first = tree.first;
    var width = 64u;
    for (var level = 0; level < 7; level++) {
        first /= 2u;
        let i = first + group.x * width + lane;
        if (lane < width && i < 2u * first) { joined(i); }
        width /= 2u;
        storageBarrier();
    }
}
