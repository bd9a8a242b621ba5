// Linear thread id of a one-dimensional grid that was folded into two dimensions
// (at most 65535 workgroups fit in one); `width` is the workgroup's size in x.
fn linear_id(gid: vec3u, groups: vec3u, width: u32) -> u32 {
    return gid.y * (groups.x * width) + gid.x;
}

// Row (x) and load case (y) of a thread: as many rows as a workgroup is wide take all load cases, one
// workgroup after the other, so that what is read of the rows comes from memory once and from a
// cache for the other cases. The last rows may be beyond the end.
fn row_and_case(id: u32, cases: u32, width: u32) -> vec2u {
    let group = id / width;
    return vec2u((group / cases) * width + id % width, group % cases);
}
