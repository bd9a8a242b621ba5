// Drops single occluders that hide nothing from any receiver of an entry: at first those that are below the
// planes in which receivers lie, or beside, a thread for each entry; then receiver by receiver, a workgroup
// for each. Driven by gpusim/optics/shadow/lamp_visibility.py; the NumPy form of all stages is
// `shares_of` in gpusim/optics/shadow/brute_force.py.
#import lib/numeric/index
#import optics/shadow/single_occluder
#import optics/shadow/lists

// Planes that are looked at, and occluders: of entries with more none is dropped, or not the rest.
const PLANES: u32 = 16u;
const LOOKED: u32 = 64u;

// What a receiver of an entry lies in: of pixels the triangle + 1, of a list each by itself.
fn triangle_of(entry: u32, k: u32) -> u32 {
    let group = entry % receivers.groups;
    let own = is_farther(group, k) == (entry >= receivers.groups);
    return select(0u, select(pixel_id(tile_pixel(group, k)), k + 1u, are_listed()), own);
}

// Whether no receiver in a plane is hidden: all of the occluder is below, or beside.
fn is_clear(r: Receiver, k: Looking, o: Occluder) -> bool {
    let against = !o.open && dot(o.plane.xyz, r.n) < AGAINST;
    return (!is_over(r, k, o) && !against) || is_beside(k.own, o);
}

@compute @workgroup_size(64)
fn sift(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let number = linear_id(gid, groups, 64u);
    if (number >= atomicLoad(&counters[SIFTED])) { return; }
    let entry = queued(SIFTED, number);
    let head = heads[entry];
    let size = size_of(entry % receivers.groups);
    // one of each plane, as a rule
    var some: array<u32, PLANES>;
    var count = 0u;
    for (var k = 0u; k < size; k++) {
        let own = triangle_of(entry, k);
        let before = (k & 7u) != 0u && triangle_of(entry, max(k, 1u) - 1u) == own;
        let above = k >= 8u && triangle_of(entry, max(k, 8u) - 8u) == own;
        let beside = k >= 8u && (k & 7u) != 7u && triangle_of(entry, max(k, 7u) - 7u) == own;
        if (own != 0u && !before && !above && !beside) {
            some[min(count, PLANES - 1u)] = k;
            count++;
        }
    }
    var met = select(vec2u(0u), vec2u(0xffffffffu), count > PLANES);
    for (var m = 0u; m < select(count, 0u, count > PLANES); m++) {
        let r = receiver_of(entry % receivers.groups, some[m]);
        let k = looking(r);
        var chunk = head.x;
        for (var i = 0u; i < min(head.y, LOOKED); i++) {
            if (i > 0u && i % LENGTH == 0u) { chunk = pool[CHUNK * chunk + LENGTH]; }
            let bit = 1u << (i & 31u);
            let clear = is_clear(r, k, occluder(pool[CHUNK * chunk + i % LENGTH]));
            met |= select(select(vec2u(bit, 0u), vec2u(0u, bit), i >= 32u), vec2u(0u), clear);
        }
    }
    let all = select(head.y, 0u, all(met == vec2u(0u)) && head.y <= LOOKED);
    var source = head.x;
    var into = head.x;
    var kept = 0u;
    for (var i = 0u; i < all; i++) {
        if (i > 0u && i % LENGTH == 0u) { source = pool[CHUNK * source + LENGTH]; }
        let bits = select(met.x, met.y, i >= 32u);
        if (i >= LOOKED || (bits >> (i & 31u) & 1u) != 0u) {
            if (kept > 0u && kept % LENGTH == 0u) { into = pool[CHUNK * into + LENGTH]; }
            pool[CHUNK * into + kept % LENGTH] = pool[CHUNK * source + i % LENGTH];
            kept++;
        }
    }
    heads[entry].y = kept;
    if (kept > 0u) { enqueue(REFINED, entry); }
    else if ((head.w & CROSSES) != 0u) { enqueue(ENDS, entry); }
}

const WORDS: u32 = 64u;
// bits of the listed: what hides something from some receiver
var<workgroup> keep: array<atomic<u32>, WORDS>;

@compute @workgroup_size(64)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group.y * groups.x + group.x;
    if (number >= atomicLoad(&counters[REFINED])) { return; }
    atomicStore(&keep[lane], 0u);
    workgroupBarrier();
    let entry = queued(REFINED, number);
    let head = heads[entry];
    let r = receiver_of(entry % receivers.groups, lane);
    let asks = is_in(r, entry, lane);
    let k = looking(r);
    // longer lists than there are bits for keep the rest
    let looked = min(head.y, WORDS * LENGTH);
    var chunk = head.x;
    var bits = 0u;
    var i = 0u;
    loop {
        let place = i % LENGTH;
        let o = occluder(pool[CHUNK * chunk + place]);
        bits |= select(0u, 1u << place, asks && may_hide(r, k, o, aspect(r, k, o)));
        i++;
        if (i % LENGTH == 0u || i >= looked) {
            if (bits != 0u) { atomicOr(&keep[(i - 1u) / LENGTH], bits); }
            bits = 0u;
            if (i < looked) { chunk = pool[CHUNK * chunk + LENGTH]; }
        }
        if (i >= looked) { break; }
    }
    workgroupBarrier();
    if (lane != 0u) { return; }
    var source = head.x;
    var into = head.x;
    var kept = 0u;
    var j = 0u;
    for (; j < head.y; j++) {
        if (j >= looked || (atomicLoad(&keep[j / LENGTH]) >> (j % LENGTH) & 1u) == 1u) {
            if (kept > 0u && kept % LENGTH == 0u) { into = pool[CHUNK * into + LENGTH]; }
            pool[CHUNK * into + kept % LENGTH] = pool[CHUNK * source + j % LENGTH];
            kept++;
        }
        if (j % LENGTH == LENGTH - 1u && j + 1u < head.y) { source = pool[CHUNK * source + LENGTH]; }
    }
    note_cut(j >= head.y);
    heads[entry].y = kept;
    if (kept > 0u || (head.w & CROSSES) != 0u) {
        say(entry, PENUMBRA);
        enqueue(select(ENDS, MIXED, kept > 0u), entry);
    }
}
