// Forces of one quadratic tetrahedron, the only element that the device knows, in the arithmetic of the `real` that the importer names,
// which also has ``cells`` (three texels per element: its nodes, its first texel of ``roots``),
// load_node, load_shape and store_forces.
//
// Its displacement gradient in reference coordinates is linear in place: four values at the
// corners say all. With a share t of their sum added to each they become the values at the four
// quadrature points (Zienkiewicz & Taylor, vol. 1, 2000, table 5.3), as multiples of 1 / sqrt(5);
// the same turns what the points give back into the corners' share. Where the Jacobian is
// constant, t = 1 once does what t = GAMMA does before and after.
struct Vec {
    x: real,
    y: real,
    z: real,
}

// derivatives by (or forces that belong to) the three reference coordinates
struct Three {
    a: Vec,
    b: Vec,
    c: Vec,
}

// at the four corners, or the four points
struct Corners {
    a: Three,
    b: Three,
    c: Three,
    d: Three,
}

// displacements of the nodes in VTK's order, those behind the first one less that of the first;
// or nodal forces
struct Nodes {
    c0: Vec,
    c1: Vec,
    c2: Vec,
    c3: Vec,
    e01: Vec,
    e12: Vec,
    e02: Vec,
    e03: Vec,
    e13: Vec,
    e23: Vec,
}

// ``g`` has the gradients of the reference coordinates times the root of shear modulus and volume,
// ``ratio`` is Lame's first modulus over the shear modulus
struct Shape {
    g: Three,
    ratio: real,
}

fn v_add(p: Vec, q: Vec) -> Vec { return Vec(r_add(p.x, q.x), r_add(p.y, q.y), r_add(p.z, q.z)); }
fn v_sub(p: Vec, q: Vec) -> Vec { return Vec(r_sub(p.x, q.x), r_sub(p.y, q.y), r_sub(p.z, q.z)); }
fn v_mul(s: real, p: Vec) -> Vec { return Vec(r_mul(s, p.x), r_mul(s, p.y), r_mul(s, p.z)); }
fn v_dot(p: Vec, q: Vec) -> real { return r_fma(p.x, q.x, r_fma(p.y, q.y, r_mul(p.z, q.z))); }

fn three_add(p: Three, q: Three) -> Three {
    return Three(v_add(p.a, q.a), v_add(p.b, q.b), v_add(p.c, q.c));
}

fn three_fma(t: real, p: Three, q: Three) -> Three {
    return Three(v_add(v_mul(t, p.a), q.a), v_add(v_mul(t, p.b), q.b), v_add(v_mul(t, p.c), q.c));
}

// (sqrt(5) - 1) / 4
fn gamma() -> real { return r_pair(0.30901700258255005, -8.207603e-9); }

// derivatives of the displacement by the reference coordinates, at the corners
fn corner_derivatives(u: Nodes) -> Corners {
    let four = r_f32(4.0);
    let three = r_f32(3.0);
    let e01 = v_mul(four, u.e01);
    let e12 = v_mul(four, u.e12);
    let e02 = v_mul(four, u.e02);
    let e03 = v_mul(four, u.e03);
    let e13 = v_mul(four, u.e13);
    let e23 = v_mul(four, u.e23);
    return Corners(
        Three(v_sub(e01, u.c1), v_sub(e02, u.c2), v_sub(e03, u.c3)),
        Three(v_sub(v_mul(three, u.c1), e01), v_sub(v_sub(e12, u.c2), e01),
            v_sub(v_sub(e13, u.c3), e01)),
        Three(v_sub(v_sub(e12, u.c1), e02), v_sub(v_mul(three, u.c2), e02),
            v_sub(v_sub(e23, u.c3), e02)),
        Three(v_sub(v_sub(e13, u.c1), e03), v_sub(v_sub(e23, u.c2), e03),
            v_sub(v_mul(three, u.c3), e03)));
}

fn spread(h: Corners, t: real) -> Corners {
    let sum = three_add(three_add(h.a, h.b), three_add(h.c, h.d));
    return Corners(three_fma(t, sum, h.a), three_fma(t, sum, h.b), three_fma(t, sum, h.c),
        three_fma(t, sum, h.d));
}

