// What the receivers of each entry have in common, for all lamps: a cell that has all of what their
// samples look from, and a plane about which that lies. The NumPy form is gpusim/optics/shadow/cells.py.
#import common/index
#import optics/shadow/receiver

// three of each entry: low ends (w: how far unit normals are from the plane's) | high ends (w: thickness) |
// plane: unit normal, and the offset below all. Ends of pixels are places in the picture and depths, of
// the list places
@group(0) @binding(19) var<storage, read_write> cells: array<vec4f>;

struct Cell {
    low: vec3f,
    high: vec3f,
    plane: vec4f,
    heights: vec2f,
    lean: f32,       // squared
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
    let lean = max(c.lean, dot(apart, apart));
    return Cell(min(c.low, r.at - r.reach), max(c.high, r.at + r.reach), plane, heights, lean);
}
fn store(entry: u32, c: Cell) {
    cells[3u * entry] = vec4f(c.low, sqrt(c.lean));
    cells[3u * entry + 1u] = vec4f(c.high, c.heights.y - c.heights.x);
    cells[3u * entry + 2u] = vec4f(c.plane.xyz, c.plane.w + c.heights.x);
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
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let group = linear_id(gid, groups, 64u);
    if (group >= receivers.groups) { return; }
    let alike = is_alike(group);
    let size = select(size_of(group), 4u, alike);
    var near = UNLIMITED;
    var far = 0.0;
    for (var k = 0u; k < select(size, 0u, alike); k++) {
        let depth = depth_of(group, k);
        near = min(near, select(UNLIMITED, depth, depth > 0.0));
        far = max(far, depth);
    }
    let split = select(UNLIMITED, 0.5 * (near + far), far > 1.01 * near);
    var bits = vec2u(0u);
    for (var half = 0u; half < 2u; half++) {
        let low = vec3f(UNLIMITED);
        var c = Cell(low, -low, vec4f(0.0), vec2f(UNLIMITED, -UNLIMITED), 0.0);
        if (listed == 0u) {
            // on what is bent the others are least apart from the plane in the middle
            let middle = receiver_of(group, 36u);
            if (middle.depth > 0.0 && (middle.depth > split) == (half == 1u)) { c.plane = plane_of(middle); }
        }
        for (var k = 0u; k < select(size, 0u, half == 1u && split == UNLIMITED); k++) {
            let r = receiver_of(group, picked(k, alike));
            let farther = r.depth > split;
            if (r.depth > 0.0 && farther == (half == 1u)) { c = joined(c, r); }
            let bit = select(0u, 1u << (k & 31u), farther);
            bits |= select(vec2u(bit, 0u), vec2u(0u, bit), k >= 32u);
            if (listed != 0u) { halves[receivers.groups + 1u + number_of(group, k)] = u32(farther); }
        }
        store(group + half * receivers.groups, c);
    }
    if (listed == 0u) {
        halves[2u * group] = bits.x;
        halves[2u * group + 1u] = bits.y;
    }
}
