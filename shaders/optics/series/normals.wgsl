// Normals of a surface's vertices: the mean of those of the triangles at them, weighted by area.
// Described in gpusim/optics/series/normals.py.
#import lib/numeric/index
#import lib/numeric/real
#import lib/numeric/texel

struct Params {
    // triangles, or vertices
    count: u32,
    // by which sides are multiplied: areas then are numbers near 1
    scale: f32,
    // cosine of what a triangle may lean from its vertices' normals
    least: f32,
    // side of the cells of the surface's pattern
    cell: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
// three numbers a vertex
@group(0) @binding(1) var<storage, read> points: array<real>;
// three vertices a triangle
@group(0) @binding(2) var<storage, read> corners: array<u32>;
// per triangle its normal, twice as long as its area, in two texels: the nearest float32 and the first of
// what they leave, the other two. A texel is read as fast as one number of a buffer
@group(0) @binding(3) var areas: texture_storage_2d<rgba32float, write>;

fn side(to: u32, start: u32, axis: u32) -> real {
    return r_mul(r_sub(points[3u * to + axis], points[3u * start + axis]), r_f32(params.scale));
}

@compute @workgroup_size(64)
fn of_triangles(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let a = corners[3u * id];
    let b = corners[3u * id + 1u];
    let c = corners[3u * id + 2u];
    let ux = side(b, a, 0u);
    let uy = side(b, a, 1u);
    let uz = side(b, a, 2u);
    let vx = side(c, a, 0u);
    let vy = side(c, a, 1u);
    let vz = side(c, a, 2u);
    let x = r_sub(r_mul(uy, vz), r_mul(uz, vy));
    let y = r_sub(r_mul(uz, vx), r_mul(ux, vz));
    let z = r_sub(r_mul(ux, vy), r_mul(uy, vx));
    textureStore(areas, texel(2u * id), vec4f(r_high(x), r_high(y), r_high(z), r_low(x)));
    textureStore(areas, texel(2u * id + 1u), vec4f(r_low(y), r_low(z), 0.0, 0.0));
}

// the same areas; per vertex where its triangles begin in `around`
@group(0) @binding(4) var known: texture_storage_2d<rgba32float, read>;
@group(0) @binding(5) var<storage, read> start: array<u32>;
@group(0) @binding(6) var<storage, read> around: array<u32>;
// as lib/raster/vertex.wgsl reads them
@group(0) @binding(7) var vertices: texture_storage_2d<rgba32uint, write>;
// the last one: 1 if a triangle leans more
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>, 6>;

@compute @workgroup_size(64)
fn of_vertices(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = linear_id(gid, groups, 64u);
    if (id >= params.count) { return; }
    let first = start[id];
    let stop = start[id + 1u];
    var x = r_f32(0.0);
    var y = r_f32(0.0);
    var z = r_f32(0.0);
    for (var i = first; i < stop; i++) {
        let high = textureLoad(known, texel(2u * around[i]));
        let low = textureLoad(known, texel(2u * around[i] + 1u));
        x = r_add(x, r_pair(high.x, high.w));
        y = r_add(y, r_pair(high.y, low.x));
        z = r_add(z, r_pair(high.z, low.y));
    }
    // as exact as the host's: triangles whose light is just even stay so
    let length = r_sqrt(r_fma(x, x, r_fma(y, y, r_mul(z, z))));
    var mean = vec3f(0.0);
    if (r_to_f32(length) > 0.0) {
        mean = vec3f(r_to_f32(r_div(x, length)), r_to_f32(r_div(y, length)),
            r_to_f32(r_div(z, length)));
    }
    textureStore(vertices, texel(3u * id + 2u), bitcast<vec4u>(vec4f(mean, params.cell)));
    var leans = false;
    for (var i = first; i < stop; i++) {
        let area = textureLoad(known, texel(2u * around[i])).xyz;
        // also where there is no number
        leans |= !(dot(area, mean) >= params.least * sqrt(dot(area, area)) && dot(area, area) > 0.0);
    }
    if (leans) { atomicStore(&counts[5], 1u); }
}
