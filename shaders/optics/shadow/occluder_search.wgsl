// The search for what may hide a lamp from the receivers of each entry: single occluders, and the
// ends of what hides it as a whole. Where no such end may cross the lamp and nothing is alone, all
// receivers see as much of it as the middle of them: all or nothing, which a winding number tells
// (Laine et al., "Soft shadow volumes for ray tracing", 2005, with a box of receivers for a point).
// Driven by gpusim/optics/shadow/lamp_visibility.py; the NumPy form of all stages is
// `shares_of` in gpusim/optics/shadow/brute_force.py.
#import lib/numeric/index
#import optics/shadow/lists
#import optics/shadow/shaft

// per 4 x 4 tiles, nearer and farther halves in turn: LIT, UMBRA, or PENUMBRA where tiles have to look
@group(0) @binding(25) var<storage, read_write> coarse: array<u32>;
// workgroups of the kernel that follows
@group(0) @binding(26) var<storage, read_write> next_groups: array<u32>;

// A list while it grows: its first and its last chunk. Where the pool is used up its words go to the
// chunk 0, which nobody reads, and what is missing is counted on.
struct List { first: u32, last: u32, count: u32 }
fn appended(list: List, word: u32) -> List {
    var grown = list;
    if (list.count % LENGTH == 0u) {
        let next = atomicAdd(&counters[TAKEN], 1u) + 1u;
        grown.last = select(0u, next, next < receivers.capacity);
        if (list.count == 0u) { grown.first = grown.last; }
        else if (grown.last != 0u) { pool[CHUNK * list.last + LENGTH] = grown.last; }
    }
    pool[CHUNK * grown.last + list.count % LENGTH] = word;
    grown.count++;
    return grown;
}

// The node that follows in depth-first order what is below node i: the root, 1, in the end.
fn after(i: u32) -> u32 { return (i + 1u) >> countTrailingZeros(i + 1u); }

// The first leaf from node `start` on that rays meet and that isn't skipped as part of what is in the
// shaft as a whole; the root if there is none. A loop of its own: neighbouring lanes step until all
// have a leaf, and what is done with leaves isn't done at every node.
fn next_leaf(t: Shaft, start: u32) -> u32 {
    var i = start;
    loop {
        let met = meets_node(t, node_at(i));
        let down = met.x && !met.y;
        let found = down && i >= receivers.leaves;
        i = select(select(after(i), 2u * i, down), i, found);
        if (found || i == 1u) { break; }
    }
    return i;
}

// What hides the lamp: lists of single occluders and of ends, whether some of these may cross it, and
// how often they turn about its middle, seen from that of the receivers; whether that is all.
struct Found { alone: List, ends: List, crosses: bool, turns: i32, whole: bool }
fn in_penumbra(f: Found) -> bool { return f.crosses || f.alone.count > 0u; }
fn plain_state(f: Found) -> u32 { return select(LIT, UMBRA, f.turns != 0); }

// With `lists` all of it, else until it is known that the lamp may be seen in part.
fn search(t: Shaft, lists: bool) -> Found {
    var f = Found();
    var i = 0u;
    loop {
        // the next triangle that hides it as a whole; single ones on the way
        var own = 0u;
        loop {
            i = next_leaf(t, after(i));
            let face = i - receivers.leaves;
            own = 0u;
            if (i != 1u) { own = role(t, node_at(i), face); }
            if (own == ALONE) {
                if (lists) { f.alone = appended(f.alone, face); } else { f.alone.count = 1u; }
            }
            if (i == 1u || own == HIDES || own == HIDES_TURNED || (!lists && own == ALONE)) { break; }
        }
        if (own == HIDES || own == HIDES_TURNED) {
            let face = i - receivers.leaves;
            let next = textureLoad(neighbours, texel(face));
            for (var k = 0u; k < 3u; k++) {
                let border = border_at(t, face, next[k], k, own);
                f.turns += border.turn;
                f.crosses = f.crosses || border.state == 2u;
                if (lists && border.state != 0u) {
                    f.ends = appended(f.ends, 4u * face + k + select(0u, TURNED, own == HIDES_TURNED));
                }
            }
        }
        if (i == 1u || (!lists && in_penumbra(f))) { break; }
    }
    f.whole = i == 1u;
    if (lists) { note_cut(f.whole); }
    return f;
}

fn fill(entry: u32) {
    let t = shaft_of_entry(entry);
    // of a lamp that has two spaces an entry asks in one: in the other one nothing is said of it
    if (t.low.z > t.high.z) { return; }
    var f = search(t, true);
    // through whose receivers the lamp's plane passes: some may ask in its other space
    f.crosses = f.crosses || t.high.z >= UNLIMITED;
    heads[entry] = vec4u(
        f.alone.first, f.alone.count, f.ends.first, f.ends.count | select(0u, CROSSES, f.crosses),
    );
    // single ones are tested more closely before it is known whether they matter
    say(entry, select(plain_state(f), PENUMBRA, f.crosses));
    if (f.alone.count > 0u) { enqueue(SIFTED, entry); }
    else if (f.crosses) { enqueue(ENDS, entry); }
}

@compute @workgroup_size(64)
fn listed_groups(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let entry = linear_id(gid, groups, 64u);
    if (entry < entries()) { fill(entry); }
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
    if (state == PENUMBRA) { fill(entry); return; }
    let ends = groups_of[3u * entry + 1u];
    if (ends.x <= ends.y) { say(entry, state); }
}

// The shaft of some tiles together; one without receivers where there are none.
fn shaft_of_tiles(corner: vec2u, farther: u32) -> Shaft {
    let size = vec2u(receivers.columns, receivers.groups / receivers.columns);
    var low = vec3f(UNLIMITED);
    var high = vec3f(-UNLIMITED);
    var ground = vec4f(0.0);
    var first = true;
    var tolerance = 0.0;
    var sheet = 0u;
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
        if (first) {
            ground = g;
            sheet = u32(b.z);
        }
        if (u32(b.z) != sheet) { sheet = 0u; }
        first = false;
        // one plane, or none
        if (any(abs(g.xyz - ground.xyz) > vec3f(ANGLE))) { ground = vec4f(0.0); }
        ground.w = min(ground.w, g.w);
    }
    return shaft_of(low, high, ground, tolerance, sheet);
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
    let f = search(t, false);
    coarse[id] = select(plain_state(f), PENUMBRA, !f.whole || in_penumbra(f) || t.high.z >= UNLIMITED);
}

// As many as one dimension takes, and the rows of these; none where lists are incomplete.
fn tell(count: u32) {
    let complete = atomicLoad(&counters[TAKEN]) < receivers.capacity;
    next_groups[0] = min(count, 32768u);
    next_groups[1] = select(0u, (count + 32767u) / 32768u, complete);
    next_groups[2] = 1u;
}
@compute @workgroup_size(1)
fn count_sifted() { tell((atomicLoad(&counters[SIFTED]) + 63u) / 64u); }
@compute @workgroup_size(1)
fn count_refined() { tell(atomicLoad(&counters[REFINED])); }
@compute @workgroup_size(1)
fn count_ends() { tell(atomicLoad(&counters[ENDS])); }
@compute @workgroup_size(1)
fn count_mixed() { tell(atomicLoad(&counters[MIXED])); }
