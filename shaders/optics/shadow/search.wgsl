// The search for what may hide a lamp from the receivers of each entry: single occluders, and the
// ends of what hides it as a whole. Where no such end may cross the lamp and nothing is alone, all
// receivers see as much of it as the middle of them: all or nothing, which a winding number tells
// (Laine et al., "Soft shadow volumes for ray tracing", 2005, with a box of receivers for a point).
// The NumPy form is gpusim/optics/shadow/search.py.
#import common/index
#import optics/shadow/lists
#import optics/shadow/shaft

// per 4 x 4 tiles, nearer and farther halves in turn: LIT, UMBRA, or HALF where tiles have to look
@group(0) @binding(25) var<storage, read_write> coarse: array<u32>;
// (groups, 1, 1) of the kernels that follow: refine, mask
@group(0) @binding(26) var<storage, read_write> refine_groups: array<u32>;
@group(0) @binding(27) var<storage, read_write> mask_groups: array<u32>;

// The next chunk of a list; none, 0, where the pool is used up, which is counted on.
fn grown(last: u32) -> u32 {
    let next = atomicAdd(&counters[TAKEN], 1u) + 1u;
    if (next >= receivers.capacity) { return 0u; }
    if (last != 0u) { pool[CHUNK * last + LENGTH] = next; }
    return next;
}

fn search(entry: u32) {
    let t = shaft_of_entry(entry);
    states[entry] = LIT;
    heads[entry] = vec4u(0u);
    if (t.low.z > t.high.z) { return; }
    var head = vec4u(0u);
    var last = vec2u(0u);
    var crosses = 0u;
    var turns = 0;
    var visited = 0u;
    var i = 1u;
    loop {
        let n = node_at(i);
        let met = meets_node(t, n);
        var down = met.x && !met.y;
        visited++;
        if (down && i >= receivers.leaves) {
            let face = i - receivers.leaves;
            let own = role(t, n, face);
            if (own == ALONE) {
                if (head.y % LENGTH == 0u) {
                    last.x = grown(last.x);
                    if (head.y == 0u) { head.x = last.x; }
                }
                pool[CHUNK * last.x + head.y % LENGTH] = face;
                head.y++;
            }
            if (own == HIDES || own == HIDES_TURNED) {
                let next = textureLoad(neighbours, texel(face));
                for (var k = 0u; k < 3u; k++) {
                    let border = border_at(t, face, next[k], k, own);
                    turns += border.turn;
                    if (border.state == 0u) { continue; }
                    crosses |= select(0u, CROSSES, border.state == 2u);
                    if (head.w % LENGTH == 0u) {
                        last.y = grown(last.y);
                        if (head.w == 0u) { head.z = last.y; }
                    }
                    pool[CHUNK * last.y + head.w % LENGTH] = 4u * face + k
                        + select(0u, TURNED, own == HIDES_TURNED);
                    head.w++;
                }
            }
            down = false;
        }
        if (down) { i = 2u * i; } else { i = (i + 1u) >> countTrailingZeros(i + 1u); }
        if (i <= 1u) { break; }
    }
    heads[entry] = vec4u(head.xyz, head.w | crosses);
    atomicAdd(&counters[VISITED], visited);
    atomicAdd(&counters[SINGLES], head.y);
    atomicAdd(&counters[EDGES], head.w);
    var state = select(LIT, UMBRA, turns != 0);
    // a piece by itself is looked at once: there is nothing to refine for others
    if (head.y > 0u && listed == 0u) {
        work[atomicAdd(&counters[REFINED], 1u)] = entry;
    } else if (head.y > 0u || crosses != 0u) {
        state = HALF;
        work[2u * receivers.groups + atomicAdd(&counters[PENUMBRA], 1u)] = entry;
    }
    states[entry] = state;
}

@compute @workgroup_size(64)
fn pieces_alone(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i < receivers.groups) { search(i); }
}

fn coarse_size() -> vec2u {
    return (vec2u(receivers.columns, receivers.groups / receivers.columns) + 3u) / 4u;
}

