//! Transfer against exact solutions, both ways against each other, and what the command says.

use std::f64::consts::PI;
use std::path::Path;

use faer::c64;
use freshet_host::transfer::Point;
use freshet_host::transfer::multipoles::Multipoles;
use freshet_host::transfer::shape::Shape;
use freshet_host::transfer::solver::Solver;
use freshet_host::transfer::vessel::Vessel;

/// Terms of a series: far more than kL = 10 asks for.
const TERMS: usize = 60;

/// Spherical Bessel functions j_l(z) and h_l⁽²⁾(z) = j_l − i y_l, with their derivatives.
struct Spherical {
    j: Vec<f64>,
    dj: Vec<f64>,
    h: Vec<c64>,
    dh: Vec<c64>,
}

impl Spherical {
    fn new(z: f64) -> Self {
        // Miller: downwards from where it does not matter, then to the scale of j_0 or j_1.
        let start = TERMS + 40 + z as usize;
        let mut j = vec![0.0; start + 2];
        j[start] = 1e-200;
        for l in (1..=start).rev() {
            j[l - 1] = (2 * l + 1) as f64 / z * j[l] - j[l + 1];
            if j[l - 1].abs() > 1e200 {
                j[l - 1..].iter_mut().for_each(|x| *x *= 1e-250);
            }
        }
        let (j0, j1) = (z.sin() / z, z.sin() / (z * z) - z.cos() / z);
        let scale = if j0.abs() > j1.abs() {
            j0 / j[0]
        } else {
            j1 / j[1]
        };
        j.iter_mut().for_each(|x| *x *= scale);
        let mut y = vec![-z.cos() / z, -z.cos() / (z * z) - z.sin() / z];
        for l in 1..=TERMS {
            y.push((2 * l + 1) as f64 / z * y[l] - y[l - 1]);
        }
        let slope = |f: &[f64], l: usize| l as f64 / z * f[l] - f[l + 1];
        let dj: Vec<f64> = (0..TERMS).map(|l| slope(&j, l)).collect();
        Spherical {
            h: (0..TERMS).map(|l| c64::new(j[l], -y[l])).collect(),
            dh: (0..TERMS).map(|l| c64::new(dj[l], -slope(&y, l))).collect(),
            dj,
            j,
        }
    }
}

fn legendre(x: f64) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for l in 1..TERMS {
        p.push(((2 * l + 1) as f64 * x * p[l] - l as f64 * p[l - 1]) / (l + 1) as f64);
    }
    p
}

fn norm(a: Point) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn cosine(a: Point, b: Point) -> f64 {
    let dot: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
    dot / (norm(a) * norm(b)).max(1e-300)
}

fn wavenumbers(frequency: f64) -> (f64, f64) {
    (2.0 * PI * frequency / 1497.0, 2.0 * PI * frequency / 343.0)
}

/// P/S_b of a bubble in a spherical drop: Dirichlet inside, the modes of the sphere outside.
fn drop_series(radius: f64, bubble: Point, ear: Point, frequency: f64) -> c64 {
    let (kw, ka) = wavenumbers(frequency);
    let p = legendre(cosine(bubble, ear));
    let (inside, surface) = (
        Spherical::new((kw * norm(bubble)).max(1e-9)),
        Spherical::new(kw * radius),
    );
    let (outside, far) = (Spherical::new(ka * radius), Spherical::new(ka * norm(ear)));
    let terms = if norm(bubble) == 0.0 { 1 } else { TERMS };
    (0..terms)
        .map(|l| {
            // Flow through the surface, then the pressure it makes.
            let flow =
                (2 * l + 1) as f64 / (4.0 * PI * radius * radius) * inside.j[l] / surface.j[l];
            far.h[l] / (outside.dh[l] * ka) * flow * p[l]
        })
        .take_while(|term| term.re.is_finite())
        .sum()
}

