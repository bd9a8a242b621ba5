// What the receivers of each entry have in common. First, for all lamps, a *cell* that has all of what
// their samples look from, and a plane about which that lies; then what these are in a lamp's light space: a
// box, and the *ground*, a plane at or below which nothing hides the lamp from any of them.
// The NumPy form is gpusim/optics/shadow/receiver_groups.py.
#import lib/numeric/index
#import optics/shadow/receiver

// four of each entry: low ends (w: how far unit normals are from the plane's) | high ends (w: thickness) |
// plane: unit normal, and the offset below all | x: number of the open surface that all lie on, or 0. Ends
// of pixels are places in the picture and depths, of the list places
@group(0) @binding(19) var<storage, read_write> cells: array<vec4f>;
// three of each entry: p and q ends | s low, s high, number of the sheet that all lie on, if that hides nothing
// of itself, or 0, `tolerance` as a length | ground: normal, offset; normal 0 where there is none. Low ends are
// above high ones where nothing asks
@group(0) @binding(14) var<storage, read_write> groups_of: array<vec4f>;

// see bvh_refit.wgsl
@group(0) @binding(9) var<storage, read> sides: array<u32>;
// The number of an open surface if that hides nothing of itself (single_layer.py says why), else 0.
fn single(surface: u32) -> u32 {
    let place = max(surface, 1u) - 1u;
    let wound = light.sheets >> place & 1u;
    return select(0u, surface, surface > 0u && wound == 1u && sides[place] != 3u);
}

struct Cell {
    low: vec3f,
    high: vec3f,
    plane: vec4f,
    heights: vec2f,
    lean: f32,
    sheet: u32,
}
fn plane_of(r: Receiver) -> vec4f {
    if (listed == 0u) { return vec4f(r.n, dot(r.n, r.x)); }
    let n = upright(r);
    return vec4f(n, dot(n, r.x));
}
fn joined(c: Cell, r: Receiver) -> Cell {
    var plane = c.plane;
    if (all(plane.xyz == vec3f(0.0))) { plane = plane_of(r); }
    let height = dot(plane.xyz, r.x) - plane.w;
    let wide = 0.5 * (abs(dot(plane.xyz, r.dx)) + abs(dot(plane.xyz, r.dy)));
    let heights = vec2f(min(c.heights.x, height - wide), max(c.heights.y, height + wide));
    let apart = plane.xyz - r.n;
    let lean = max(c.lean, length(apart) + r.lean);
    let own = surface_of(r.on);
    let sheet = select(select(0u, own, c.sheet == own), own, c.sheet == NOBODY);
    return Cell(min(c.low, r.at - r.reach), max(c.high, r.at + r.reach), plane, heights, lean, sheet);
}
fn store_cell(entry: u32, c: Cell) {
    cells[4u * entry] = vec4f(c.low, c.lean);
    cells[4u * entry + 1u] = vec4f(c.high, c.heights.y - c.heights.x);
    cells[4u * entry + 2u] = vec4f(c.plane.xyz, c.plane.w + c.heights.x);
    cells[4u * entry + 3u] = vec4f(f32(select(c.sheet, 0u, c.sheet == NOBODY)), 0.0, 0.0, 0.0);
}

// Of a tile that sees one triangle the corners tell all.
fn is_alike(tile: u32) -> bool {
    if (listed != 0u || distorted != 0u) { return false; }
    let id = pixel_id(tile_pixel(tile, 0u));
    var alike = true;
    for (var k = 1u; k < 64u; k++) { alike = alike && pixel_id(tile_pixel(tile, k)) == id; }
    return alike;
}
fn picked(k: u32, alike: bool) -> u32 { return select(k, 7u * (k & 1u) + 56u * (k >> 1u), alike); }

@compute @workgroup_size(64)
fn find_cells(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let group = linear_id(gid, groups, 64u);
    if (group >= receivers.groups) { return; }
    let alike = is_alike(group);
    let size = select(size_of(group), 4u, alike);
    var near = UNLIMITED;
    var far = 0.0;
    var split = UNLIMITED;
    var bits = vec2u(0u);
    // at first all together; if depths differ the nearer half, then the farther
    for (var turn = 0u; turn < 3u; turn++) {
        let low = vec3f(UNLIMITED);
        var c = Cell(low, -low, vec4f(0.0), vec2f(UNLIMITED, -UNLIMITED), 0.0, NOBODY);
        let divided = turn > 0u;
        if (listed == 0u) {
            // on what is bent the others are least apart from the plane in the middle
            let middle = receiver_of(group, 36u);
            let own = !divided || (middle.depth > split) == (turn == 2u);
            if (middle.depth > 0.0 && own) { c.plane = plane_of(middle); }
        }
        for (var k = 0u; k < select(size, 0u, divided && split == UNLIMITED); k++) {
            let r = receiver_of(group, picked(k, alike));
            let there = r.depth > 0.0;
            near = min(near, select(UNLIMITED, r.depth, there));
            far = max(far, r.depth);
            let farther = divided && r.depth > split;
            if (there && (!divided || farther == (turn == 2u))) { c = joined(c, r); }
            let bit = select(0u, 1u << (k & 31u), farther);
            bits |= select(vec2u(bit, 0u), vec2u(0u, bit), k >= 32u);
            if (listed != 0u) { halves[receivers.groups + 1u + number_of(group, k)] = u32(farther); }
        }
        if (!divided && !alike && far > 1.01 * near) { split = 0.5 * (near + far); }
        if (turn != 2u && (!divided || split < UNLIMITED)) { store_cell(group, c); }
        if (turn == 2u) { store_cell(group + receivers.groups, c); }
    }
    if (listed == 0u) {
        halves[2u * group] = bits.x;
        halves[2u * group + 1u] = bits.y;
    }
}

