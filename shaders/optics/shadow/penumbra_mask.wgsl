// The share of the lamp that receivers of entries in penumbra see, on a mask of 16 x 32 samples: those that ends
// of what hides it wind round, and those behind single occluders.
// Driven by gpusim/optics/shadow/lamp_visibility.py; the NumPy form of all stages is
// `shares_of` in gpusim/optics/shadow/brute_force.py.
#import lib/numeric/index
#import optics/shadow/single_occluder
#import optics/shadow/lists

// one lamp after the other, per pixel or receiver of the list
@group(0) @binding(31) var<storage, read_write> shares: array<f32>;

// How often edges wind round samples, modulo 64: as many layers as hide the lamp.
struct Turns {
    ones: vec4u,
    twos: vec4u,
    fours: vec4u,
    eights: vec4u,
    sixteens: vec4u,
    many: vec4u,
}
// One turn more, or less where the edge goes the other way, for the samples between its ends, in the
// lamp's direction u, that lie before it.
fn wound(t: Turns, first: vec4u, last: vec4u, edge: vec4u) -> Turns {
    let ones = (first ^ last) & ~(first ^ edge);
    let twos = ones & (t.ones ^ last);
    let fours = twos & (t.twos ^ last);
    let eights = fours & (t.fours ^ last);
    let sixteens = eights & (t.eights ^ last);
    let many = sixteens & (t.sixteens ^ last);
    return Turns(
        t.ones ^ ones, t.twos ^ twos, t.fours ^ fours, t.eights ^ eights, t.sixteens ^ sixteens,
        t.many ^ many,
    );
}
fn any_turn(t: Turns) -> vec4u {
    return t.ones | t.twos | t.fours | t.eights | t.sixteens | t.many;
}

fn hidden_as_a_whole(r: Receiver, to: vec3f, first: u32, count: u32) -> Samples {
    var turns0 = Turns();
    var turns1 = Turns();
    var turns2 = Turns();
    var turns3 = Turns();
    var chunk = first;
    var i = 0u;
    // a loop that tests first runs its body once more than it turns
    loop {
        let word = pool[CHUNK * chunk + i % LENGTH];
        let face = (word & ~TURNED) >> 2u;
        let k = word & 3u;
        let p = textureLoad(occluders, texel(4u * face + k)).xyz - r.x;
        let q = textureLoad(occluders, texel(4u * face + (k + 1u) % 3u)).xyz - r.x;
        let turned = word >= TURNED;
        let d = select(p, q, turned);
        let e = select(q, p, turned);
        // the same numbers for an end of two edges, so that no row of samples falls between them
        let one = samples_of(lamp, to, cross(d, lamp.u.xyz), lamp.u.xyz, r.dx, r.dy);
        let other = samples_of(lamp, to, cross(e, lamp.u.xyz), lamp.u.xyz, r.dx, r.dy);
        let edge = samples_of(lamp, to, cross(d, e), e - d, r.dx, r.dy);
        turns0 = wound(turns0, one.rows0, other.rows0, edge.rows0);
        turns1 = wound(turns1, one.rows1, other.rows1, edge.rows1);
        turns2 = wound(turns2, one.rows2, other.rows2, edge.rows2);
        turns3 = wound(turns3, one.rows3, other.rows3, edge.rows3);
        i++;
        if (i >= count) { break; }
        if (i % LENGTH == 0u) { chunk = pool[CHUNK * chunk + LENGTH]; }
    }
    note_cut(i >= count);
    return Samples(any_turn(turns0), any_turn(turns1), any_turn(turns2), any_turn(turns3));
}

fn visible_share(r: Receiver, head: vec4u, singles: bool) -> f32 {
    let k = looking(r);
    var covered = Samples();
    let edges = head.w & ~CROSSES;
    if (edges > 0u) { covered = hidden_as_a_whole(r, k.to, head.z, edges); }
    var chunk = head.x;
    var i = 0u;
    loop {
        if (!singles || i >= head.y) { break; }
        let o = occluder(pool[CHUNK * chunk + i % LENGTH]);
        let s = aspect(r, k, o);
        if (s.counts && !is_beside(k.own, o)) { covered = either(covered, hidden_by(r, k, o, s)); }
        i++;
        if (i % LENGTH == 0u && i < head.y) { chunk = pool[CHUNK * chunk + LENGTH]; }
    }
    note_cut(!singles || i >= head.y);
    // what is below the receiver's horizon doesn't light it; normals for shading may see it nevertheless
    let over = vec2f(dot(k.over, lamp.u.xyz), dot(k.over, lamp.v.xyz));
    let face = Samples(lamp.mask[0], lamp.mask[1], lamp.mask[2], lamp.mask[3]);
    var above = both(face, samples_inside(lamp, dot(k.over, k.to), over, vec2f(0.0)));
    if (number_in(above) == 0u) { above = face; }
    let count = number_in(above);
    return f32(count - number_in(both(above, covered))) / f32(count);
}
fn number_in(s: Samples) -> u32 {
    let four = countOneBits(s.rows0) + countOneBits(s.rows1) + countOneBits(s.rows2) + countOneBits(s.rows3);
    return four.x + four.y + four.z + four.w;
}

fn store(group: u32, k: u32, share: f32) {
    shares[light.number * receivers.count + number_of(group, k)] = share;
}

fn store_shares(what: u32, number: u32, lane: u32) {
    if (number >= atomicLoad(&counters[what])) { return; }
    let entry = queued(what, number);
    let group = entry % receivers.groups;
    let r = receiver_of(group, lane);
    if (is_in(r, entry, lane)) { store(group, lane, visible_share(r, heads[entry], what == MIXED)); }
}

@compute @workgroup_size(64)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    store_shares(ENDS, group.y * groups.x + group.x, lane);
}

// A program of its own: software drivers run what is for single occluders also where there are none.
@compute @workgroup_size(64)
fn mixed(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    store_shares(MIXED, group.y * groups.x + group.x, lane);
}

// Of a list also where receivers see all of the lamp or none.
@compute @workgroup_size(64)
fn plain(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let group = linear_id(gid, groups, 64u);
    if (group >= receivers.groups) { return; }
    for (var k = 0u; k < size_of(group); k++) {
        let state = state_of(group + select(0u, receivers.groups, is_farther(group, k)));
        let r = receiver_of(group, k);
        if (state != PENUMBRA && asks(r)) { store(group, k, select(1.0, 0.0, state == UMBRA)); }
    }
}
