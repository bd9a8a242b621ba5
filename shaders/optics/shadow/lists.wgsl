// Lists of each entry in chunks of a pool: 31 words, and the number of the chunk that goes on. Which
// chunks a list has depends on the order of work, what it holds doesn't.
#import optics/shadow/receiver

const LENGTH: u32 = 31u;
const CHUNK: u32 = 32u;

@group(0) @binding(20) var<storage, read_write> pool: array<u32>;
// occluders that are looked at alone: first chunk, number; ends of what hides as a whole: first chunk,
// number, and CROSSES if some of them may cross the lamp
@group(0) @binding(21) var<storage, read_write> heads: array<vec4u>;
const CROSSES: u32 = 0x80000000u;
// an end is an edge: 4 x triangle + place among its edges, and TURNED if it is wound the other way
const TURNED: u32 = 0x80000000u;
// entries to sift, behind as many words as there are entries those to refine, then those in penumbra by ends
// alone, and those in that of single occluders, too
@group(0) @binding(22) var<storage, read_write> work: array<u32>;
// chunks taken, and the numbers of these entries
@group(0) @binding(23) var<storage, read_write> counters: array<atomic<u32>>;
const TAKEN: u32 = 0u;
const SIFTED: u32 = 1u;
const REFINED: u32 = 2u;
const ENDS: u32 = 3u;
const MIXED: u32 = 4u;
// … and threads whose loops were cut short: llvmpipe ends all loops of a thread after 65,535 turns in all
const CUT: u32 = 5u;
fn note_cut(whole: bool) { if (!whole) { atomicAdd(&counters[CUT], 1u); } }

fn entries() -> u32 { return 2u * receivers.groups; }
// One more entry of a kind; and the one with a number among these.
fn enqueue(what: u32, entry: u32) {
    work[(what - 1u) * entries() + atomicAdd(&counters[what], 1u)] = entry;
}
fn queued(what: u32, number: u32) -> u32 { return work[(what - 1u) * entries() + number]; }

// one lamp after the other, per entry: 0 it sees all of the lamp, 1 none, 2 in part
@group(0) @binding(24) var<storage, read_write> states: array<u32>;
const LIT: u32 = 0u;
const UMBRA: u32 = 1u;
const PENUMBRA: u32 = 2u;
fn say(entry: u32, state: u32) { states[light.number * entries() + entry] = state; }
fn state_of(entry: u32) -> u32 { return states[light.number * entries() + entry]; }
