// Linear thread id of a one-dimensional grid that was folded into two dimensions
// (at most 65535 workgroups fit in one); `width` is the workgroup's size in x.
fn linear_id(gid: vec3u, groups: vec3u, width: u32) -> u32 {
    return gid.y * (groups.x * width) + gid.x;
}
