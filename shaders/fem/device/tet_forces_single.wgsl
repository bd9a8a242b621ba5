// Forces of quadratic tetrahedra in float32, for smoothing (gpusim/fem/device/tet_forces_single.py has
// twin and driver, tet_elements.py the layouts); relaxation.wgsl sums them up. One thread per element.
#import lib/numeric/index
#import lib/numeric/texel
#import lib/numeric/real_f32
#import lib/fem/tet10

struct Params {
    first: u32,  // element
    count: u32,
    base: u32,   // texel of the load case's first node
}

const BLOCK: u32 = 64u;

// three texels per element: its nodes, its first texel of ``roots``
@group(0) @binding(0) var cells: texture_storage_2d<rgba32uint, read>;
// five texels per element, or per quadrature point
@group(0) @binding(1) var roots: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var x_in: texture_storage_2d<rgba32float, read>;
// three texels per two nodes of an element, of which this takes two
@group(0) @binding(3) var forces_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Params;

fn load_node(node: u32) -> Vec {
    let x = textureLoad(x_in, texel(params.base + node));
    return Vec(x.x, x.y, x.z);
}

fn load_shape(at: u32) -> Shape {
    let a = textureLoad(roots, texel(at));
    let b = textureLoad(roots, texel(at + 1u));
    let c = textureLoad(roots, texel(at + 2u));
    return Shape(Three(Vec(a.x, a.y, a.z), Vec(a.w, b.x, b.y), Vec(b.z, b.w, c.x)), c.y);
}

fn store(at: u32, f: Vec) { textureStore(forces_out, texel(at), vec4f(f.x, f.y, f.z, 0.0)); }

fn store_forces(cell: u32, f: Nodes) {
    let at = 15u * cell;
    store(at, f.c0);
    store(at + 1u, f.c1);
    store(at + 3u, f.c2);
    store(at + 4u, f.c3);
    store(at + 6u, f.e01);
    store(at + 7u, f.e12);
    store(at + 9u, f.e02);
    store(at + 10u, f.e03);
    store(at + 12u, f.e13);
    store(at + 13u, f.e23);
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