@compute @workgroup_size(64)
fn tiles_of_pixels(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let across = (receivers.columns + 7u) / 8u;
    // software drivers hand out workgroups in runs, one to each thread: work of a kind is spread
    let half = groups.x / 2u;
    let number = 2u * (group.x % half) + group.x / half;
    let place = vec2u((number >> 1u) % across, (number >> 1u) / across);
    let farther = (number & 1u) ^ (place.x & 1u);
    // eight lanes, which work in step there, look from 4 x 2 tiles
    let inner = vec2u((lane & 3u) | ((lane >> 3u & 1u) << 2u), (lane >> 2u & 1u) | ((lane >> 4u) << 1u));
    let at = 8u * place + inner;
    let entry = at.y * receivers.columns + at.x + farther * receivers.groups;
    if (at.x >= receivers.columns || at.y * receivers.columns >= receivers.groups) { return; }
    let state = coarse[2u * ((at.y >> 2u) * coarse_size().x + (at.x >> 2u)) + farther];
    if (state == HALF) { search(entry); return; }
    heads[entry] = vec4u(0u);
    states[entry] = state;
}

// The shaft of some tiles together; one without receivers where there are none.
fn shaft_of_tiles(corner: vec2u, farther: u32) -> Shaft {
    let size = vec2u(receivers.columns, receivers.groups / receivers.columns);
    var low = vec3f(UNLIMITED);
    var high = vec3f(-UNLIMITED);
    var ground = vec4f(0.0);
    var first = true;
    var tolerance = 0.0;
    for (var k = 0u; k < 16u; k++) {
        let at = min(corner + vec2u(k & 3u, k >> 2u), size - 1u);
        let e = 3u * (at.y * size.x + at.x + farther * receivers.groups);
        let a = groups_of[e];
        let b = groups_of[e + 1u];
        let g = groups_of[e + 2u];
        if (b.x > b.y) { continue; }
        low = min(low, vec3f(a.x, a.z, b.x));
        high = max(high, vec3f(a.y, a.w, b.y));
        tolerance = max(tolerance, b.w);
        if (first) { ground = g; }
        first = false;
        // one plane, or none
        if (any(abs(g.xyz - ground.xyz) > vec3f(ANGLE))) { ground = vec4f(0.0); }
        ground.w = min(ground.w, g.w);
    }
    return shaft_of(low, high, ground, tolerance);
}

@compute @workgroup_size(16)
fn coarse_tiles(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 16u);
    let size = coarse_size();
    if (id >= 2u * size.x * size.y) { return; }
    let place = id >> 1u;
    let t = shaft_of_tiles(4u * vec2u(place % size.x, place / size.x), id & 1u);
    coarse[id] = LIT;
    if (t.low.z > t.high.z) { return; }
    var turns = 0;
    var found = LIT;
    var i = 1u;
    loop {
        let n = node_at(i);
        let met = meets_node(t, n);
        var down = met.x && !met.y;
        if (down && i >= receivers.leaves) {
            let face = i - receivers.leaves;
            let own = role(t, n, face);
            if (own == ALONE) { found = HALF; break; }
            if (own == HIDES || own == HIDES_TURNED) {
                let next = textureLoad(neighbours, texel(face));
                for (var k = 0u; k < 3u; k++) {
                    let border = border_at(t, face, next[k], k, own);
                    turns += border.turn;
                    if (border.state == 2u) { found = HALF; }
                }
                if (found == HALF) { break; }
            }
            down = false;
        }
        if (down) { i = 2u * i; } else { i = (i + 1u) >> countTrailingZeros(i + 1u); }
        if (i <= 1u) { break; }
    }
    if (found == LIT && turns != 0) { found = UMBRA; }
    coarse[id] = found;
}

// Of so many workgroups, as many as one dimension takes and the rows of these; none where lists are
// incomplete.
fn folded(count: u32) -> vec2u {
    let complete = atomicLoad(&counters[TAKEN]) < receivers.capacity;
    return vec2u(min(count, 32768u), select(0u, (count + 32767u) / 32768u, complete));
}
@compute @workgroup_size(1)
fn count_refined() {
    let size = folded(atomicLoad(&counters[REFINED]));
    refine_groups[0] = size.x;
    refine_groups[1] = size.y;
    refine_groups[2] = 1u;
}
@compute @workgroup_size(1)
fn count_penumbra() {
    let count = atomicLoad(&counters[PENUMBRA]);
    let size = folded(select(count, (count + 63u) / 64u, listed != 0u));
    mask_groups[0] = size.x;
    mask_groups[1] = size.y;
    mask_groups[2] = 1u;
}
