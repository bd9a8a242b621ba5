// The shaft of an entry: all rays from its receivers to the lamp, as intervals of light space (Haines
// and Wallace, "Shaft culling for efficient ray-traced radiosity", 1991), narrowed by the ground:
// over that a ray gains height at least as fast as to the lowest point of the lamp.
#import optics/shadow/receiver

// two of each node, see bvh_refit.wgsl; per triangle what lies across its edges
@group(0) @binding(15) var nodes: texture_storage_2d<rgba32float, read>;
@group(0) @binding(16) var neighbours: texture_storage_2d<rgba32uint, read>;
@group(0) @binding(14) var<storage, read_write> groups_of: array<vec4f>;

struct Shaft {
    low: vec3f,
    high: vec3f,
    beyond: f32,     // s from which on an occluder is before all receivers
    beside: f32,     // the same for open surfaces, which go on beside a receiver
    ground: vec4f,
    sky: vec4f,      // the ground in light space
    steep: f32,      // most of what s grows by per height over the ground
    tolerance: f32,
    sheet: u32,      // of which nothing hides the lamp, or 0
}
fn shaft_of(low: vec3f, high: vec3f, ground: vec4f, tolerance: f32, sheet: u32) -> Shaft {
    let sky = plane_in_light_space(ground);
    let least = sky.z - lamp_extent(sky);
    let steep = select(UNLIMITED, 1.0 / least, least > 0.0);
    // what begins within a pixel of the receivers is looked at alone: these may be part of it
    let deep = high.z - low.z;
    return Shaft(low, high, high.z + 2.0 * deep, high.z + 8.0 * deep, ground, sky, steep, tolerance, sheet);
}
fn shaft_of_entry(entry: u32) -> Shaft {
    let a = groups_of[3u * entry];
    let b = groups_of[3u * entry + 1u];
    return shaft_of(vec3f(a.x, a.z, b.x), vec3f(a.y, a.w, b.y), groups_of[3u * entry + 2u], b.w, u32(b.z));
}

struct Node {
    low: vec3f,
    high: vec3f,
    ring: f32,
    word: u32,
}
fn node_at(i: u32) -> Node {
    let a = textureLoad(nodes, texel(2u * i));
    let b = textureLoad(nodes, texel(2u * i + 1u));
    return Node(vec3f(a.x, a.z, b.x), vec3f(a.y, a.w, b.y), b.z, u32(b.w));
}

// How far s may grow until a ray is as high over the ground as `top` (a function of light space); less
// than 0 where nothing so low hides anything. Closed bodies may lie on the ground, and hide it then.
fn growth(t: Shaft, top: f32, high: f32, word: u32) -> f32 {
    // where s is without limit so are p and q, and what functions of them would tell
    if (all(t.ground.xyz == vec3f(0.0)) || high >= UNLIMITED) { return UNLIMITED; }
    let tolerance = scaled(t.tolerance, high);
    let lowest = select(-tolerance, 2.0 * tolerance, (word & CLOSED) != 0u);
    return select(-1.0, (top + 2.0 * tolerance) * t.steep, top + lowest > 0.0);
}

// Whether some ray meets a box that s grows to within `most`.
fn meets(t: Shaft, n: Node, most: f32) -> bool {
    let rise = min(n.high.z - t.low.z, most);
    let h = vec2f(light.across.w, light.along.w) * rise;
    return rise > 0.0 && n.low.z - t.high.z <= most
        && all(n.low.xy - h <= t.high.xy) && all(n.high.xy + h >= t.low.xy);
}

// Whether rays meet a node's box; whether all in it is met as a whole, with what is beside it.
fn meets_node(t: Shaft, n: Node) -> vec2<bool> {
    let middle = 0.5 * (n.low + n.high);
    let height = dot(t.sky.xyz, middle) + t.sky.w;
    let slack = scaled(4.0 * light.rounding, n.high.z);
    let extent = dot(abs(t.sky.xyz), n.high - middle) + slack;
    let most = growth(t, height + extent, n.high.z, n.word);
    let own = t.sheet != 0u && sheet_of(n.word) == t.sheet;
    let met = !own && meets(t, n, most);
    if (!met || (n.word & UNIFORM) == 0u) { return vec2<bool>(met, false); }
    let grounded = any(t.ground.xyz != vec3f(0.0));
    let least = select(UNLIMITED, (height - extent) * t.steep, grounded);
    let h = vec2f(light.across.w, light.along.w) * max(min(n.low.z - t.low.z, least), 0.0);
    let before = select(t.beyond, t.beside, (n.word & OPEN) != 0u);
    let whole = least > 0.0 && n.high.z - t.high.z <= least && n.ring > before
        && all(n.low.xy >= t.low.xy - h) && all(n.high.xy <= t.high.xy + h);
    return vec2<bool>(met, whole);
}

