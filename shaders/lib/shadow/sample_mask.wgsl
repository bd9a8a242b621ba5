// Samples on a lamp's face: those on one side of a plane through a receiver, as bits of 16 rows of 32.
// The NumPy form is gpusim/optics/shadow/sample_mask.py, which explains the lattice, and of what lies on
// one side `EdgeFunctions.hidden` in gpusim/optics/shadow/brute_force.py.

// centre (w: 1 if it is near, 0 for a direction), half sides u (w: 1 if it has a size, else a
// direction across its axis) and v, samples on its face.
struct LampFace {
    centre: vec4f,
    u: vec4f,
    v: vec4f,
    mask: array<vec4u, 4>,
}
// Of four rows of samples a and b of the first ones, and the pixel offset in x that they look from.
// Constants: in a loop, uniforms are loaded again and again.
struct SampleRows {
    a: vec4f,
    b: vec4f,
    x: vec4f,
}
const ROWS0 = SampleRows(
    (vec4f(14.0, 8.0, 2.0, 12.0) + 0.5) / 256.0 - 1.0,
    (vec4f(0.0, 2.0, 4.0, 6.0) + 0.015625) / 8.0 - 1.0,
    (vec4f(13.0, 8.0, 1.0, 15.0) + 0.5) / 16.0 - 0.5,
);
const ROWS1 = SampleRows(
    (vec4f(6.0, 0.0, 10.0, 4.0) + 0.5) / 256.0 - 1.0,
    (vec4f(8.0, 10.0, 12.0, 14.0) + 0.015625) / 8.0 - 1.0,
    (vec4f(4.0, 6.0, 14.0, 2.0) + 0.5) / 16.0 - 0.5,
);
const ROWS2 = SampleRows(
    (vec4f(11.0, 5.0, 15.0, 9.0) + 0.5) / 256.0 - 1.0,
    (vec4f(1.0, 3.0, 5.0, 7.0) + 0.015625) / 8.0 - 1.0,
    (vec4f(3.0, 9.0, 12.0, 7.0) + 0.5) / 16.0 - 0.5,
);
const ROWS3 = SampleRows(
    (vec4f(3.0, 13.0, 7.0, 1.0) + 0.5) / 256.0 - 1.0,
    (vec4f(9.0, 11.0, 13.0, 15.0) + 0.015625) / 8.0 - 1.0,
    (vec4f(0.0, 10.0, 5.0, 11.0) + 0.5) / 16.0 - 0.5,
);
const STEP_A: f32 = 0.0625;
const STEP_B: f32 = 0.00390625;

// The samples of four rows inside of an edge, where value + a A + b B + x X >= 0. On the way along a
// row that grows by `slope`, of which `inverse` is -1 / slope; `falling` has all bits where it falls.
fn inside_edge(
    value: f32, a: f32, b: f32, x: f32, inverse: f32, falling: u32, rows: SampleRows,
) -> vec4u {
    let cut = inverse * (vec4f(value) + a * rows.a + b * rows.b + x * rows.x);
    let first = vec4u(ceil(clamp(cut, vec4f(0.0), vec4f(32.0))));
    let after = select(vec4u(0xffffffffu) << (first & vec4u(31u)), vec4u(0u), first >= vec4u(32u));
    return after ^ vec4u(falling);
}

// The samples of all rows on the positive side of a plane through the receiver that turns about `way`
// as the receiver moves, of a `normal` as long as that is.
struct Samples {
    rows0: vec4u,
    rows1: vec4u,
    rows2: vec4u,
    rows3: vec4u,
}
fn samples_of(lamp: LampFace, to: vec3f, normal: vec3f, way: vec3f, dx: vec3f, dy: vec3f) -> Samples {
    let turned = cross(to, way) - lamp.centre.w * normal;
    return samples_inside(
        lamp, dot(normal, to), vec2f(dot(normal, lamp.u.xyz), dot(normal, lamp.v.xyz)),
        vec2f(dot(turned, dx), dot(turned, dy)),
    );
}
// Where a `value` in the middle of lamp and pixel isn't negative that grows by so much along the lamp's
// half sides and over the pixel. Where the sample lattice is on the lamp, it is in part on the pixel.
fn samples_inside(lamp: LampFace, value: f32, along_lamp: vec2f, over_pixel: vec2f) -> Samples {
    let extended = lamp.u.w != 0.0;
    let a = select(0.5 * over_pixel.x, along_lamp.x, extended);
    let b = select(0.5 * over_pixel.y, along_lamp.y, extended);
    let along = select(0.0, 0.5 * over_pixel.y, extended);
    let across = select(0.0, over_pixel.x, extended);
    // the last two groups of rows run the other way along a lamp with a size
    let forth = a + along;
    let back = select(a, -a, extended) + along;
    let slope = STEP_A * vec2f(forth, back) + STEP_B * b;
    // an edge along the rows lies before or behind all of their samples
    let inverse = select(vec2f(-1e30), -1.0 / slope, slope != vec2f(0.0));
    let falling = select(vec2u(0u), vec2u(0xffffffffu), slope < vec2f(0.0));
    return Samples(
        inside_edge(value, forth, b, across, inverse.x, falling.x, ROWS0),
        inside_edge(value, forth, b, across, inverse.x, falling.x, ROWS1),
        inside_edge(value, back, b, across, inverse.y, falling.y, ROWS2),
        inside_edge(value, back, b, across, inverse.y, falling.y, ROWS3),
    );
}
