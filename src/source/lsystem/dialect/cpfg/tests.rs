//! Plants of the book as cpfg has them, its statements and its turtle, and what it refuses.

use super::super::Dialect;
use super::super::tests::{drawn, drawn_in, read_in, same};
use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::budget::Budget;
use crate::source::lsystem::derive::derive;

/// A file with these lines between its head and its end.
fn file(steps: u64, lines: &str) -> String {
    format!("Lsystem: 1\nderivation length: {steps}\n{lines}\nendlsystem\n")
}

fn derived(text: &str) -> String {
    let grammar = read_in(Dialect::Cpfg, text).unwrap_or_else(|f| panic!("{f:?} in\n{text}"));
    let mut out = String::new();
    let mut budget = Budget::new(1_000_000, 1 << 24);
    let steps = grammar.iterations.unwrap();
    derive(&grammar, steps, grammar.seed, &mut budget, &mut |symbol, arguments, _| {
        out += &grammar.written(symbol);
        if !arguments.is_empty() {
            let list: Vec<String> = arguments.iter().map(|a| format!("{}", (a * 1e6).round() / 1e6)).collect();
            out += &format!("({})", list.join(","));
        }
        Ok(())
    })
    .unwrap();
    out
}

#[test]
fn plants_of_the_book() {
    for (own, cpfg) in [
        ("axiom: F\nF -> F[+F]F[-F]F", "Axiom: F\nF --> F[+F]F[-F]F"),
        ("axiom: X\nX -> F-[[X]+X]+F[+FX]-X\nF -> FF", "axiom: X\nX --> F-[[X]+X]\n\t+F[+FX]-X\nF --> FF"),
    ] {
        let book = drawn_in(Dialect::Book, &format!("#angle 45\n{own}"), 4);
        same(&drawn_in(Dialect::Cpfg, &file(4, cpfg), 4), &book, DMat3::IDENTITY, 1.0);
    }
    // Fig. 2.6: a tree with one axis. cpfg rolls the other way, and @v is the book's $: d goes backwards.
    let own = "#define r1 .9\n#define r2 .6\n#define wr .707
        axiom: A(1,10)
        A(l,w) : * -> !(w)F(l)[&(45)B(l*r2,w*wr)]/(137.5)A(l*r1,w*wr)
        B(l,w) : * -> !(w)F(l)[-(45)$C(l*r2,w*wr)]C(l*r1,w*wr)
        C(l,w) : * -> !(w)F(l)[+(45)$B(l*r2,w*wr)]B(l*r1,w*wr)";
    let cpfg = "#define r1 .9\n#define r2 .6 /* a ratio */\n#define wr .707\nLsystem: tree\nderivation length: 8
Axiom: A(1,10)
A(l,w) : * --> !(w)F(l)[&(45)B(l*r2,w*wr)]\\(137.5)A(l*r1,w*wr)
B(l,w) --> !(w)F(l)[-(45)@vC(l*r2,w*wr)]C(l*r1,w*wr)
C(l,w) : 1 --> !(w)F(l)[+(45)@vB(l*r2,w*wr)]B(l*r1,w*wr)
endlsystem";
    let (book, plant) = (drawn_in(Dialect::Book, own, 8), drawn_in(Dialect::Cpfg, cpfg, 8));
    same(&plant, &book, DMat3::IDENTITY, 1.0);
    let radii =
        |p: &crate::source::lsystem::plant::Plant| p.limbs.iter().flat_map(|l| l.radii.clone()).collect::<Vec<_>>();
    assert_eq!(radii(&plant), radii(&book));
    // Section 1.8: a signal that goes up; the ignored symbols do not hinder it.
    let signal = "ignore: +-\nAxiom: b+a-a[+a]a\nb < a --> b\nb --> a";
    let own = "#ignore +-\n#iterations 3\naxiom: b+a-a[+a]a\nb < a -> b\nb -> a";
    let book = read_in(Dialect::Book, own).unwrap();
    let mut want = String::new();
    derive(&book, 3, 0, &mut Budget::new(1000, 1 << 20), &mut |c, _, _| {
        want.push(c);
        Ok(())
    })
    .unwrap();
    assert_eq!(derived(&file(3, signal)), want);
}

