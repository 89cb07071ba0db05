//! Plants of the book as L-Py has them, its rules by Python, its turtle, and what it refuses.

use super::super::Dialect;
use super::super::tests::{drawn, drawn_in, read_in, same};
use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::budget::Budget;
use crate::source::lsystem::derive::derive;

fn derived(text: &str) -> String {
    let grammar = read_in(Dialect::Lpy, text).unwrap_or_else(|f| panic!("{f:?} in\n{text}"));
    let mut out = Vec::new();
    let mut budget = Budget::new(1_000_000, 1 << 24);
    let steps = grammar.iterations.unwrap();
    derive(&grammar, steps, 0, &mut budget, &mut |symbol, arguments, _| {
        let list: Vec<String> = arguments.iter().map(|a| format!("{}", (a * 1e6).round() / 1e6)).collect();
        out.push(
            grammar.written(symbol) + &if list.is_empty() { String::new() } else { format!("({})", list.join(",")) },
        );
        Ok(())
    })
    .unwrap();
    out.join(" ")
}

#[test]
fn plants_of_the_book() {
    for (own, lpy) in [
        ("axiom: F\nF -> F[+F]F[-F]F", "Axiom: F\nproduction:\nF --> F[+F]F[-F]F\n"),
        (
            "axiom: X\nX -> F[+X]F[-X]+X\nF -> FF",
            "Axiom: X\nproduction:\nX :\n\tproduce F[+X]F[-X]+X # as the book\nF: produce FF\nendlsystem\nx = y()\n",
        ),
        (
            "axiom: A(1)\nA(s) -> F(s)[+(85)A(s/1.456)][-(85)A(s/1.456)]",
            "\"\"\"Section 1.10\n\"\"\"\nfrom math import *\nR = 1.456\na = 85\nAxiom: A(1)\nderivation length: 4\nproduction:\nA(s) --> F(s)[+(a)A(s/R)][-(a)A(s/R)]\ninterpretation:\n\nendlsystem\n",
        ),
    ] {
        let book = drawn_in(Dialect::Book, &format!("#angle 60\n{own}"), 4);
        same(&drawn_in(Dialect::Lpy, lpy, 4), &book, DMat3::IDENTITY, 1.0);
    }
    // Fig. 2.6, with modules of names.
    let own = "#define r1 .9\n#define r2 .6\n#define wr .707
        axiom: A(1,10)
        A(l,w) : * -> !(w)F(l)[&(45)B(l*r2,w*wr)]/(137.5)A(l*r1,w*wr)
        B(l,w) : * -> !(w)F(l)[-(45)$C(l*r2,w*wr)]C(l*r1,w*wr)
        C(l,w) : * -> !(w)F(l)[+(45)$B(l*r2,w*wr)]B(l*r1,w*wr)";
    let lpy = "r1 = .9
r2 = .6
wr = .707
module Apex(l, w), Left2, B
Axiom: Apex(1, 5)
derivation length: 8
production:
Apex(l,w) --> _(w)F(l)[&(45)B(l*r2,w*wr)]/(137.5)Apex(l*r1,w*wr)
B(l,w) --> _(w)F(l)[-(45)@vLeft2(l*r2,w*wr)]Left2(l*r1,w*wr)
Left2(l,w) --> SetWidth(w) F(l) [ Left(45) RollToVert B(l*r2,w*wr)]B(l*r1,w*wr)
";
    let (book, plant) = (drawn_in(Dialect::Book, own, 8), drawn_in(Dialect::Lpy, lpy, 8));
    same(&plant, &book, DMat3::IDENTITY, 1.0);
    // Its widths are radii.
    let radii =
        |p: &crate::source::lsystem::plant::Plant| p.limbs.iter().flat_map(|l| l.radii.clone()).collect::<Vec<_>>();
    assert_eq!(radii(&plant), radii(&book));
}

#[test]
fn rules_by_python_are_its_ways() {
    for (rules, want) in [
        ("A(x) :\n  if x > 1: produce B(x)\n  elif x == 1 :\n    produce C(x)\n  else:\n    produce *", "B(3) C(1)"),
        // Without anything produced the next rule is tried, and then the module stays.
        ("A(x):\n  if x > 1:\n    produce B\nA(x) :\n  if not x >= 1: produce", "B A(1)"),
        // A variable is another each time that it is set.
        (
            "A(x):\n  y = x * 2 ; x += y\n  nproduce B(y)\n  y = 0\n  if 0 < x < 4 and x != 0:\n    nproduce C(x, y)\n  nproduce D",
            "B(6) D B(2) C(3,0) D B(0) D",
        ),
        ("A(x) :\n    pass\n    if x: \n        if x > 1: produce B\n        produce C\n    produce D", "B C D"),
        ("A(x) --> (x)", ""),
    ] {
        let text = format!("Axiom: A(3)A(1)A(0)\nderivation length: 1\nproduction:\n{rules}\n");
        match want {
            "" => assert!(read_in(Dialect::Lpy, &text).is_err(), "{rules}"),
            _ => {
                let got = derived(&text);
                assert!(got.starts_with(want), "{rules}: {got}");
            }
        }
    }
    // Decomposition and interpretation, contexts, an axiom that is produced, continued lines.
    for (text, want) in [
        ("Axiom: A\nproduction:\nA --> B\ndecomposition:\nmaximum depth: 2\nB --> C\nC --> D\nD --> E", "D"),
        ("Axiom: A\nproduction:\ninterpretation:\nA --> A F", "A F"),
        ("Axiom: A+B\nignore: +\nproduction:\nA > B --> C\nA < B --> D", "C + D"),
        ("Axiom:\n  nproduce A(1)\n  nproduce A(\n2)\nproduction:\nA(x) \\\n  --> B(x)", "B(1) B(2)"),
        ("N = 2\nN2 = N**2 + int(1.5) if N > 1 else 0\nAxiom: A(N2)\nderivation length: N-2", "A(5)"),
    ] {
        assert_eq!(derived(text), want, "{text}");
    }
}