/// The pressure of a unit source at `from` with a rigid sphere at the origin.
fn sphere_series(radius: f64, from: Point, at: Point, frequency: f64) -> c64 {
    let (_, k) = wavenumbers(frequency);
    let p = legendre(cosine(from, at));
    let (source, field) = (Spherical::new(k * norm(from)), Spherical::new(k * norm(at)));
    let surface = Spherical::new(k * radius);
    let scattered: c64 = (0..TERMS)
        .map(|l| {
            let radial = source.h[l] * field.h[l] / surface.dh[l] * surface.dj[l];
            radial * c64::new(0.0, k / (4.0 * PI) * (2 * l + 1) as f64) * p[l]
        })
        .take_while(|term| term.re.is_finite())
        .sum();
    let apart = norm([0, 1, 2].map(|axis| from[axis] - at[axis]));
    scattered + c64::new(0.0, -k * apart).exp() / (4.0 * PI * apart)
}

fn off(found: c64, exact: c64) -> f64 {
    (found - exact).norm() / exact.norm()
}

fn shape(text: &str) -> Shape {
    let vessel = Vessel::parse("test", text, Path::new(".")).unwrap();
    vessel.shape().unwrap()
}

fn built_in(name: &str) -> Vessel {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vessels");
    Vessel::open(&root.join(name).with_extension("toml")).unwrap()
}

