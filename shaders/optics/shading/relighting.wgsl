// Pixels that don't see all of every lamp: their light again, with its visible shares.
// What forward_pass.wgsl found is scaled by how much less light matte surfaces get; with glossy ones in view
// it left the paint's albedo in `marks`. Driven by gpusim/optics/shading/relighting.py; the NumPy form is
// `Lighting.reflect` in gpusim/optics/shading/lighting.py.
#import lib/numeric/index
#import lib/light/lamp_shares
#import lib/light/surface
#import lib/raster/planes
#import lib/raster/undistortion_table

// whether all is matte
override scaled: u32;

struct Params {
    rays: Rays,
    width: u32,
    rows: u32,
    stride: u32,
    row0: i32,
    casting: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
// triangle + 1 of every pixel of the band and, unless `scaled`, its albedo in 1 / 2^32
@group(0) @binding(6) var marks: texture_2d<u32>;

// tiles of 8 x 8 px with such pixels, and their number
@group(0) @binding(7) var<storage, read_write> listed: array<u32>;
@group(0) @binding(8) var<storage, read_write> counters: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> groups_of: array<u32>;

// per lamp, of the nearer half of each tile and then of the farther: all of it is seen, nothing, or a
// share; per tile bits of the pixels in its farther half (optics/shadow)
@group(0) @binding(70) var<storage, read> states: array<u32>;
@group(0) @binding(71) var<storage, read> halves: array<u32>;
const UMBRA: u32 = 1u;
const PENUMBRA: u32 = 2u;

fn columns() -> u32 { return (params.width + 7u) / 8u; }
fn tiles_of_band() -> u32 { return columns() * ((params.rows + 7u) / 8u); }

fn known_at(tile: u32, at: vec2u, k: u32) -> Known {
    let farther = (halves[2u * tile + (k >> 5u)] >> (k & 31u)) & 1u;
    var known = Known(at.y * params.width + at.x, params.width * params.rows, 0u, 0u);
    for (var left = params.casting; left != 0u; left &= left - 1u) {
        let lamp = firstTrailingBit(left);
        let state = states[(2u * lamp + farther) * tiles_of_band() + tile];
        known.listed |= select(0u, 1u << lamp, state == PENUMBRA);
        known.dark |= select(0u, 1u << lamp, state == UMBRA);
    }
    return known;
}

// Software drivers run what a branch leaves out as well: tiles are listed, not left early.
@compute @workgroup_size(64)
fn list_tiles(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let tile = linear_id(gid, groups, 64u);
    if (tile >= tiles_of_band()) { return; }
    var hidden = 0u;
    for (var left = params.casting; left != 0u; left &= left - 1u) {
        let first = 2u * firstTrailingBit(left) * tiles_of_band() + tile;
        hidden |= states[first] | states[first + tiles_of_band()];
    }
    if (hidden != 0u) { listed[atomicAdd(&counters[0], 1u)] = tile; }
}

@compute @workgroup_size(1)
fn count_tiles() {
    let count = atomicLoad(&counters[0]);
    groups_of[0] = min(count, 32768u);
    groups_of[1] = (count + 32767u) / 32768u;
    groups_of[2] = 1u;
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group.y * groups.x + group.x;
    if (number >= atomicLoad(&counters[0])) { return; }
    let tile = listed[number];
    let at = 8u * vec2u(tile % columns(), tile / columns()) + local.xy;
    if (at.x >= params.width || at.y >= params.rows) { return; }
    let mark = textureLoad(marks, at, 0);
    if (mark.x == 0u) { return; }
    let pixel = vec2i(at) + vec2i(0, params.row0);
    let t = triangle_at(mark.x - 1u);
    let shift = undistort(bend_at(pixel), vec2f(0.0));
    let s = spot(t, params.rays, vec2f(pixel) + shift, vec2f(pixel - t.place.xy) + shift);
    let lit = reflection_known(s.x, s.n, gloss_at(t, s), openness_at(t.id, s.x), known_at(tile, at, lane));
    let i = at.y * params.stride + at.x;
    let shiny = glossy != 0u && t.more.z < 1.0;
    if (scaled != 0u || !(MATTE_MARKED || shiny)) {
        set_radiance(i, radiance_at(i) * select(Color(0.0), lit.r.matte / lit.whole, lit.whole > Color(0.0)));
        return;
    }
    let own = mark_of(mark, shiny);
    let ground = select(ground_of(t), own.albedo, t.more.y > 1.0);
    set_radiance(i, radiance_of(t, lit.r, own.albedo, ground, own.bare));
}