#[test]
fn the_turtles_letters() {
    let plant = |axiom: &str| drawn(&read_in(Dialect::Lpy, &format!("Axiom: {axiom}")).unwrap(), 0);
    let end = |axiom: &str| plant(axiom).limbs.last().unwrap().points.last().copied().unwrap();
    for (axiom, want) in [
        ("F+(90)F", DVec3::new(-1.0, 1.0, 0.0)),
        ("F Left(90) f(2) Right(90) F", DVec3::new(-2.0, 2.0, 0.0)),
        ("F(2)TurnAround F", DVec3::Y),
        ("RollL(90)+(90)F", DVec3::Z),
        // Its z is up: y, z and x are our x, y and z.
        ("MoveTo(1,2,3)F", DVec3::new(2.0, 4.0, 1.0)),
        ("@R(1,0,0)F", DVec3::Z),
        ("@D(2)F MultScale(3)F DivScale(6)F", DVec3::new(0.0, 9.0, 0.0)),
    ] {
        assert!((end(axiom) - want).length() < 1e-12, "{axiom} {}", end(axiom));
    }
    assert_eq!(
        plant("F_F!F_(3)F(1,2)").limbs.iter().map(|l| l.radii.clone()).collect::<Vec<_>>(),
        [vec![0.1, 0.1], vec![1.1, 0.1, 0.1], vec![3.0, 2.0]]
    );
    // Its leaf has two thirds of the area of a square of half its length: ½ · ⅓ · ½ · 2 + ½ · ⅓ = ⅓.
    let leaf = plant("~l(3)");
    let part = leaf.polygons.values().next().unwrap();
    let area: f64 = part
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| DVec3::from(part.positions[i as usize].map(f64::from)));
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    assert!((area - 9.0 / 3.0).abs() < 1e-5, "{area}");
}

#[test]
fn colours_of_the_window() {
    let text = "Axiom: ;(2)F,F SetColor(255, 0, 0) F SetColor(7)F\n###### INITIALISATION ######\n__lpy_code_version__ = 1.1\ndef __initialiseContext__(context):\n\timport openalea.plantgl.all as pgl\n\tColor_7 = pgl.Material(\"Color_7\" , ambient = (0,51,0) , diffuse = 5 , )\n\tColor_7.name = \"Color_7\"\n\tcontext.turtle.setMaterial(7,Color_7)\n";
    let plant = drawn(&read_in(Dialect::Lpy, text).unwrap(), 0);
    let colours: Vec<_> = plant.limbs.iter().map(|l| l.colours[0]).collect();
    assert_eq!(colours[2..], [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]);
    // Green and brown.
    assert!(colours[0][1] > 3.0 * colours[0][0] && colours[1][0] > colours[1][1]);
}

#[test]
fn what_needs_python_is_refused_where_it_stands() {
    for (text, line, column, what) in [
        ("def Start():\n  print(1)\nAxiom: F", 1, 1, "def: Python is not run"),
        ("x = random()\nAxiom: F", 1, 5, "x is set by Python that is not run here: random"),
        ("x = [1, 2]\nAxiom: F", 1, 5, "x is set by Python"),
        ("Axiom: F(y)", 1, 10, "y is no parameter, constant"),
        ("Axiom: F\nproduction:\nF :\n  for i in range(3):\n    nproduce F\n", 4, 3, "for: Python is not run"),
        ("Axiom: F\nproduction:\nF :\n  x = f(3)\n  produce F\n", 4, 7, "f is no parameter"),
        ("Axiom: F\nproduction:\nF :\n  if x:\nF --> F\n", 4, 3, "has to be followed by a block"),
        ("Axiom: F\nproduction:\nF :\n  else: produce F\n", 4, 3, "without an if"),
        ("Axiom: F\nproduction:\nF :\n  produce F\n    produce F\n", 5, 5, "indented line"),
        ("Axiom: F nF(3,1)\n", 1, 10, "the module nF is not read"),
        ("Axiom: F ?P(0,0,0)\n", 1, 10, "the module ?P"),
        ("Axiom: F\nproduction:\nA << F --> F\n", 3, 3, "new string"),
        ("Axiom: F\nproduction:\ngroup 1:\n", 3, 1, "group"),
        ("Axiom: F\nproduction:\nF\n", 3, 2, "'-->' or ':'"),
        ("Axiom: F\nderivation length: x\n", 2, 20, "x is no"),
        ("production:\nF --> F\n", 1, 1, "no axiom"),
        ("Axiom: F \"\"\"\nx\n", 1, 10, "never closed"),
    ] {
        let fault = read_in(Dialect::Lpy, text).unwrap_err();
        assert!((fault.line, fault.column) == (line, column) && fault.what.contains(what), "{text:?}: {fault:?}");
    }
    // Ways multiply with each condition, whether they produce anything or not.
    let many: String = (0..40).map(|i| format!("  if x > {i}: x += 1\n")).collect();
    let fault = read_in(Dialect::Lpy, &format!("Axiom: F\nproduction:\nF(x) :\n{many}  produce F\n")).unwrap_err();
    assert!(fault.what.contains("too many ways"), "{fault:?}");
}
