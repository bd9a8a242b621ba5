// y = K u of quadratic tetrahedra without K: forces element by element, then their sums node by
// node (gpusim/fem/device/tet_forces.py has twin and driver, tet_elements.py the layouts). u, the elements'
// geometry and the forces are pairs of float32; one thread per element, or per node.
#import lib/numeric/index
#import lib/numeric/texel
#import lib/numeric/real
#import lib/fem/tet10

struct Params {
    first: u32,  // element, or node in ``info``
    count: u32,
    base: u32,   // texel of the load case's first node
}

const BLOCK: u32 = 64u;
override rounded: u32 = 0u;  // 1: u is its high half

// three texels per element: its nodes, its first texel of ``roots``
@group(0) @binding(0) var cells: texture_storage_2d<rgba32uint, read>;
// five texels per element, or per quadrature point
@group(0) @binding(1) var roots: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var u_high: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var u_low: texture_2d<f32>;
// three texels per two nodes of an element
@group(0) @binding(4) var forces_out: texture_storage_2d<rgba32float, write>;
// per node: first texel of its list, texels, nothing, the node
@group(0) @binding(5) var info: texture_2d<u32>;
// twice the texel of a force, one more for the second node of two; four a texel
@group(0) @binding(6) var lists: texture_storage_2d<rgba32uint, read>;
@group(0) @binding(7) var forces: texture_storage_2d<rgba32float, read>;
@group(0) @binding(8) var k_high: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var k_low: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var<uniform> params: Params;

fn load_node(node: u32) -> Vec {
    let at = texel(params.base + node);
    let high = textureLoad(u_high, at);
    if (rounded == 1u) { return Vec(r_f32(high.x), r_f32(high.y), r_f32(high.z)); }
    let low = textureLoad(u_low, at, 0);
    return Vec(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z));
}

fn load_shape(at: u32) -> Shape {
    let a = textureLoad(roots, texel(at));
    let b = textureLoad(roots, texel(at + 1u));
    let c = textureLoad(roots, texel(at + 2u));
    let d = textureLoad(roots, texel(at + 3u));
    let e = textureLoad(roots, texel(at + 4u));
    return Shape(
        Three(Vec(r_pair(a.x, c.z), r_pair(a.y, c.w), r_pair(a.z, d.x)),
            Vec(r_pair(a.w, d.y), r_pair(b.x, d.z), r_pair(b.y, d.w)),
            Vec(r_pair(b.z, e.x), r_pair(b.w, e.y), r_pair(c.x, e.z))),
        r_pair(c.y, e.w));
}

fn store_two(at: u32, f: Vec, g: Vec) {
    textureStore(forces_out, texel(at),
        vec4f(r_high(f.x), r_high(f.y), r_high(f.z), r_low(f.x)));
    textureStore(forces_out, texel(at + 1u),
        vec4f(r_low(f.y), r_low(f.z), r_high(g.x), r_high(g.y)));
    textureStore(forces_out, texel(at + 2u),
        vec4f(r_high(g.z), r_low(g.x), r_low(g.y), r_low(g.z)));
}

fn store_forces(cell: u32, f: Nodes) {
    let at = 15u * cell;
    store_two(at, f.c0, f.c1);
    store_two(at + 3u, f.c2, f.c3);
    store_two(at + 6u, f.e01, f.e12);
    store_two(at + 9u, f.e02, f.e03);
    store_two(at + 12u, f.e13, f.e23);
}

@compute @workgroup_size(64)
fn straight(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id < params.count) { straight_cell(params.first + id); }
}

@compute @workgroup_size(64)
fn curved(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id < params.count) { curved_cell(params.first + id); }
}

fn load_force(entry: u32) -> Vec {
    let p = textureLoad(forces, texel(entry >> 1u));
    let q = textureLoad(forces, texel((entry >> 1u) + 1u));
    let second = (entry & 1u) == 1u;
    let high = select(p.xyz, vec3f(p.zw, q.x), second);
    let low = select(vec3f(p.w, q.xy), q.yzw, second);
    return Vec(r_pair(high.x, low.x), r_pair(high.y, low.y), r_pair(high.z, low.z));
}

@compute @workgroup_size(64)
fn sums(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, BLOCK);
    if (id >= params.count) { return; }
    let row = textureLoad(info, texel(params.first + id), 0);
    var sum = Vec(r_f32(0.0), r_f32(0.0), r_f32(0.0));
    for (var k = row.x; k < row.x + row.y; k++) {
        let list = textureLoad(lists, texel(k));
        sum = v_add(sum, load_force(list.x));
        sum = v_add(sum, load_force(list.y));
        sum = v_add(sum, load_force(list.z));
        sum = v_add(sum, load_force(list.w));
    }
    let at = texel(params.base + row.w);
    textureStore(k_high, at, vec4f(r_high(sum.x), r_high(sum.y), r_high(sum.z), 0.0));
    textureStore(k_low, at, vec4f(r_low(sum.x), r_low(sum.y), r_low(sum.z), 0.0));
}
