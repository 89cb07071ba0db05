//! Plants of the book in each notation: the same drawing as in our own. And what each notation refuses.

use super::*;
use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::budget::Budget;
use crate::source::lsystem::derive::derive;
use crate::source::lsystem::plant::Plant;
use crate::source::lsystem::turtle::Turtle;

pub fn read_in(dialect: Dialect, text: &str) -> Parsed<Grammar> {
    read(dialect, text, &Choice { define: &BTreeMap::new(), name: None })
}

pub fn drawn(grammar: &Grammar, n: u64) -> Plant {
    let mut turtle = Turtle::new(grammar, grammar.angle);
    let mut budget = Budget::new(10_000_000, 1 << 28);
    derive(grammar, n, grammar.seed, &mut budget, &mut |s, a, b| turtle.symbol(s, a, b)).unwrap();
    turtle.finish()
}

pub fn drawn_in(dialect: Dialect, text: &str, n: u64) -> Plant {
    drawn(&read_in(dialect, text).unwrap_or_else(|f| panic!("{f:?} in\n{text}")), n)
}

/// The points of all limbs, turned by `turn`, scaled by `scale`; they are in the order that they were drawn in.
fn points(plant: &Plant, turn: DMat3, scale: f64) -> Vec<DVec3> {
    plant.limbs.iter().flat_map(|l| &l.points).map(|p| scale * (turn * *p)).collect()
}

/// Check that two drawings have the same limbs, but for roundings of their 10⁴ or fewer turns and steps.
#[track_caller]
pub fn same(a: &Plant, b: &Plant, turn: DMat3, scale: f64) {
    let (a, b) = (points(a, turn, scale), points(b, DMat3::IDENTITY, 1.0));
    let size = b.iter().map(|p| p.length()).fold(0.0, f64::max);
    assert!(a.len() == b.len() && a.len() > 10, "{} {}", a.len(), b.len());
    let error = a.iter().zip(&b).map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
    assert!(error <= 1e-9 * size, "{error} of {size}");
}

/// Fig. 1.24 of the book, by letter: angle, steps, axiom and productions in our own notation.
const BOOK: [(char, f64, u64, &str); 6] = [
    ('a', 25.7, 5, "axiom: F\nF -> F[+F]F[-F]F"),
    ('b', 20.0, 5, "axiom: F\nF -> F[+F]F[-F][F]"),
    ('c', 22.5, 4, "axiom: F\nF -> FF-[-F+F+F]+[+F-F-F]"),
    ('d', 20.0, 7, "axiom: X\nX -> F[+X]F[-X]+X\nF -> FF"),
    ('e', 25.7, 7, "axiom: X\nX -> F[+X][-X]FX\nF -> FF"),
    ('f', 22.5, 5, "axiom: X\nX -> F-[[X]+X]+F[+FX]-X\nF -> FF"),
];

fn book(letter: char, angle: f64) -> (Plant, u64) {
    let (_, _, steps, text) = BOOK.into_iter().find(|b| b.0 == letter).unwrap();
    let steps = steps.min(4);
    (drawn_in(Dialect::Book, &format!("#angle {angle}\n{text}"), steps), steps)
}

/// A quarter turn to the left, in the plane of the drawing.
fn quarter() -> DMat3 {
    DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z)
}

#[test]
fn plants_of_the_book_in_fractints_notation() {
    // Its angles are whole parts of a turn, and its turtle sets out to the right.
    for (letter, parts, rules) in [
        ('a', 14, "Axiom F\n F=F[+F]F[-F]F ; on one line"),
        ('b', 18, "axiom f\nf=F[+F]F[-F][F]"),
        ('c', 16, "F=FF-[-F+F+F]\nf = +[+F-F-F]\naxiom F"),
        ('d', 18, "axiom x\nX=F[+X]F[-X]+X\nF=FF"),
        ('e', 14, "axiom=x\nX=F[+X][-X]FX\nF=FF"),
        ('f', 16, "axiom x\nX=F-[[X]+X]+F[+FX]-X\nF=FF"),
    ] {
        let (book, steps) = book(letter, 360.0 / f64::from(parts));
        let plant = drawn_in(Dialect::Fractint, &format!("Plant {{ ; of the book\nangle {parts}\n{rules}\n}}"), steps);
        same(&plant, &book, quarter(), 1.0);
    }
}