#[test]
fn statements_of_the_file_and_of_productions() {
    for (steps, lines, want) in [
        // A variable of the file counts the steps; Q does so by itself.
        (
            3,
            "Start: { n = 10; }\nStartEach: { n = n + 1; }\nAxiom: A\nA --> A(n,Q)\nA(x,y) --> B(x,y)A(n,Q)",
            "B(11,1)B(12,2)A(13,3)",
        ),
        // What comes after the last step sets what the homomorphism reads.
        (
            1,
            "Start: { n = 1; }\nEnd each: { n = 5; }\nEnd: { n = n * 2; }\nAxiom: A\nA --> B\nhomomorphism\nB --> F(n)",
            "F(10)",
        ),
        // A production sets its parameter before the condition, and another variable after it.
        (1, "Axiom: A(3)A(5)\nA(t) : { t = t - 4; } t > 0 { u = t * 10; } --> B(t,u)\nA(t) --> C(t)", "C(3)B(1,10)"),
        // Blocks over lines, loops, and an array of two dimensions.
        (
            1,
            "Define: { array a[2][3] = {1, 2, 3,\n 4, 5, 6}; }\nStart: {\n i = 0; s = 0;\n while (i < 3) { s = s + a[1][i]; i = i + 1; }\n do { s = s + 1; } while (s < 0);\n if (s == 16) { a[0][0] = 7; } else { a[0][0] = 8; }\n printf(\"%f; }\\n\", s);\n}\nAxiom: A(s, a[0][0], a[9][9])",
            "A(16,7,6)",
        ),
        // The first that matches is taken, in context or not.
        (1, "Axiom: AB\nA --> C\nA > B --> D", "CB"),
        // Z is the number of steps.
        (2, "Axiom: A\nA --> A(Z)", "A(2)"),
        (1, "Axiom: A\nA --> *", ""),
        (1, "consider: AB\nAxiom: A+B\nA > B --> C", "C+B"),
    ] {
        assert_eq!(derived(&file(steps, lines)), want, "{lines}");
    }
}

#[test]
fn decomposition_and_homomorphism_go_to_their_depth() {
    for (steps, lines, want) in [
        // An apex that grew by more than one plastochron makes several internodes in a step.
        (
            1,
            "Axiom: A(0)\nA(t) --> A(t+3.5)\ndecomposition\nmaximum depth: 10\nA(t) : t >= 1 --> I A(t-1)",
            "IIIA(0.5)",
        ),
        (1, "Axiom: A(0)\nA(t) --> A(t+3.5)\ndecomposition\nA(t) : t >= 1 --> I A(t-1)", "IA(2.5)"),
        // What no production matches is decomposed as well, a step at a time.
        (2, "Axiom: B(4)\ndecomposition\nB(n) : n > 0 --> B(n-1)", "B(2)"),
        // With a context, which is that of the string before the step.
        (2, "Axiom: AB\nA --> A\nB --> C\ndecomposition no warnings\nA > B --> D", "DC"),
        (0, "Axiom: A\nhomomorphism\nmaximum depth: 3\nA --> FA", "FFFA"),
        (0, "Axiom: AB\nB --> *\nhomomorphism:\nA --> B\nB --> F", "BF"),
    ] {
        assert_eq!(derived(&file(steps, lines)), want, "{lines}");
    }
}

#[test]
fn lots_are_drawn_with_a_seed_alone() {
    let lines = "Axiom: A\nA --> AB : 1\nA --> AC : 3";
    assert_eq!(derived(&file(4, lines)), "ABBBB");
    let grammar = read_in(Dialect::Cpfg, &file(4, lines)).unwrap();
    assert!(grammar.warnings.iter().any(|(text, n)| text.contains("no seed") && n == 2));
    // 400 lots of 3 in 4, with a deviation of 8.7: within five of them.
    let many = derived(&file(400, &format!("seed: 7\n{lines}")));
    let c = many.chars().filter(|c| *c == 'C').count();
    assert!((257..=343).contains(&c), "{c}");
}

#[test]
fn the_turtles_letters() {
    let plant = |axiom: &str| {
        let grammar = read_in(Dialect::Cpfg, &file(0, &format!("Axiom: {axiom}"))).unwrap();
        drawn(&grammar, 0)
    };
    let end = |axiom: &str| plant(axiom).limbs.last().unwrap().points.last().copied().unwrap();
    let half = 0.5f64.sqrt();
    for (axiom, want) in [
        ("F+F", DVec3::new(-half, 1.0 + half, 0.0)),
        ("gf(2)GF", DVec3::new(0.0, 5.0, 0.0)),
        // Rolled to the right, its left points away from us.
        ("/(90)+(90)F", DVec3::NEG_Z),
        ("&(90)F", DVec3::NEG_Z),
        ("@D(2)F@Di(3)F(2)@Dd(2)F", DVec3::new(0.0, 2.0 + 12.0 + 3.0, 0.0)),
        ("@M(1,2,3)@R(1,0,0)F(2)", DVec3::new(3.0, 2.0, 3.0)),
        ("@Gs F @Gc F @Ge(3)", DVec3::new(0.0, 2.0, 0.0)),
        ("F[F%F]F", DVec3::new(0.0, 2.0, 0.0)),
    ] {
        assert!((end(axiom) - want).length() < 1e-12, "{axiom} {}", end(axiom));
    }
    // Widths with the scale; a ball of a diameter has its radius in the middle, a disc fills a polygon.
    assert_eq!(plant("#(4)F@D(.5)!(4)F").limbs[0].radii, [2.0, 1.0, 1.0]);
    let ball = &plant("F(3)@O(4)").limbs[0];
    assert_eq!(ball.radii.len(), 17);
    assert!((ball.radii[8] - 2.0).abs() < 1e-6 && (ball.points[8] - DVec3::Y * 3.0).length() < 1e-12);
    let disc = plant("F@c(2)");
    assert_eq!((disc.counts.polygons, disc.polygons[&0].triangles.len()), (1, 30));
    // A surface that the file does not have is told by its name.
    assert!(plant("F~l(2)").warnings.iter().any(|(text, _)| text.contains("~l")));
}

