// Which rows of a buffer that was split at the binding limit this dispatch works on.
// The layer fills it: rows [first, first + count) of the whole.
struct Part {
    first: u32,
    count: u32,
}
@group(2) @binding(0) var<uniform> part: Part;