#[test]
fn fractints_letters() {
    let end = |text: &str, n: u64| {
        let plant = drawn_in(Dialect::Fractint, &format!("x {{\nangle {text}\n}}"), n);
        plant.limbs.last().unwrap().points.last().copied().unwrap()
    };
    let root = 0.5f64.sqrt();
    for (text, want) in [
        // Turns are to the left; @ scales what follows, by a root and by one over it, and brackets keep it.
        ("4\naxiom F+F", DVec3::new(1.0, 1.0, 0.0)),
        ("4\naxiom F@2F@I4F[@9F]F", DVec3::new(4.0, 0.0, 0.0)),
        ("4\naxiom @IQ2F@QI2F", DVec3::new(root + 0.5, 0.0, 0.0)),
        // ! exchanges left and right, within its brackets.
        ("4\naxiom [!F-F]!F+F!+F", DVec3::new(2.0, -1.0, 0.0)),
        // | is half a turn, or as many parts as make less than one: of five, two to the right.
        ("4\naxiom FF|F", DVec3::new(1.0, 0.0, 0.0)),
        ("5\naxiom |F", DVec3::new(144f64.to_radians().cos(), -144f64.to_radians().sin(), 0.0)),
        // D goes along a heading of its own, that \ and / turn and + does not.
        ("4\naxiom +D\\90D/45D", DVec3::new(1.0 + root, 1.0 + root, 0.0)),
        ("4\naxiom +MGF", DVec3::new(1.0, 2.0, 0.0)),
        // Letters without a meaning draw nothing, parentheses among them.
        ("4\naxiom A(4)F\",", DVec3::X),
    ] {
        assert!((end(text, 0) - want).length() < 1e-12, "{text} {}", end(text, 0));
    }
    // A production of < takes its number with it; colours go round the sixteen without the background's.
    let colours = |text: &str, n| {
        let plant = drawn_in(Dialect::Fractint, &format!("x {{\nangle 4\n{text}\n}}"), n);
        plant.limbs.iter().map(|l| l.colours[0]).collect::<Vec<_>>()
    };
    let white = [1.0; 4];
    assert_eq!(colours("axiom F<1+F\n<=", 1), [white]);
    let [first, second, third] = colours("axiom F<1+FC4+F>4+F", 0)[..3] else { panic!() };
    assert_eq!(first, white);
    // 1 and 4: blue and red of two thirds, as sRGB.
    assert!(second[2] > 0.3 && second[0] == 0.0 && third[0] > 0.3 && third[2] == 0.0);
    assert_eq!(colours("axiom F<1+FC4+F>4+F", 0)[3], white);
}

#[test]
fn one_system_of_several() {
    let text = "comment { angle nothing }\none { ; first\nangle 4\naxiom F\n}\n\nTwo\n{\naxiom F\nangle 6\n}";
    let named = |name| read(Dialect::Fractint, text, &Choice { define: &BTreeMap::new(), name });
    assert_eq!(named(Some("two")).unwrap().angle, 60.0);
    for (name, what) in [(None, "there are 2 systems; give option `name`: one, Two"), (Some("six"), "no system six")] {
        let fault = named(name).unwrap_err();
        assert!(fault.of_options && fault.what.contains(what), "{fault:?}");
    }
}

#[test]
fn plants_of_the_book_in_ini_files() {
    // Its angles go with the clock; every capital letter draws.
    for (letter, rules) in [
        ('a', "axiom=F\nrule0=F>F[-F]F[+F]F"),
        ('b', "axiom=F\nrule0=F=F[-F]F[+F][F]"),
        ('c', "numRules=1\naxiom = F\nrule7 = F>FF+[+F-F-F]-[-F+F+F]"),
        ('d', "axiom=x\nrule0=x>F[-x]F[+x]-x\nrule1=F>FF"),
    ] {
        let (_, angle, ..) = BOOK.into_iter().find(|b| b.0 == letter).unwrap();
        let (book, steps) = book(letter, angle);
        let text = format!(
            "# no section yet: x=1\n[L-System]\nname=a plant\nangle={angle}\nlineLength=3\nrotation=270\n{rules}"
        );
        same(&drawn_in(Dialect::Ini, &text, steps), &book, DMat3::IDENTITY, 1.0 / 3.0);
    }
    let grammar =
        read_in(Dialect::Ini, "[L-System]\r\niterations=3\r\naxiom=GH\r\n; x\r\n[other]\r\ncolour=1\r\n").unwrap();
    assert_eq!((grammar.iterations, drawn(&grammar, 0).counts.segments), (Some(3), 2));
}