struct Box { low: vec3f, high: vec3f }
// A place in the lamp's frame, from its middle.
fn with_place(box: Box, y: vec3f) -> Box {
    let at = place_in_frame(y);
    let slack = rounding_at(at);
    return Box(min(box.low, at - slack), max(box.high, at + slack));
}
fn empty_box() -> Box { return Box(vec3f(UNLIMITED), vec3f(-UNLIMITED)); }

fn end_of(low: vec3f, high: vec3f, k: u32) -> vec3f {
    return select(low, high, vec3<bool>((k & 1u) != 0u, (k & 2u) != 0u, (k & 4u) != 0u));
}

// What is before the lamp's plane of a box around places in the lamp's frame that passes through that.
fn unlimited_box(low: vec3f, high: vec3f) -> Box {
    let beside = low.xy - light.rounding;
    let beyond = high.xy + light.rounding;
    let most = high.z + light.rounding;
    return Box(
        vec3f(select(beside / most, vec2f(-UNLIMITED), beside < vec2f(0.0)), 1.0 / most),
        vec3f(select(beyond / most, vec2f(UNLIMITED), beyond > vec2f(0.0)), UNLIMITED),
    );
}

@compute @workgroup_size(64)
fn find_groups(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let entry = linear_id(gid, groups, 64u);
    if (entry >= 2u * receivers.groups) { return; }
    let low = cells[4u * entry];
    let high = cells[4u * entry + 1u];
    let plane = cells[4u * entry + 2u];
    // uniforms are loaded again and again in loops: places are linear in what these tell
    let frame = transpose(mat3x3f(light.across.xyz, light.along.xyz, light.axis.xyz));
    let centre = frame * light.centre.xyz;
    let world = mat3x3f(receivers.x.xyz, receivers.y.xyz, receivers.one.xyz);
    let rays = frame * world;
    let rates = plane.xyz * world;
    let lengths = transpose(world) * world;
    // software drivers run what a branch leaves out as well: of what isn't there no corner is looked at
    let corners = select(8u, 0u, low.z > high.z);
    var box = empty_box();
    var narrow = empty_box();
    var least = vec3f(UNLIMITED);
    var most = vec3f(-UNLIMITED);
    var far = 0.0;
    var sure = listed == 0u;
    for (var k = 0u; k < corners; k++) {
        let end = end_of(low.xyz, high.xyz, k);
        var y = frame * end;
        if (listed == 0u) {
            let at = vec3f(end.xy, 1.0);
            let ray = rays * at;
            y = end.z * ray;
            far = max(far, end.z * end.z * dot(at, lengths * at));
            // where the ray meets the bounds of what lies about the plane
            let rate = dot(rates, at);
            let offset = plane.w + select(0.0, high.w, k >= 4u);
            let met = select(1.0, offset / rate, rate * offset > 0.0) * ray - centre;
            sure = sure && rate * offset > 0.0 && (!is_near() || met.z > light.axis.w);
            narrow = with_place(narrow, met);
        } else {
            far = max(far, dot(end, end));
        }
        y -= centre;
        box = with_place(box, y);
        least = min(least, y);
        most = max(most, y);
    }
    if (sure) { box = Box(max(box.low, narrow.low), min(box.high, narrow.high)); }
    if (is_near() && least.z < light.axis.w) { box = unlimited_box(least, most); }
    let lamp = plane_in_light_space(plane);
    let extent = lamp_extent(lamp);
    let away = select(1.0, length(max(abs(least), abs(most))), is_near()) + light.across.w + light.along.w;
    let lean = (low.w + light.terminator) * away;
    let turned = lamp.z + extent + lean > 0.0;
    if (low.z > high.z || !turned || (is_near() && most.z <= 0.0)) { box = empty_box(); }
    // all of the lamp is above all of them
    let above = lamp.z - extent > select(ANGLE, light.rounding + high.w, is_near());
    groups_of[3u * entry] = vec4f(box.low.x, box.high.x, box.low.y, box.high.y);
    // on the side that all of the lamp lights
    let sheet = select(0u, single(u32(cells[4u * entry + 3u].x)), lamp.z - extent - lean > 0.0);
    groups_of[3u * entry + 1u] = vec4f(box.low.z, box.high.z, f32(sheet), light.tolerance * sqrt(far));
    groups_of[3u * entry + 2u] = select(vec4f(0.0), plane, above);
}
