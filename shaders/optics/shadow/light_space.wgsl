// A lamp's light space: p and q, places across the lamp's axis over the distance w along it, and
// s = 1 / w. A ray from a receiver X to the point l of the lamp runs along p = p_X + l (s - s_X), and
// planes stay planes. That of a far lamp has the places themselves, and s against the light's way.
// All positions are relative to the eye. The NumPy form is gpusim/optics/shadow/light_space.py.
#import lib/numeric/texel

struct LightSpace {
    centre: vec4f,   // w: 1, or 0 of a far lamp, whose centre is none
    across: vec4f,   // unit; w: half the lamp's size along it
    along: vec4f,
    axis: vec4f,     // unit, the way that it shines; w: where the space begins before the lamp
    rounding: f32,   // of a length
    tolerance: f32,  // a face hides nothing nearer to its plane, per distance from the eye
    terminator: f32, // sine by which receivers may be turned away and ask nevertheless
    number: u32,     // of the lamp
    sheets: u32,     // bits of open surfaces whose border winds once at most round any ray
}
@group(0) @binding(0) var<uniform> light: LightSpace;
// four texels per triangle: corners (w of the first one: 0, or of an open surface its number from 1 on), and the plane:
// unit normal, offset from the eye
@group(0) @binding(1) var occluders: texture_storage_2d<rgba32float, read>;

const UNLIMITED: f32 = 1e18;
// Share of a length that float32 rounds by, and of directions: some units in the last place.
const ANGLE: f32 = 1e-6;

fn is_near() -> bool { return light.centre.w > 0.0; }

// Distance along the axis; of a far lamp any is before it.
fn ahead(x: vec3f) -> f32 { return dot(light.axis.xyz, x - light.centre.xyz); }

fn to_light_space(x: vec3f) -> vec3f {
    let y = x - light.centre.xyz;
    return place_in_frame(vec3f(dot(light.across.xyz, y), dot(light.along.xyz, y), dot(light.axis.xyz, y)));
}
// Of a place from the lamp's middle along its axes.
fn place_in_frame(y: vec3f) -> vec3f {
    // receivers may look from beside the lamp's plane
    let s = 1.0 / max(y.z, 1e-3 * light.axis.w);
    return select(vec3f(y.xy, -y.z), vec3f(y.xy * s, s), is_near());
}

// How far rounding moves a place in light space.
fn rounding_at(at: vec3f) -> vec3f {
    let near = at.z * vec3f(1.0 + abs(at.xy), at.z);
    return light.rounding * select(vec3f(1.0), near, is_near());
}

// A length, as functions of light space have it at some s.
fn scaled(length: f32, s: f32) -> f32 { return length * select(1.0, s, is_near()); }

// Distance below a face within which a near lamp lies on it, and isn't hidden by it.
fn on_face() -> f32 { return 4.0 * light.rounding; }

// A plane as a function of p, q and s: the height over it, `scaled`. z: the height of the lamp.
fn plane_in_light_space(plane: vec4f) -> vec4f {
    let u = dot(plane.xyz, light.across.xyz);
    let v = dot(plane.xyz, light.along.xyz);
    let a = dot(plane.xyz, light.axis.xyz);
    let c = dot(plane.xyz, light.centre.xyz) - plane.w;
    return select(vec4f(u, v, -a, -plane.w), vec4f(u, v, c, a), is_near());
}

// How much the height of the lamp's points over a plane differs from that of its middle at most.
fn lamp_extent(plane: vec4f) -> f32 {
    return light.across.w * abs(plane.x) + light.along.w * abs(plane.y);
}

struct Occluder {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    open: bool,
    sheet: f32,      // number of the open surface that it is of, or 0
    plane: vec4f,
}
// Number of the open surface that a triangle is of, or 0.
fn surface_of(i: u32) -> u32 {
    let surface = u32(textureLoad(occluders, texel(4u * select(i, 0u, i == NOBODY))).w);
    return select(surface, 0u, i == NOBODY || surface > SHEETS);
}
fn occluder(i: u32) -> Occluder {
    let a = textureLoad(occluders, texel(4u * i));
    return Occluder(
        a.xyz, textureLoad(occluders, texel(4u * i + 1u)).xyz,
        textureLoad(occluders, texel(4u * i + 2u)).xyz, a.w > 0.0, a.w,
        textureLoad(occluders, texel(4u * i + 3u)),
    );
}

// What a node's word holds: the way its triangles face the lamp, and whether all in it and around it
// do so; OPEN: these are of open surfaces; CLOSED: some are of closed ones.
const NONE: u32 = 0u;       // hides nothing: of a closed body, and lit by all of the lamp
const AWAY: u32 = 1u;       // turned away from all of the lamp
const TOWARDS: u32 = 2u;    // of an open surface, turned to all of it
const SPLIT: u32 = 3u;      // its plane meets the lamp
const SPLIT_OPEN: u32 = 4u;
const AWAY_OPEN: u32 = 5u;
const CROSSING: u32 = 6u;   // it passes through the lamp's plane
const KIND: u32 = 7u;
const UNIFORM: u32 = 8u;
const OPEN: u32 = 16u;
const CLOSED: u32 = 32u;
// times the number of the open surface that all in it are of
const SHEET: u32 = 64u;
const SHEETS: u32 = 32u;    // surfaces that have a number
fn sheet_of(word: u32) -> u32 { return word / SHEET; }
const NOBODY: u32 = 0xffffffffu;