#[test]
fn plants_of_the_book_in_houdinis_rules() {
    // + turns to the right.
    for (letter, rules) in [
        ('a', "Premise = F\nRule 1 = F=F[-F]F[+F]F"),
        ('b', "premise: F\nF=F[-F]F[+F][F]"),
        ('d', "// a comment\npremise = X\nrule1 = X=F[-X]F[+X]-X\nrule2 = F=FF"),
        ('f', "# another\nrule1: X=F+[[X]-X]-F[-FX]+X\nF = FF\npremise=X\ngenerations = 5"),
    ] {
        let (_, angle, ..) = BOOK.into_iter().find(|b| b.0 == letter).unwrap();
        let (book, steps) = book(letter, angle);
        let text = format!("Angle = {angle}\nStep Size = .1\n{rules}");
        same(&drawn_in(Dialect::Houdini, &text, steps), &book, DMat3::IDENTITY, 10.0);
    }
}

#[test]
fn houdinis_letters() {
    let plant = |text: &str, n| drawn_in(Dialect::Houdini, text, n);
    let end = |text: &str, n| plant(text, n).limbs.last().unwrap().points.last().copied().unwrap();
    for (text, n, want) in [
        ("angle = 90\npremise = F+F", 0, DVec3::new(1.0, 1.0, 0.0)),
        // H and h go half as far; a length that is given is not scaled, the step is.
        ("premise = HfhF(3)", 0, DVec3::new(0.0, 5.0, 0.0)),
        ("step size scale = .5\npremise = F\"F\"F_F(7)\"(4)F", 0, DVec3::new(0.0, 1.0 + 0.5 + 0.25 + 7.0 + 2.0, 0.0)),
        // ; halves angles that are not given, @ takes that back, * rolls over.
        (
            "angle = 90\nangle scale = .5\npremise = ;+F-F@-F",
            0,
            DVec3::new(0.5f64.sqrt() - 1.0, 0.5f64.sqrt() + 1.0, 0.0),
        ),
        ("angle = 90\npremise = *+F", 0, DVec3::NEG_X),
        ("angle = 90\npremise = &F", 0, DVec3::NEG_Z),
        // Parameters, conditions and values of the node; a rule in context.
        ("d = 3\npremise = A(1)\nA(i) : i<d = F(i)A(i*2)\nA(i) = F(b)\nb = 9", 3, DVec3::new(0.0, 12.0, 0.0)),
        ("premise = AFB\ncontext ignore: F\nA<B = F(5)", 1, DVec3::new(0.0, 6.0, 0.0)),
        ("premise = AB\nA>B : 1==1 = F(2)\nB = *", 1, DVec3::new(0.0, 2.0, 0.0)),
    ] {
        assert!((end(text, n) - want).length() < 1e-12, "{text} {}", end(text, n));
    }
    // ! and ? change the thickness, a second parameter sets it.
    let limbs = plant("thickness = 4\nthickness scale = .5\npremise = F!F?(.25)FF(1,3)", 0).limbs;
    let radii: Vec<f32> = limbs.iter().flat_map(|l| l.radii.clone()).collect();
    assert_eq!(radii, [2.0, 1.0, 1.0, 4.0, 1.5, 1.5]);
    // ~ turns by lots within its bound: the new heading is within three times the angle of the old.
    for seed in 0..20 {
        let mut grammar = read_in(Dialect::Houdini, "premise = ~(10)F").unwrap();
        grammar.seed = seed;
        let way = drawn(&grammar, 0).limbs[0].points[1];
        assert!(way.y >= 20f64.to_radians().cos() - 1e-12 && way.y < 1.0 - 1e-9, "{way}");
    }
    // Gravity turns what is level down: by g radians at a right angle to it.
    let way = end("angle = 90\npremise = +T(.5)F", 0);
    assert!((way - DVec3::new(0.5f64.cos(), -(0.5f64.sin()), 0.0)).length() < 1e-12, "{way}");
}

