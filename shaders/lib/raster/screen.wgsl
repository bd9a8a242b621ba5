// Where a corner lies in a band of rows that is being drawn, and its depth.
// `corner` is in 1/65536 px with pixel (0, 0) centred at (0, 0); depth is near / z, which is affine
// on screen, so that it is interpolated exactly; nearer is larger.
fn band_position(corner: vec2i, row0: i32, size: vec2f, depth: f32) -> vec4f {
    let at = corner - vec2i(0, row0 * 65536);
    // the centre of pixel 0 lies half a pixel inside the viewport
    let p = vec2f(at) / 65536.0 + vec2f(0.5);
    return vec4f(2.0 * p.x / size.x - 1.0, 1.0 - 2.0 * p.y / size.y, depth, 1.0);
}