#[test]
fn faults_name_the_construct_and_its_place() {
    for (text, line, column, what) in [
        ("Axiom: F", 1, 1, "begins with a line such as Lsystem: 1"),
        ("", 1, 1, "no L-system"),
        ("Lsystem: 1\nderivation length: 1.5\n", 2, 20, "whole number"),
        ("Lsystem: 1\nring Lsystem\n", 2, 1, "ring"),
        ("Lsystem: 1\nfoo: 3\n", 2, 1, "none of seed"),
        ("Lsystem: 1\nAxiom: ?P(0,0,0)F\n", 2, 8, "the module ? is not read"),
        ("Lsystem: 1\nAxiom: F@Tx(1)F@PS(1)\n", 2, 16, "the module @PS"),
        ("Lsystem: 1\nAxiom: F\nF --> F(x)\n", 3, 9, "x is no parameter"),
        ("Lsystem: 1\nAxiom: F\nF(x) : x > 1 --> F(func(1,x))\n", 3, 20, "func is no"),
        ("Lsystem: 1\nAxiom: F\nAB --> F\n", 3, 1, "one symbol"),
        ("Lsystem: 1\nAxiom: F\nF : { x = 1 } --> F\n", 3, 13, "';'"),
        ("Lsystem: 1\nAxiom: F\nF : { stop(1); } --> F\n", 3, 7, "the procedure stop"),
        ("Lsystem: 1\nDefine: { external x; }\nAxiom: F", 2, 11, "external"),
        ("Lsystem: 1\nDefine: { array a[99999999]; }\nAxiom: F", 2, 19, "elements"),
        ("Lsystem: 1\nStart: { a[0] = 1; }\nAxiom: F", 2, 11, "'='"),
        ("Lsystem: 1\nAxiom: F\nendlsystem\nLsystem: 2\n", 4, 1, "sub-L-systems"),
        ("Lsystem: 1\nAxiom: F\nhomomorphism\nA < F --> F\n", 4, 1, "no context"),
        ("Lsystem: 1\nAxiom: F\nmaximum depth: 2\n", 3, 1, "belongs to"),
    ] {
        let fault = read_in(Dialect::Cpfg, text).unwrap_err();
        assert!((fault.line, fault.column) == (line, column) && fault.what.contains(what), "{text:?}: {fault:?}");
    }
}