#[test]
fn faults_name_the_construct_and_its_place() {
    for (dialect, text, line, column, what) in [
        (Dialect::Fractint, "x {\nangle 2\naxiom F\n}", 2, 7, "whole number from 3"),
        (Dialect::Fractint, "x {\naxiom F\n}", 1, 1, "no angle"),
        (Dialect::Fractint, "x {\nangle 4\n}", 1, 1, "no axiom"),
        (Dialect::Fractint, "x {\nangle 4\naxiom F@F\n}", 3, 9, "@ has to be followed"),
        (Dialect::Fractint, "x {\nangle 4\naxiom F@1.2.3\n}", 3, 9, "1.2.3"),
        (Dialect::Fractint, "x {\nangle 4\naxiom F]\n}", 3, 8, "closes nothing"),
        (Dialect::Fractint, "x {\nangle 4\naxiom F F\n}", 3, 9, "end of the line"),
        (Dialect::Fractint, "x {\nangle 4\nfoo=F\n}", 3, 1, "foo is neither"),
        (Dialect::Fractint, "x {\nangle 4", 1, 3, "never closed"),
        (Dialect::Fractint, "", 1, 1, "no system"),
        (Dialect::Ini, "[L-System]\naxiom=F[", 2, 8, "never closed"),
        (Dialect::Ini, "[L-System]\naxiom=F\ncolor=red", 3, 1, "color is not known"),
        (Dialect::Ini, "[L-System]\naxiom=F\nrule0=FF", 3, 8, "where '>' should be"),
        (Dialect::Ini, "[L-System]\naxiom=F\nrule0=F>F\nrule1=F>G", 4, 7, "a second rule"),
        (Dialect::Ini, "[L-System]\naxiom=F\niterations=1.5", 3, 12, "whole number"),
        (Dialect::Ini, "[L-System]\nangle=x", 2, 7, "x is not a number"),
        (Dialect::Ini, "axiom=F", 1, 8, "no axiom in a section"),
        (Dialect::Houdini, "premise = F\nF", 2, 1, "neither a known value nor a rule"),
        (Dialect::Houdini, "premise = F!", 1, 11, "thickness scale"),
        (Dialect::Houdini, "premise = FT", 1, 11, "gravity"),
        (Dialect::Houdini, "premise = A(t)", 1, 13, "t is no parameter"),
        (Dialect::Houdini, "premise = A\nAB = F", 2, 1, "one symbol"),
        (Dialect::Houdini, "premise = A\nA(x) : x = 3 = F", 2, 12, "'3'"),
        (Dialect::Houdini, "generations = -1\npremise = A", 1, 15, "whole number"),
        (Dialect::Houdini, "A = F", 1, 5, "no premise"),
    ] {
        let fault = read_in(dialect, text).unwrap_err();
        assert!((fault.line, fault.column) == (line, column) && fault.what.contains(what), "{text:?}: {fault:?}");
    }
}

#[test]
fn notations_are_told_where_they_are_certain() {
    for (name, text, want) in [
        ("a.lsys", "axiom: F", Some(Dialect::Book)),
        ("a.lsys", "[L-System]", Some(Dialect::Book)),
        ("a.l", "\u{feff}Koch { ; x\r\n Angle 6\r\n Axiom F\r\n}", Some(Dialect::Fractint)),
        ("a.ls", "# x\n[L-System]\naxiom=F", Some(Dialect::Ini)),
        ("a.ls", "lsystem x {\n axiom: F;\n}", Some(Dialect::Rubberplant)),
        ("a.l", "/* x */\n#define N 3\nLsystem: 1\n", Some(Dialect::Cpfg)),
        ("a.lpy", "", Some(Dialect::Lpy)),
        ("a.l", "%{\n#include <x>\n%}\n%%", None),
        ("a.ls", "", None),
    ] {
        assert_eq!(detect(Path::new(name), text), want, "{name} {text:?}");
    }
    assert!(unknown().of_options && unknown().what.contains("fractint"));
}

proptest::proptest! {
    #[test]
    fn no_text_panics(text in "[FfXAIQ0-9+\\-\\[\\]{}<>@!|\\\\/c.()=:;~\"_?*$%\n ]{0,120}", i in 0usize..Dialect::ALL.len()) {
        let dialect = Dialect::ALL[i].0;
        let text = match dialect {
            Dialect::Fractint => format!("x {{\nangle 7\naxiom F\n{}}}", text.replace(['{', '}'], "")),
            Dialect::Ini => format!("[L-System]\naxiom=F\nrule0=F>{text}"),
            Dialect::Cpfg => format!("Lsystem: 1\nStart: {{x=1;}}\nAxiom: F\n{text}"),
            Dialect::Lpy => format!("Axiom: F\nproduction:\nF :\n  if 1:\n    nproduce F\n  produce {text}"),
            Dialect::Houdini => format!("angle scale=2\nstep size scale=2\nthickness scale=2\ngravity=1\npremise=F\n{text}"),
            _ => text,
        };
        if let Ok(grammar) = read_in(dialect, &text) {
            let mut turtle = Turtle::new(&grammar, 30.0);
            let mut budget = Budget::new(10_000, 1 << 20);
            let _ = derive(&grammar, 3, 0, &mut budget, &mut |s, a, b| turtle.symbol(s, a, b));
            turtle.finish();
        }
    }
}
