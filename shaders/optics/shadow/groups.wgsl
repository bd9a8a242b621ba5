// Cells in a lamp's light space: a box, and a plane, the ground, at or below which nothing hides the lamp
// from any receiver of the entry. The NumPy form is gpusim/optics/shadow/groups.py.
#import common/index
#import optics/shadow/receiver

// see cells.wgsl
@group(0) @binding(19) var<storage, read> cells: array<vec4f>;
// three of each entry: p and q ends | s low, s high, -, `tolerance` as a length | ground: normal, offset;
// normal 0 where there is none. Low ends are above high ones where nothing asks
@group(0) @binding(14) var<storage, read_write> groups_of: array<vec4f>;

struct Box { low: vec3f, high: vec3f }
fn with_place(box: Box, x: vec3f) -> Box {
    let at = to_light_space(x);
    let slack = rounding_at(at);
    return Box(min(box.low, at - slack), max(box.high, at + slack));
}
fn empty_box() -> Box { return Box(vec3f(UNLIMITED), vec3f(-UNLIMITED)); }

fn end_of(low: vec3f, high: vec3f, k: u32) -> vec3f {
    return select(low, high, vec3<bool>((k & 1u) != 0u, (k & 2u) != 0u, (k & 4u) != 0u));
}
fn corner_of(low: vec3f, high: vec3f, k: u32) -> vec3f {
    let end = end_of(low, high, k);
    if (listed != 0u) { return end; }
    return end.z * pixel_ray(end.xy);
}

// Of what is before the lamp's plane, which passes through a cell.
fn unlimited_box(low: vec3f, high: vec3f, corners: u32) -> Box {
    var beside = vec2f(UNLIMITED);
    var beyond = vec2f(-UNLIMITED);
    var most = 0.0;
    for (var k = 0u; k < corners; k++) {
        let x = corner_of(low, high, k);
        let y = x - light.centre.xyz;
        let at = vec2f(dot(light.across.xyz, y), dot(light.along.xyz, y));
        beside = min(beside, at - light.rounding);
        beyond = max(beyond, at + light.rounding);
        most = max(most, ahead(x) + light.rounding);
    }
    return Box(
        vec3f(select(beside / most, vec2f(-UNLIMITED), beside < vec2f(0.0)), 1.0 / most),
        vec3f(select(beyond / most, vec2f(UNLIMITED), beyond > vec2f(0.0)), UNLIMITED),
    );
}

// Less of a box: of pixels where rays through the tile's corners meet the bounds of what lies about a plane.
fn narrowed(box: Box, low: vec3f, high: vec3f, plane: vec4f, thick: f32, corners: u32) -> Box {
    var within = empty_box();
    var sure = true;
    for (var k = 0u; k < corners; k++) {
        let ray = pixel_ray(end_of(low, high, k).xy);
        let rate = dot(plane.xyz, ray);
        let offset = plane.w + select(0.0, thick, k >= 4u);
        let x = select(1.0, offset / rate, rate * offset > 0.0) * ray;
        sure = sure && rate * offset > 0.0 && (!is_near() || ahead(x) > light.axis.w);
        within = with_place(within, x);
    }
    if (!sure) { return box; }
    return Box(max(box.low, within.low), min(box.high, within.high));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let entry = linear_id(gid, groups, 64u);
    if (entry >= 2u * receivers.groups) { return; }
    let low = cells[3u * entry];
    let high = cells[3u * entry + 1u];
    let plane = cells[3u * entry + 2u];
    // software drivers run what a branch leaves out as well: of what isn't there no corner is looked at
    let corners = select(8u, 0u, low.z > high.z);
    var box = empty_box();
    var least = UNLIMITED;
    var most = -UNLIMITED;
    var far = 0.0;
    var away = 0.0;
    for (var k = 0u; k < corners; k++) {
        let x = corner_of(low.xyz, high.xyz, k);
        box = with_place(box, x);
        least = min(least, ahead(x));
        most = max(most, ahead(x));
        far = max(far, dot(x, x));
        away = max(away, distance(x, light.centre.xyz));
    }
    let through = is_near() && least < light.axis.w;
    if (listed == 0u) { box = narrowed(box, low.xyz, high.xyz, plane, high.w, corners); }
    if (through) { box = unlimited_box(low.xyz, high.xyz, select(0u, corners, through)); }
    let lamp = plane_in_light_space(plane);
    let extent = lamp_extent(lamp);
    away = select(1.0, away, is_near()) + light.across.w + light.along.w;
    let turned = lamp.z + extent + (low.w + light.terminator) * away > 0.0;
    if (low.z > high.z || !turned || (is_near() && most <= 0.0)) { box = empty_box(); }
    // all of the lamp is above all of them
    let sure = lamp.z - extent > select(ANGLE, light.rounding + high.w, is_near());
    groups_of[3u * entry] = vec4f(box.low.x, box.high.x, box.low.y, box.high.y);
    groups_of[3u * entry + 1u] = vec4f(box.low.z, box.high.z, 0.0, light.tolerance * sqrt(far));
    groups_of[3u * entry + 2u] = select(vec4f(0.0), plane, sure);
}