fn by_place(x: real, y: real, z: real, g: Three) -> Vec {
    return Vec(r_fma(x, g.a.x, r_fma(y, g.b.x, r_mul(z, g.c.x))),
        r_fma(x, g.a.y, r_fma(y, g.b.y, r_mul(z, g.c.y))),
        r_fma(x, g.a.z, r_fma(y, g.b.z, r_mul(z, g.c.z))));
}

// what derivatives ``h`` at a point give back
fn point_forces(h: Three, shape: Shape) -> Three {
    let g = shape.g;
    // gradients of the displacement's components
    let x = by_place(h.a.x, h.b.x, h.c.x, g);
    let y = by_place(h.a.y, h.b.y, h.c.y, g);
    let z = by_place(h.a.z, h.b.z, h.c.z, g);
    let swelling = r_mul(shape.ratio, r_add(r_add(x.x, y.y), z.z));
    let xy = r_add(x.y, y.x);
    let xz = r_add(x.z, z.x);
    let yz = r_add(y.z, z.y);
    let sx = Vec(r_add(swelling, r_add(x.x, x.x)), xy, xz);
    let sy = Vec(xy, r_add(swelling, r_add(y.y, y.y)), yz);
    let sz = Vec(xz, yz, r_add(swelling, r_add(z.z, z.z)));
    return Three(Vec(v_dot(sx, g.a), v_dot(sy, g.a), v_dot(sz, g.a)),
        Vec(v_dot(sx, g.b), v_dot(sy, g.b), v_dot(sz, g.b)),
        Vec(v_dot(sx, g.c), v_dot(sy, g.c), v_dot(sz, g.c)));
}

fn three_sum(p: Three) -> Vec { return v_add(v_add(p.a, p.b), p.c); }

// the transpose of ``corner_derivatives``
fn nodal_forces(b: Corners) -> Nodes {
    let four = r_f32(4.0);
    let all = three_add(three_add(b.a, b.b), three_add(b.c, b.d));
    return Nodes(
        v_sub(three_sum(all), v_mul(four, three_sum(b.a))),
        v_sub(v_mul(four, b.b.a), all.a),
        v_sub(v_mul(four, b.c.b), all.b),
        v_sub(v_mul(four, b.d.c), all.c),
        v_mul(four, v_sub(b.a.a, three_sum(b.b))),
        v_mul(four, v_add(b.c.a, b.b.b)),
        v_mul(four, v_sub(b.a.b, three_sum(b.c))),
        v_mul(four, v_sub(b.a.c, three_sum(b.d))),
        v_mul(four, v_add(b.d.a, b.b.c)),
        v_mul(four, v_add(b.d.b, b.c.c)));
}

fn load_nodes(a: vec4u, b: vec4u, c: vec4u) -> Nodes {
    let own = load_node(a.x);
    return Nodes(own,
        v_sub(load_node(a.y), own), v_sub(load_node(a.z), own), v_sub(load_node(a.w), own),
        v_sub(load_node(b.x), own), v_sub(load_node(b.y), own), v_sub(load_node(b.z), own),
        v_sub(load_node(b.w), own), v_sub(load_node(c.x), own), v_sub(load_node(c.y), own));
}

// an element whose midsides lie in the middle: one Jacobian
fn straight_cell(cell: u32) {
    let a = textureLoad(cells, texel(3u * cell));
    let b = textureLoad(cells, texel(3u * cell + 1u));
    let c = textureLoad(cells, texel(3u * cell + 2u));
    let shape = load_shape(c.z);
    let h = spread(corner_derivatives(load_nodes(a, b, c)), r_f32(1.0));
    store_forces(cell, nodal_forces(Corners(point_forces(h.a, shape), point_forces(h.b, shape),
        point_forces(h.c, shape), point_forces(h.d, shape))));
}

// any other: one per quadrature point
fn curved_cell(cell: u32) {
    let a = textureLoad(cells, texel(3u * cell));
    let b = textureLoad(cells, texel(3u * cell + 1u));
    let c = textureLoad(cells, texel(3u * cell + 2u));
    let h = spread(corner_derivatives(load_nodes(a, b, c)), gamma());
    let f = Corners(point_forces(h.a, load_shape(c.z)), point_forces(h.b, load_shape(c.z + 5u)),
        point_forces(h.c, load_shape(c.z + 10u)), point_forces(h.d, load_shape(c.z + 15u)));
    store_forces(cell, nodal_forces(spread(f, gamma())));
}