// How a triangle hides the lamp from all receivers: not at all, as it is wound, or the other way; or
// whether it has to be looked at alone.
const HIDES: u32 = 1u;
const HIDES_TURNED: u32 = 2u;
const ALONE: u32 = 3u;
fn role(t: Shaft, leaf: Node, i: u32) -> u32 {
    let kind = leaf.word & KIND;
    if (kind == NONE) { return 0u; }
    let o = occluder(i);
    let top = max(over(t, o.a), max(over(t, o.b), over(t, o.c)));
    if (!meets(t, leaf, growth(t, top, leaf.high.z, leaf.word))) { return 0u; }
    if (kind == CROSSING) { return ALONE; }
    // on which side of its plane the receivers are
    let plane = plane_in_light_space(o.plane);
    let middle = 0.5 * (t.low + t.high);
    let value = dot(plane.xyz, middle) + plane.w;
    let extent = dot(abs(plane.xyz), t.high - middle) + scaled(t.tolerance + 4.0 * light.rounding, t.high.z);
    let sure = abs(value) > extent;
    let away = kind == AWAY || kind == AWAY_OPEN;
    // on that of all of the lamp: then nothing is hidden
    if (sure && ((away && value < 0.0) || (kind == TOWARDS && value > 0.0))) { return 0u; }
    if (leaf.low.z <= t.beyond) { return ALONE; }
    if (kind == AWAY) { return HIDES; }
    let close = leaf.low.z <= t.beside;
    if (!close && (kind == AWAY_OPEN || kind == TOWARDS)) {
        return select(HIDES_TURNED, HIDES, kind == AWAY_OPEN);
    }
    // a piece of a pixel is looked at from its middle by what it goes on into
    if (!sure || (listed != 0u && close && o.open)) { return ALONE; }
    if (kind == AWAY_OPEN) { return HIDES; }
    if (kind == TOWARDS) { return HIDES_TURNED; }
    if (value > 0.0) { return HIDES; }
    return select(0u, HIDES_TURNED, kind == SPLIT_OPEN);
}

// Height over the ground in light space.
fn over(t: Shaft, x: vec3f) -> f32 {
    let height = dot(t.ground.xyz, x) - t.ground.w;
    return select(height, height / ahead(x), is_near());
}

// An end of what hides the lamp: 0 where it goes on, or where the end matters to no ray, 1 where that
// lies beside the lamp, in the direction u, 2 where it may cross it; and how it turns about the lamp's
// middle, seen from that of the receivers.
struct Border { state: u32, turn: i32 }
fn border_at(t: Shaft, i: u32, next: u32, k: u32, own: u32) -> Border {
    if (next != NOBODY && role(t, node_at(receivers.leaves + next), next) == own) { return Border(0u, 0); }
    let p = to_light_space(textureLoad(occluders, texel(4u * i + k)).xyz);
    let q = to_light_space(textureLoad(occluders, texel(4u * i + (k + 1u) % 3u)).xyz);
    let slack = max(rounding_at(p), rounding_at(q));
    let low = min(p, q) - slack;
    let high = max(p, q) + slack;
    let reach = vec2f(light.across.w, light.along.w) * (high.z - t.low.z);
    if (high.x + reach.x < t.low.x || low.y - reach.y > t.high.y || high.y + reach.y < t.low.y) {
        return Border(0u, 0);
    }
    let c = 0.5 * (t.low + t.high);
    let d = (p.xy - c.xy) / (p.z - c.z);
    let e = (q.xy - c.xy) / (q.z - c.z);
    let at = d.x - d.y * (e.x - d.x) / (e.y - d.y);
    let passes = (d.y > 0.0) != (e.y > 0.0) && at > 0.0;
    let turn = select(0, select(-1, 1, (d.y > 0.0) == (own == HIDES_TURNED)), passes);
    return Border(select(1u, 2u, low.x - reach.x <= t.high.x), turn);
}
