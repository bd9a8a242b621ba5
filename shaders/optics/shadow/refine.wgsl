// Drops single occluders that hide nothing from any receiver of an entry. A workgroup for each.
// The NumPy form is gpusim/optics/shadow/refine.py.
#import optics/shadow/alone
#import optics/shadow/lists

const WORDS: u32 = 64u;
// bits of the listed: what some receiver looks at past, and what isn't beside all of these
var<workgroup> met: array<atomic<u32>, WORDS>;
var<workgroup> keep: array<atomic<u32>, WORDS>;

@compute @workgroup_size(64)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group.y * groups.x + group.x;
    if (number >= atomicLoad(&counters[REFINED])) { return; }
    atomicStore(&met[lane], 0u);
    atomicStore(&keep[lane], 0u);
    workgroupBarrier();
    let entry = work[number];
    let head = heads[entry];
    let r = receiver_of(entry % receivers.groups, lane);
    let asks = is_in(r, entry, lane);
    let k = looking(r);
    // longer lists than there are bits for keep the rest
    let looked = min(head.y, WORDS * LENGTH);
    // what few are left is looked at once more: whether they are beside takes longer to tell
    var chunk = head.x;
    var bits = 0u;
    var i = 0u;
    loop {
        let place = i % LENGTH;
        let o = occluder(pool[CHUNK * chunk + place]);
        bits |= select(0u, 1u << place, asks && may_hide(r, k, o, aspect(r, k, o)));
        i++;
        if (i % LENGTH == 0u || i >= looked) {
            if (bits != 0u) { atomicOr(&met[(i - 1u) / LENGTH], bits); }
            bits = 0u;
            if (i < looked) { chunk = pool[CHUNK * chunk + LENGTH]; }
        }
        if (i >= looked) { break; }
    }
    workgroupBarrier();
    chunk = head.x;
    var j = 0u;
    loop {
        var left = atomicLoad(&met[j]);
        bits = 0u;
        loop {
            let place = countTrailingZeros(left) % CHUNK;
            let o = occluder(pool[CHUNK * chunk + place]);
            let hides = left != 0u && may_hide(r, k, o, aspect(r, k, o)) && !is_beside(r, k, o);
            bits |= select(0u, 1u << place, hides);
            left &= left - 1u;
            if (left == 0u) { break; }
        }
        if (asks && bits != 0u) { atomicOr(&keep[j], bits); }
        j++;
        if (j * LENGTH >= looked) { break; }
        chunk = pool[CHUNK * chunk + LENGTH];
    }
    workgroupBarrier();
    if (lane != 0u) { return; }
    var source = head.x;
    var into = head.x;
    var kept = 0u;
    for (j = 0u; j < head.y; j++) {
        if (j >= looked || (atomicLoad(&keep[j / LENGTH]) >> (j % LENGTH) & 1u) == 1u) {
            if (kept > 0u && kept % LENGTH == 0u) { into = pool[CHUNK * into + LENGTH]; }
            pool[CHUNK * into + kept % LENGTH] = pool[CHUNK * source + j % LENGTH];
            kept++;
        }
        if (j % LENGTH == LENGTH - 1u && j + 1u < head.y) { source = pool[CHUNK * source + LENGTH]; }
    }
    heads[entry].y = kept;
    if (kept > 0u || (head.w & CROSSES) != 0u) {
        states[2u * light.number * receivers.groups + entry] = HALF;
        work[2u * receivers.groups + atomicAdd(&counters[PENUMBRA], 1u)] = entry;
    }
}