fn refusal<T>(result: anyhow::Result<T>) -> String {
    match result {
        Ok(_) => panic!("accepted"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn a_bubble_in_a_drop_sounds_as_the_series_says() {
    // k_a L up to 8.7, k_w L up to 2, L the diameter.
    let drop = built_in("drop").shape().unwrap();
    let radius = 0.05;
    let ear = [0.3, 0.2, 0.9];
    for frequency in [300.0, 2_000.0, 4_740.0] {
        let solver = Solver::new(&drop, frequency).unwrap();
        let field = solver.hear(ear).unwrap();
        // At 0, 0.5 and 0.8 of the radius.
        for (bubble, goal) in [
            ([0.0; 3], 0.005),
            ([0.025, 0.0, 0.0], 0.01),
            ([0.01, -0.03, 0.024_494_9], 0.01),
        ] {
            let exact = drop_series(radius, bubble, ear, frequency);
            let adjoint = field.at(&[bubble]).unwrap()[0];
            let sound = solver.sound(bubble).unwrap();
            let direct = sound.at(&[ear]).unwrap()[0];
            println!(
                "{frequency} Hz {bubble:?}: adjoint {:.5}, direct {:.5}",
                off(adjoint, exact),
                off(direct, exact)
            );
            assert!(off(adjoint, exact) < goal && off(direct, exact) < goal);
        }
        // A tenth of the radius below the surface, less than an edge.
        let bubble = [0.045, 0.0, 0.0];
        let exact = drop_series(radius, bubble, ear, frequency);
        let adjoint = off(field.at(&[bubble]).unwrap()[0], exact);
        let direct = off(solver.sound(bubble).unwrap().at(&[ear]).unwrap()[0], exact);
        println!("{frequency} Hz {bubble:?}: adjoint {adjoint:.5}, direct {direct:.5}");
        assert!(adjoint < 0.02 && direct < 0.02);
    }
}

#[test]
fn a_rigid_sphere_scatters_as_the_series_says() {
    let drop = built_in("drop").shape().unwrap();
    let from = [0.3, 0.2, 0.9];
    // 3430 Hz is an irregular frequency of the plain equation: k_a times the radius is π.
    for frequency in [300.0, 3_430.0, 4_740.0] {
        let solver = Solver::new(&drop, frequency).unwrap();
        let field = solver.hear(from).unwrap();
        for at in [[0.06, 0.0, 0.0], [0.0, 0.1, -0.3], [-0.5, -0.4, -1.0]] {
            let exact = sphere_series(0.05, from, at, frequency);
            let found = off(field.in_air(at).unwrap(), exact);
            println!("{frequency} Hz {at:?}: {found:.5}");
            assert!(found < 0.01);
        }
    }
}

/// Rayleigh's integral over a plane, by the midpoint rule in rings around the point above the bubble.
fn plane_by_rings(bubble: Point, ear: Point, frequency: f64) -> c64 {
    let (kw, ka) = wavenumbers(frequency);
    let depth = -bubble[2];
    let i = c64::new(0.0, 1.0);
    let mut sum = c64::new(0.0, 0.0);
    // ρ = depth·sinh u, out to where the flow has fallen by 1e5.
    let (steps, around) = (1_500, 120);
    let reach = 2e3f64.asinh();
    for step in 0..steps {
        let u = reach * (step as f64 + 0.5) / steps as f64;
        let rho = depth * u.sinh();
        let width = depth * u.cosh() * reach / steps as f64;
        let r = rho.hypot(depth);
        let flow = (i * (kw * r) + 1.0) * (-i * (kw * r)).exp() * (depth / (2.0 * PI * r.powi(3)));
        for part in 0..around {
            let angle = 2.0 * PI * part as f64 / around as f64;
            let away = [
                ear[0] - bubble[0] - rho * angle.cos(),
                ear[1] - bubble[1] - rho * angle.sin(),
                ear[2],
            ];
            let far = norm(away);
            let area = rho * width * 2.0 * PI / around as f64;
            sum -= flow * (-i * (ka * far)).exp() * (area / (2.0 * PI * far));
        }
    }
    sum
}

#[test]
fn a_pool_sounds_as_rayleighs_integral_says() {
    let pool = built_in("pool").shape().unwrap();
    let (bubble, ear) = ([0.02, -0.01, -0.03], [0.3, 0.2, 0.5]);
    for frequency in [200.0, 1_500.0, 6_000.0] {
        let solver = Solver::new(&pool, frequency).unwrap();
        let found = solver.hear(ear).unwrap().at(&[bubble]).unwrap()[0];
        let exact = plane_by_rings(bubble, ear, frequency);
        println!("{frequency} Hz: {:.5}", off(found, exact));
        assert!(off(found, exact) < 0.01);
    }
    // Near, deep, far and low; too far to sum in bounded time is refused.
    let settled = |bubble: Point, ear: Point, frequency: f64| {
        let solver = Solver::new(&pool, frequency).unwrap();
        let found = solver.hear(ear).unwrap().at(&[bubble]);
        found.map(|found| found[0].norm())
    };
    for (bubble, ear, frequency) in [
        ([0.0, 0.0, -1e-4], [0.0, 0.0, 1e-4], 20_000.0),
        ([5.0, 0.0, -0.5], [-5.0, 1.0, 2.0], 1.0),
        ([0.0, 0.0, -2.0], [3.0, 0.0, 1.5], 3_000.0),
    ] {
        assert!(settled(bubble, ear, frequency).unwrap() > 0.0);
    }
    let text = refusal(settled([0.0, 0.0, -30.0], [100.0, 0.0, 0.01], 1_000.0));
    assert!(text.contains("expected them nearer"), "{text}");
}

#[test]
fn a_glass_resonates_at_a_quarter_wave() {
    // No more edges than three octaves above the resonance ask for.
    let (radius, height) = (0.03, 0.15);
    let text = format!(
        "shape = \"glass\"\nradius = {radius}\nheight = {height}\nwall = 0.003\nlevel = 0.01\nedge = 0.013"
    );
    let glass = Vessel::parse("test", &text, Path::new(".")).unwrap();
    assert!(refusal(glass.filled_to(0.2)).contains("expected from 0.0001 to 0.15"));
    assert!(refusal(built_in("drop").filled_to(0.02)).contains("no level"));
    for level in [0.03, 0.06, 0.09] {
        let shape = glass.filled_to(level).unwrap().shape().unwrap();
        let expected = 343.0 / (4.0 * (height - level + 0.6 * radius));
        let heard = |frequency: f64| {
            let solver = Solver::new(&shape, frequency).unwrap();
            let field = solver.hear([0.5, 0.0, 0.6]).unwrap();
            field.at(&[[0.0, 0.0, 0.01]]).unwrap()[0].norm()
        };
        // The loudest of a scan, then a parabola through it and its neighbours.
        let step = 0.02 * expected;
        let scan: Vec<f64> = (-4..=4)
            .map(|i| heard(expected + f64::from(i) * step))
            .collect();
        let best = (1..8).max_by(|&a, &b| scan[a].total_cmp(&scan[b])).unwrap();
        let (a, b, c) = (scan[best - 1], scan[best], scan[best + 1]);
        let peak = expected + (best as f64 - 4.0 + 0.5 * (a - c) / (a - 2.0 * b + c)) * step;
        println!("level {level}: {peak:.1} Hz, expected {expected:.1} Hz");
        assert!(b > a && b > c, "{scan:?}");
        assert!((peak / expected - 1.0).abs() < 0.05);
    }
}

/// Edges for which the vessels have no more unknowns than HF's 60 and 120 points.
const AS_MANY: [(&str, f64); 3] = [("glass", 0.0085), ("bowl", 0.0115), ("tank", 0.0165)];

#[test]
fn both_ways_agree_and_miss_the_boundary_five_times_less_than_hfs_placement() {
    let (frequency, ear) = (1_500.0, [0.3, 0.2, 0.4]);
    for (name, edge) in AS_MANY {
        let mut vessel = built_in(name);
        let fine = vessel.shape().unwrap();
        vessel.edge = Some(edge);
        let shape = vessel.shape().unwrap();
        let Shape::Closed(closed) = &shape else {
            panic!("{name} is closed")
        };
        assert!(closed.water.count().1 <= 540 && closed.air.count().1 <= 1080);
        let bubble = [0.01, 0.005, 0.02];
        let solver = Solver::new(&shape, frequency).unwrap();
        let field = solver.hear(ear).unwrap();
        let sound = solver.sound(bubble).unwrap();
        let (adjoint, direct) = (
            field.at(&[bubble]).unwrap()[0],
            sound.at(&[ear]).unwrap()[0],
        );
        let (there, back) = (sound.residual(ear), field.residual(bubble));
        let largest = [there.water, there.air, back.water, back.air]
            .into_iter()
            .fold(0.0, f64::max);
        println!(
            "{name}: apart by {:.5}, {there:?} {back:?}",
            off(adjoint, direct)
        );
        assert!(off(adjoint, direct) < largest);
        let poles = Multipoles::new(&fine, frequency, 60, 120).unwrap();
        let theirs = poles.direct(bubble, ear).unwrap().residual;
        println!("{name}: HF {theirs:?}");
        assert!(theirs.water > 5.0 * there.water && theirs.air > 5.0 * there.air);
    }
}

#[test]
fn hfs_placement_misses_no_more_than_their_table_in_a_drop() {
    let drop = built_in("drop").shape().unwrap();
    let (bubble, ear) = ([0.01, 0.0, 0.02], [0.3, 0.2, 0.9]);
    let poles = Multipoles::new(&drop, 2_000.0, 30, 80).unwrap();
    for found in [poles.direct(bubble, ear), poles.adjoint(bubble, ear)] {
        let found = found.unwrap();
        // The surface is grown: near the exact answer, not at it.
        let exact = drop_series(0.05, bubble, ear, 2_000.0);
        println!("{:?}, off {:.3}", found.residual, off(found.ratio, exact));
        assert!(found.residual.water < 0.06 && found.residual.air < 0.18);
        assert!(off(found.ratio, exact) < 0.3);
    }
}

/// An octahedron, cut finer, as an OBJ file: every corner given anew, some by negative numbers.
fn obj() -> String {
    let mut text = String::from("# a drop\ng water\n");
    let n = 6;
    for sign in [
        [1, 1, 1],
        [-1, -1, 1],
        [1, -1, -1],
        [-1, 1, -1],
        [-1, 1, 1],
        [1, -1, 1],
        [1, 1, -1],
        [-1, -1, -1],
    ] {
        let point = |i: usize, j: usize| {
            let parts = [i as f64, j as f64, (n - i - j) as f64];
            let length = norm(parts);
            [0, 1, 2].map(|axis| 50.0 * parts[axis] / length * f64::from(sign[axis]))
        };
        let mut face = |corners: [Point; 3]| {
            let mirrored = sign.iter().product::<i32>() < 0;
            for [x, y, z] in corners {
                text += &format!("v {x} {y} {z}\n");
            }
            text += if mirrored {
                "f -1 -2 -3\n"
            } else {
                "f -3/1/1 -2//2 -1\n"
            };
        };
        for i in 0..n {
            for j in 0..n - i {
                face([point(i, j), point(i + 1, j), point(i, j + 1)]);
                if i + j + 2 <= n {
                    face([point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
                }
            }
        }
    }
    text
}

#[test]
fn meshes_of_other_programs_are_read_and_broken_ones_refused() {
    let folder = std::env::temp_dir().join(format!("freshet-transfer-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let read =
        |text: &str| Vessel::parse("mesh.toml", text, &folder).and_then(|vessel| vessel.shape());
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let good = "shape = \"mesh\"\nfile = \"drop.obj\"\nscale = 0.001\nfree = [\"water\"]";
    write("drop.obj", &obj());
    let drop = read(good).unwrap();
    let solver = Solver::new(&drop, 1_000.0).unwrap();
    let ear = [0.3, 0.2, 0.9];
    let found = solver.hear(ear).unwrap().at(&[[0.0; 3]]).unwrap()[0];
    let exact = drop_series(0.05, [0.0; 3], ear, 1_000.0);
    println!("288 triangles without mirrors: {:.4}", off(found, exact));
    // An inscribed polyhedron is a little smaller than the ball.
    assert!(off(found, exact) < 0.05);

    for (change, expected) in [
        (
            obj().replace("g water", "g wine"),
            "line 6: a face of the part \"wine\"",
        ),
        (
            obj().replacen("f -3", "f -300", 1),
            "line 6: `-300/1/1`: expected the number of a point",
        ),
        (
            obj().replacen("v 0 0", "v 0 zero", 1),
            "line 3: `zero`: expected a number",
        ),
        (
            obj().replacen("f -3/1/1 -2//2 -1\n", "", 1),
            "not watertight",
        ),
        (
            obj().replacen("f -3/1/1 -2//2 -1\n", "f -1 -2 -3\n", 1),
            "not oriented",
        ),
        (obj().replace("v ", "v -"), "expected a number"),
        (String::new(), "no triangles found"),
    ] {
        write("drop.obj", &change);
        let text = refusal(read(good));
        assert!(
            text.contains(expected) && text.contains("drop.obj") || text.contains("surface"),
            "{text}"
        );
        assert!(text.contains(expected), "{text}");
    }
    // A tetrahedron as PLY, a wall below; text and the same in binary.
    let points = [
        [0.0f32, 0.0, 0.0],
        [0.1, 0.0, 0.0],
        [0.0, 0.1, 0.0],
        [0.0, 0.0, 0.1],
    ];
    let faces = [[0, 2, 1, 1], [0, 1, 3, 1], [0, 3, 2, 1], [1, 2, 3, 0]];
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             element face 4\nproperty list uchar int vertex_indices\nproperty uchar part\nend_header\n"
        )
    };
    let mut text = header("ascii");
    let mut binary = header("binary_little_endian").into_bytes();
    for [x, y, z] in points {
        text += &format!("{x} {y} {z}\n");
        [x, y, z]
            .iter()
            .for_each(|x| binary.extend(x.to_le_bytes()));
    }
    for [a, b, c, part] in faces {
        text += &format!("3 {a} {b} {c} {part}\n");
        binary.push(3);
        [a, b, c]
            .iter()
            .for_each(|i: &i32| binary.extend(i.to_le_bytes()));
        binary.push(part as u8);
    }
    let ply = "shape = \"mesh\"\nfile = \"wedge.ply\"\nfree = [\"0\"]\nsolid = [1]";
    for bytes in [text.as_bytes(), &binary] {
        std::fs::write(folder.join("wedge.ply"), bytes).unwrap();
        let Shape::Closed(closed) = read(ply).unwrap() else {
            panic!("a mesh is closed")
        };
        assert!((closed.mesh.volume() - 1e-3 / 6.0).abs() < 1e-9);
        for cut in [bytes.len() - 3, bytes.len() / 2, 40] {
            std::fs::write(folder.join("wedge.ply"), &bytes[..cut]).unwrap();
            assert!(refusal(read(ply)).contains("wedge.ply"));
        }
    }
    for (change, expected) in [
        (text.replace("3 0 2 1 1", "3 0 -2 1 1"), "face 1: point"),
        (
            text.replace("3 0 2 1 1", "2 0 2 1"),
            "face 1: a face with 2 corners",
        ),
        (
            text.replace("element face 4", "element face 99999999999999999999"),
            "expected a count",
        ),
        (
            text.replace(
                "element vertex",
                "element other 888888888888888\nelement vertex",
            ),
            "",
        ),
    ] {
        std::fs::write(folder.join("wedge.ply"), change).unwrap();
        match read(ply) {
            Ok(_) => assert_eq!(expected, ""),
            Err(error) => assert!(format!("{error:#}").contains(expected), "{error:#}"),
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_needle_and_a_plate_are_meshed_in_bounded_time() {
    for text in [
        "shape = \"glass\"\nradius = 0.0001\nheight = 100\nwall = 0.0001\nlevel = 50",
        "shape = \"box\"\nwidth = 100\ndepth = 100\nheight = 0.0001\nwall = 0.0001\nlevel = 0.0001",
        "shape = \"drop\"\nradius = 100",
    ] {
        let vessel = Vessel::parse("test", text, Path::new(".")).unwrap();
        // A shape, or a reason.
        drop(vessel.shape());
    }
}

#[test]
fn what_makes_no_sense_is_refused_with_what_was_expected() {
    let glass = shape(
        "shape = \"glass\"\nradius = 0.03\nheight = 0.1\nwall = 0.003\nlevel = 0.05\nedge = 0.015",
    );
    for (frequency, expected) in [
        (0.0, "expected a number above 0"),
        (f64::NAN, "expected a number above 0"),
        (-3.0, "expected a number above 0"),
        (1e-3, "at least 1 Hz"),
        (20_000.0, "this mesh resolves up to"),
    ] {
        assert!(refusal(Solver::new(&glass, frequency)).contains(expected));
    }
    let solver = Solver::new(&glass, 500.0).unwrap();
    for ear in [[0.0, 0.0, 0.02], [0.031, 0.0, 0.08], [0.0, 0.0, -0.002]] {
        assert!(
            refusal(solver.hear(ear)).contains("not in the air"),
            "{ear:?}"
        );
    }
    assert!(refusal(solver.hear([f64::NAN, 0.0, 1.0])).contains("expected three numbers"));
    // In the air of the glass one hears.
    let field = solver.hear([0.0, 0.0, 0.08]).unwrap();
    for bubble in [[0.0, 0.0, 0.06], [0.0, 0.0, -0.001], [0.5, 0.0, 0.02]] {
        let text = refusal(field.at(&[bubble]));
        assert!(text.contains("not inside the liquid"), "{text}");
    }
    for (text, expected) in [
        ("", "no `shape`"),
        (
            "shape = \"cup\"",
            "test:1:9: shape = \"cup\": expected one of drop",
        ),
        (
            "shape = \"drop\"\nradios = 1",
            "test:2:1: a drop has no `radios` (did you mean `radius`?",
        ),
        (
            "shape = \"drop\"\nradius = -1",
            "test:2:10: radius: expected a number from",
        ),
        (
            "shape = \"drop\"\nradius = nan",
            "test:2:10: radius: expected a number from",
        ),
        (
            "shape = \"drop\"\nradius = \"1\"",
            "radius: expected a number from",
        ),
        (
            "shape = \"drop\"\nradius = 0.1\nedge = 0.0001",
            "expected at least",
        ),
        (
            "shape = \"drop\"\nradius = 0.1\nedge = 1",
            "expected at most",
        ),
        ("shape = ", "not valid TOML"),
        ("shape = \"mesh\"\nfile = \"x.obj\"", "no `free`"),
        (
            "shape = \"mesh\"\nfile = \"none.obj\"\nfree = [\"a\"]",
            "cannot read",
        ),
        (
            "shape = \"glass\"\nradius = 0.03\nheight = 0.1\nwall = 0.003\nlevel = 0.2",
            "test:5:9: level = 0.2: above `height` = 0.1",
        ),
    ] {
        let parsed = Vessel::parse("test", text, Path::new(".")).and_then(|vessel| vessel.shape());
        let found = refusal(parsed);
        assert!(found.contains(expected), "{text}: {found}");
    }
}

#[test]
fn every_vessel_closes_at_every_level_and_edge() {
    for (fixed, height) in [
        ("shape = \"glass\"\nradius = 0.03", 0.11),
        ("shape = \"bowl\"\nradius = 0.1", 0.1),
        ("shape = \"bowl\"\nradius = 0.1", 0.05),
        ("shape = \"box\"\nwidth = 0.1\ndepth = 0.07", 0.08),
    ] {
        for wall in [0.0, 0.002, 0.02] {
            for share in [0.03, 0.5, 0.999, 1.0] {
                for edge in [0.02, 0.0073] {
                    if wall == 0.0 && share < 1.0 {
                        continue;
                    }
                    let level = height * share;
                    let text = format!(
                        "{fixed}\nheight = {height}\nwall = {wall}\nlevel = {level}\nedge = {edge}"
                    );
                    let Shape::Closed(closed) = shape(&text) else {
                        panic!("it is closed")
                    };
                    assert!(closed.water.encloses([0.001, 0.002, 0.5 * level]), "{text}");
                }
            }
        }
    }
}

/// The command: what it answers, and that it refuses in words.
#[test]
fn the_command_answers_in_text_and_json() {
    let glass = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vessels/glass.toml");
    let run = |arguments: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_freshet"))
            .arg(arguments[0])
            .arg(&glass)
            .args(&arguments[1..])
            .output()
            .unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (
            output.status.success(),
            text(&output.stdout),
            text(&output.stderr),
        )
    };
    let place = [
        "transfer",
        "--at",
        "0.01,0,0.02",
        "--ear",
        "-0.3,0.2,0.4",
        "--frequency",
        "800",
        "--edge",
        "0.01",
    ];
    let mut answers = Vec::new();
    for method in ["adjoint", "direct"] {
        let (good, out, err) = run(&[&place[..], &["--method", method, "--json"]].concat());
        assert!(good, "{err}");
        let value: serde_json::Value = serde_json::from_str(&out).unwrap();
        let number = |key: &str| value[key].as_f64().unwrap();
        assert_eq!(value["method"], method);
        assert_eq!(number("density_ratio"), 0.0012);
        assert!(value["residual"]["air"].as_f64().unwrap() < 0.05);
        answers.push(c64::new(number("re"), number("im")));
    }
    assert!(off(answers[0], answers[1]) < 0.02);
    let (good, out, _) = run(&place);
    assert!(
        good && out.contains("P/S_b") && out.contains("density ratio"),
        "{out}"
    );
    for (change, expected) in [
        ((2, "0,0,0.1"), "not inside the liquid"),
        ((2, "0,0"), "expected three numbers"),
        ((4, "nan,0,0"), "expected three numbers"),
        ((6, "0"), "expected a number above 0"),
        ((6, "90000"), "resolves up to"),
        ((8, "7"), "longer than"),
    ] {
        let mut arguments = place;
        arguments[change.0] = change.1;
        let (good, _, err) = run(&arguments);
        assert!(!good && err.contains(expected), "{change:?}: {err}");
    }
    let picture = std::env::temp_dir().join(format!("freshet-vessel-{}.png", std::process::id()));
    let (good, out, err) = run(&["vessel", "--plot", picture.to_str().unwrap()]);
    assert!(good && out.contains("watertight"), "{err}");
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    std::fs::remove_file(&picture).unwrap();
}