#[test]
fn the_view_file_and_the_map_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("leaf.l");
    let save = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    save("leaf.l", b"");
    let read = || {
        let mut grammar = read_in(Dialect::Cpfg, &file(0, "Axiom: F#F;F")).unwrap();
        super::view::read(&path, &mut grammar).map(|()| grammar)
    };
    assert_eq!(read().unwrap().angle, 45.0);
    let mut map = [0u8; 768];
    map[3..9].copy_from_slice(&[255, 0, 0, 0, 255, 0]);
    save("leaf.map", &map);
    save(
        "leaf.v",
        b"angle factor: 16\ninitial line width: .5\nline width increment: 1.5\ninitial color: 1\nz buffer: on\n",
    );
    let plant = drawn(&read().unwrap(), 0);
    assert_eq!(read().unwrap().angle, 22.5);
    assert_eq!(plant.limbs.iter().map(|l| l.radii[0]).collect::<Vec<_>>(), [0.25, 1.0, 1.0]);
    assert_eq!(plant.limbs[0].colours[0], [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(plant.limbs[2].colours[0], [0.0, 1.0, 0.0, 1.0]);
    // Widths in pixels are none.
    save("leaf.v", b"initial line width: 3 pixels\nangle increment: 30");
    assert_eq!(drawn(&read().unwrap(), 0).limbs[0].radii[0], 0.05);
    // The view file is read first.
    for (name, bytes, what) in
        [("leaf.map", &[0; 12][..], "256 colours"), ("leaf.v", &b"angle factor: many"[..], "line 1")]
    {
        save(name, bytes);
        assert!(read().unwrap_err().to_string().contains(what));
    }
}

#[test]
fn surfaces_of_patches() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("leaf.l");
    let save = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    // Three units each way, evenly: of a cubic so given, even steps are even. Its middle rows are a unit up.
    let rows = [0, 1, 2, 3].map(|y| {
        let z = i32::from(y == 1 || y == 2);
        [10, 11, 12, 13].map(|x| format!("{x} {y} {z}  ")).concat()
    });
    let patch = |colour: u32| {
        let neighbours = "AL: ~ A: ~ AR: ~\nL: ~ R: ~\nBL: ~ B: ~ BR: ~";
        format!("patch\nTOP COLOR: {colour} DIFFUSE: 0 BOTTOM COLOR: 0 DIFFUSE: 0\n{neighbours}\n{}", rows.join("\n"))
    };
    let points = "CONTACT POINT  X: 10 Y: 0 Z: 0\nEND POINT  X: 10 Y: 3 Z: 0";
    let axes = "HEADING  X: 0 Y: 2 Z: 0\nUP  X: 0 Y: 0 Z: 1";
    let surface = format!("10 13 0 3 0 1\nPRECISION S: 2 T: 1\n{points}\n{axes}\nSIZE: 3\n{}", patch(0));
    save("leaf.s", &surface);
    save("leaf.v", "surface: l leaf.s 6\nsurface: m leaf.s 3 1 1\nsurface: n none.s 1");
    let read = |axiom: &str| {
        let mut grammar = read_in(Dialect::Cpfg, &file(0, &format!("Axiom: {axiom}"))).unwrap();
        super::view::read(&path, &mut grammar).map(|()| grammar)
    };
    assert_eq!(super::view::files(&path).len(), 3, "the view file, and the surface that two lines name");
    // x is left, y ahead, and up away from us: of 6 units, and half of it. Rows at 0, 3 and 6; in between 3 / 4 of the height.
    let plant = drawn(&read("~l(.5)F").unwrap(), 0);
    let part = &plant.polygons[&0];
    let row = |y: f32, z: f32| [[0.0, y, z], [-3.0, y, z]];
    assert_eq!(part.positions, [row(0.0, 0.0), row(1.5, -0.75), row(3.0, 0.0)].concat());
    assert_eq!(part.triangles.len(), 4);
    assert_eq!(plant.limbs[0].points, [[0.0, 3.0, 0.0], [0.0, 4.0, 0.0]].map(DVec3::from));
    // Lengths' factor scales it; its steps are given.
    let plant = drawn(&read("@D(2)~m").unwrap(), 0);
    let corners = [[0.0; 3], [-6.0, 0.0, 0.0], [0.0, 6.0, 0.0], [-6.0, 6.0, 0.0]];
    assert_eq!(plant.polygons[&0].positions, corners);
    assert!(plant.warnings.iter().all(|(text, _)| !text.contains("none.s")));
    assert!(read("~n").unwrap().warnings.iter().any(|(text, _)| text.contains("there is no file none.s")));
    // A patch's own colour is of the map.
    let mut map = vec![0u8; 768];
    map[6..9].copy_from_slice(&[255, 0, 0]);
    std::fs::write(dir.path().join("leaf.map"), map).unwrap();
    save("leaf.s", &surface.replace("COLOR: 0 DIFFUSE: 0 BOTTOM", "COLOR: 2 DIFFUSE: 0 BOTTOM"));
    assert_eq!(drawn(&read("~l").unwrap(), 0).polygons[&0].colors.as_ref().unwrap()[0], [1.0, 0.0, 0.0, 1.0]);
    for (text, what) in [
        (surface.replace("HEADING", "AHEAD"), "line 5: HEADING has to stand where AHEAD does"),
        (surface.replace("SIZE: 3", "SIZE: 0"), "has to have a size"),
        (surface.replace("Y: 2 Z: 0\nUP", "Y: 0 Z: 3\nUP"), "a heading and an up across it"),
        (surface.replace("13 3 0", "13 3 nan"), "nan is no number"),
        (surface.replace("13 3 0", "13 3"), "ends before a number"),
        (surface.replace("13 3 0", "13 3 1e30"), "units away"),
    ] {
        save("leaf.s", &text);
        let error = read("~l").unwrap_err().to_string();
        assert!(error.contains(what) && error.contains("leaf.s"), "{what}: {error}");
    }
    save("leaf.v", "surface: l leaf.s");
    assert!(read("F").unwrap_err().to_string().contains("line 1: surface: has to be followed by"));
}
