//! Derivations and drawings with known answers; grammars that are broken or without end.

use super::budget::Budget;
use super::derive::derive;
use super::grammar::Grammar;
use super::plant::Plant;
use super::turtle::Turtle;
use super::*;
use crate::geom::DVec3;

fn grammar(text: &str) -> Grammar {
    parser::grammar(text).unwrap_or_else(|f| panic!("{f:?} in\n{text}"))
}

fn budget() -> Budget {
    Budget::new(10_000_000, 1 << 28)
}

/// The string after `n` steps.
fn derived_by(grammar: &Grammar, n: u64, seed: u64) -> String {
    let mut out = String::new();
    derive(grammar, n, seed, &mut budget(), &mut |symbol, arguments, _| {
        out.push(symbol);
        if !arguments.is_empty() {
            let list: Vec<String> = arguments.iter().map(|a| format!("{}", (a * 1e6).round() / 1e6)).collect();
            out += &format!("({})", list.join(","));
        }
        Ok(())
    })
    .unwrap();
    out
}

fn derived(text: &str, n: u64) -> String {
    derived_by(&grammar(text), n, 0)
}

fn drawn(text: &str, n: u64) -> (Plant, Vec<DVec3>) {
    let grammar = grammar(text);
    let mut turtle = Turtle::new(&grammar, grammar.angle);
    derive(&grammar, n, 0, &mut budget(), &mut |s, a, b| turtle.symbol(s, a, b)).unwrap();
    let plant = turtle.finish();
    let points = plant.limbs.iter().flat_map(|l| l.points.clone()).collect();
    (plant, points)
}

fn length(plant: &Plant) -> f64 {
    let limb = |s: &crate::source::curve::Strand| s.points.windows(2).map(|w| (w[1] - w[0]).length()).sum::<f64>();
    plant.limbs.iter().map(limb).sum()
}

#[test]
fn algae() {
    // ABOP 1.2: lengths are Fibonacci's numbers.
    let text = "axiom: b\na -> ab\nb -> a";
    for (n, want) in ["b", "a", "ab", "aba", "abaab", "abaababa"].iter().enumerate() {
        assert_eq!(derived(text, n as u64), *want);
    }
    assert_eq!(derived(text, 20).len(), 10_946);
}

#[test]
fn anabaena() {
    // ABOP 1.5.
    let text = "ω: R\np1 : R → ML\np2 : M → S\np3 : S → RM\np4 : L → MR";
    for (n, want) in ["R", "ML", "SMR", "RMSML", "MLSRMSMR"].iter().enumerate() {
        assert_eq!(derived(text, n as u64), *want);
    }
}

#[test]
fn koch_island() {
    // ABOP fig. 1.6: every F becomes 8; the curve is closed.
    let text = "#angle 90\naxiom: F-F-F-F\nF -> F-F+F+FF-F-F+F";
    for n in 0..4 {
        let (plant, points) = drawn(text, n);
        assert_eq!(plant.counts.segments, 4 * 8u64.pow(n as u32));
        assert!((points[0] - *points.last().unwrap()).length() < 1e-9);
        assert_eq!(plant.limbs.len(), 1);
    }
    // The snowflake: 4 for 1, thirds; the end of a side of 3^n stays where it is.
    let (plant, points) = drawn("#angle 60\naxiom: F\nF -> F+F--F+F", 5);
    assert_eq!(plant.counts.segments, 1024);
    assert!((*points.last().unwrap() - DVec3::Y * 243.0).length() < 1e-9);
}

#[test]
fn dragon_and_hilbert() {
    // The ends of dragon curves: (1 + i)^n, turned by the axiom's heading.
    let text = "#angle 90\n#draw LR\naxiom: L\nL -> L+R+\nR -> -L-R";
    for n in 0..12u64 {
        let (plant, points) = drawn(text, n);
        assert_eq!(plant.counts.segments, 1 << n);
        let distance = points.last().unwrap().length();
        assert!((distance - 2f64.powf(n as f64 / 2.0)).abs() < 1e-9, "{n} {distance}");
    }
    // Hilbert's curve of order n visits 4^n places by unit steps within a square, and ends beside its start.
    let text = "#angle 90\naxiom: L\nL -> +RF-LFL-FR+\nR -> -LF+RFR+FL-";
    for n in 1..7u64 {
        let (plant, points) = drawn(text, n);
        let side = f64::from(1u32 << n) - 1.0;
        assert_eq!(plant.counts.segments, 4u64.pow(n as u32) - 1);
        let bounds = crate::geom::Aabb::around(points.iter().copied());
        assert_eq!(bounds.size(), DVec3::new(side, side, 0.0), "{n}");
        assert_eq!((*points.last().unwrap() - points[0]).length(), side);
    }
}

#[test]
fn the_turtle_turns_as_the_book_says() {
    let end = |text: &str| drawn(&format!("#angle 90\naxiom: {text}"), 0).1.last().copied().unwrap();
    assert_eq!(end("F"), DVec3::Y);
    assert_eq!(end("+F"), DVec3::NEG_X, "left");
    assert_eq!(end("-F"), DVec3::X, "right");
    assert_eq!(end("&F"), DVec3::NEG_Z, "down");
    assert_eq!(end("^F"), DVec3::Z, "up");
    assert_eq!(end("|F"), DVec3::NEG_Y);
    // Rolled left, its left looks down, so that turning left goes there.
    assert_eq!(end("\\+F"), DVec3::NEG_Z);
    assert_eq!(end("/+F"), DVec3::Z);
    assert_eq!(end("F(2)[+F]f(3)-(180)F(1)"), DVec3::Y * 4.0);
    // Level again after any roll: left is horizontal, so a pitch stays in the vertical plane.
    let p = end("-(30)/(77)$&(20)F");
    assert!(p.z.abs() < 1e-12 && (p.x - (50f64).to_radians().sin()).abs() < 1e-12, "{p}");
    assert!((end("+(30)F") - DVec3::new(-0.5, 0.75f64.sqrt(), 0.0)).length() < 1e-12);
}

#[test]
fn bracketed_plants() {
    // ABOP fig. 1.24: segments after n steps. a: 5^n; b: 5^n; c: 8^n; d, e: F doubles.
    for (text, n, want) in [
        ("axiom: F\nF -> F[+F]F[-F]F", 5, 3125),
        ("axiom: F\nF -> F[+F]F[-F][F]", 5, 3125),
        ("axiom: F\nF -> FF-[-F+F+F]+[+F-F-F]", 4, 4096),
        // x(n) = 2 (3^(n-1) 2^0 + …): X(n) = 3 X(n-1) + 2 · 2^(n-1).
        ("axiom: X\nX -> F[+X]F[-X]+X\nF -> FF", 7, 2 * (3u64.pow(7) - 2u64.pow(7))),
        ("axiom: X\nX -> F[+X][-X]FX\nF -> FF", 7, 2 * (3u64.pow(7) - 2u64.pow(7))),
        // X(n) = 4 X(n-1) + 3 · 2^(n-1).
        ("axiom: X\nX -> F-[[X]+X]+F[+FX]-X\nF -> FF", 5, 3 * (4u64.pow(5) - 2u64.pow(5)) / 2),
    ] {
        assert_eq!(drawn(text, n).0.counts.segments, want, "{text}");
    }
}

#[test]
fn parameters() {
    // ABOP 1.10.1, the example with conditions.
    let text = "axiom: B(2)A(4,4)
        A(x,y) : y <= 3 -> A(x*2, x+y)
        A(x,y) : y > 3 -> B(x)A(x/y, 0)
        B(x) : x < 1 -> C
        B(x) : x >= 1 -> B(x-1)";
    for (n, want) in
        ["B(2)A(4,4)", "B(1)B(4)A(1,0)", "B(0)B(3)A(2,1)", "CB(2)A(4,3)", "CB(1)A(8,7)", "CB(0)B(8)A(1.142857,0)"]
            .iter()
            .enumerate()
    {
        assert_eq!(derived(text, n as u64), *want);
    }
    // A row of trees, ABOP fig. 1.17: constants from constants.
    let text = "#define c 1\n#define p .3\n#define q c - p\n#define h (p * q)^0.5\n#angle 90\naxiom: F(1)
        F(x) -> F(x*p)+F(x*h)--F(x*h)+F(x*q)";
    let (_, points) = drawn(text, 4);
    assert!((*points.last().unwrap() - DVec3::Y).length() < 1e-12);
}

#[test]
fn a_cut_prunes_its_branch() {
    let text = "axiom: F[+A]F\nA -> F[-F]%F[F]F";
    assert_eq!(drawn(text, 1).0.counts.segments, 4);
    assert_eq!(drawn("axiom: F%F[F]F", 0).0.counts.segments, 1);
    // With a context somewhere the string is cut while it is derived.
    let text = "axiom: S[XYX%ABC]T\nQ < Q -> Q";
    assert_eq!(derived(text, 2), "S[XYX]T");
}

#[test]
fn contexts() {
    // ABOP 1.8: a signal runs from left to right.
    let text = "#ignore +-\naxiom: b+aa-a\nb < a -> b\nb -> a";
    for (n, want) in ["b+aa-a", "a+ba-a", "a+ab-a", "a+aa-b", "a+aa-a"].iter().enumerate() {
        assert_eq!(derived(text, n as u64), *want);
    }
    // ABOP fig. 1.30: the signal climbs the axes; branches get it from where they sit.
    let text = "#ignore +-\naxiom: J[+I]I[-I]I\nJ < I -> J";
    assert_eq!(derived(text, 1), "J[+J]J[-I]I");
    assert_eq!(derived(text, 2), "J[+J]J[-J]J");
    // ABOP 1.8's example: BC < S > G[H]M matches in ABC[DE][SG[HI[JK]L]MNO].
    let text = "axiom: ABC[DE][SG[HI[JK]L]MNO]\nBC < S > G[H]M -> X";
    assert_eq!(derived(text, 1), "ABC[DE][XG[HI[JK]L]MNO]");
    assert_eq!(derived("axiom: ABC[DE][SG[II]MNO]\nBC < S > G[H]M -> X", 1), "ABC[DE][SG[II]MNO]");
    // Parameters of contexts, ABOP 1.10.1.
    let text = "axiom: A(1)B(4)C(5)\nA(x) < B(y) > C(z) : x+y+z > 9 -> E((x+y)/2)F((y+z)/2)";
    assert_eq!(derived(text, 1), "A(1)E(2.5)F(4.5)C(5)");
    // What has a context goes before what has none, wherever it is written.
    assert_eq!(derived("axiom: AB\nB -> X\nA < B -> Y", 1), "AY");
    assert_eq!(derived("#consider AB\naxiom: A+x-B\nA < B -> Y", 1), "A+x-Y");
}

#[test]
fn hogeweg_and_hesper() {
    // ABOP fig. 1.31 a: the classical 2L-system; 0 and 1 are symbols.
    let text = "#ignore +-F\naxiom: F1F1F1
        0<0>0 -> 0
        0<0>1 -> 1[+F1F1]
        0<1>0 -> 1
        0<1>1 -> 1
        1<0>0 -> 0
        1<0>1 -> 1F1
        1<1>0 -> 0
        1<1>1 -> 0
        + -> -
        - -> +";
    // The ends have neighbours on one side only, so nothing matches them: 1 in the middle has 1 on both sides.
    assert_eq!(derived(text, 1), "F1F0F1");
    assert_eq!(derived(text, 2), "F1F1F1F1");
    assert_eq!(derived(text, 3), "F1F0F0F1");
}

#[test]
fn lots_repeat_and_are_shared_out() {
    let g = grammar("axiom: A\nA -> BA : 0.25\nA -> CA : .75");
    let a = derived_by(&g, 2000, 1);
    assert_eq!(a, derived_by(&g, 2000, 1));
    assert_ne!(a, derived_by(&g, 2000, 2));
    let b = a.matches('B').count() as f64;
    // Deviation of the count: sqrt(2000 · 3/16) = 19.
    assert!((b - 500.0).abs() < 80.0, "{b}");
    // Conditions by lot are asked again at every step.
    let text = "axiom: A\nA : ran(1) < .1 -> B";
    assert_eq!(derived(text, 1000), "B");
    assert_eq!(derived("axiom: A\nA -> B : 0", 3), "A", "nothing is likely");
}

#[test]
fn the_homomorphism_is_applied_at_the_end_from_above_to_below() {
    let text = "axiom: A\nA -> [A]A\n#homomorphism\nA -> B(2)A\nB(x) -> {.F(x).}B(x)A";
    let drawn = "{.F(2).}B(2)AA";
    assert_eq!(derived(text, 1), format!("[{drawn}]{drawn}"));
    assert_eq!(derived(&format!("{text}\n#homomorphism\n"), 0), drawn);
    let in_context = text.replace("[A]A", "[A]A\nZ < Z -> Z");
    assert_eq!(derived(&in_context, 1), format!("[{drawn}]{drawn}"));
}

#[test]
fn widths_taper_and_colours_part() {
    let (plant, _) = drawn("#width 2, .5\n#colour 0 #ff0000\n#colour 2 #0000ff\naxiom: F!F!F'F", 0);
    assert_eq!(plant.limbs.len(), 2);
    assert_eq!(plant.limbs[0].radii, [1.0, 0.5, 0.25, 0.25]);
    assert_eq!(plant.limbs[1].radii, [0.25, 0.25]);
    assert_eq!(plant.limbs[1].colours, [[0.5, 0.0, 0.5, 1.0]]);
    // A width at the end makes a cone; what gets wider begins anew.
    let (plant, _) = drawn("axiom: !(2)F(3,1)F!(4)F!(.2)F(1,0)", 0);
    let radii: Vec<_> = plant.limbs.iter().map(|l| l.radii.clone()).collect();
    assert_eq!(radii, [vec![1.0, 0.5, 0.5], vec![2.0, 0.1, 0.0]]);
}

#[test]
fn polygons_and_surfaces() {
    // ABOP's leaf of six edges of 22.5°, closed: its area by the shoelace formula.
    let (plant, _) = drawn("#angle 22.5\naxiom: {-f+f+f-|-f+f+f}", 0);
    let area: f64 = plant.polygons[&0].triangles.iter().map(|t| area(&plant, t)).sum();
    let a = 22.5f64.to_radians();
    // Two parallelogram halves around a rectangle: width sin a on each side, heights cos a + 1 on average.
    assert!((area - 2.0 * a.sin() * (a.cos() + 1.0)).abs() < 1e-6, "{area}");
    assert_eq!((plant.counts.polygons, plant.polygons[&0].triangles.len()), (1, 4));
    // The same corner given from a branch; G leaves none.
    let (plant, _) = drawn("#angle 90\naxiom: {.[+f]G(2).-f(2).}", 0);
    assert_eq!(plant.polygons[&0].positions.len(), 4);
    // A surface: x to the right, y ahead, scaled.
    let (plant, _) = drawn("#surface L { -1 0, 1 0, 0 2 .5 } #00ff00\n#angle 90\naxiom: -f~L(2)", 0);
    let corners: Vec<DVec3> = plant.polygons[&0].positions.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
    assert_eq!(corners, [DVec3::new(1.0, 2.0, 0.0), DVec3::new(1.0, -2.0, 0.0), DVec3::new(5.0, 0.0, 1.0)]);
    assert_eq!(plant.polygons[&0].colors.as_ref().unwrap()[0], [0.0, 1.0, 0.0, 1.0]);
    // Braces that do not match are told.
    let (plant, _) = drawn("axiom: }{.F.", 0);
    assert_eq!(plant.warnings.iter().count(), 2);
}

fn area(plant: &Plant, t: &[u32; 3]) -> f64 {
    let [a, b, c] = t.map(|i| DVec3::from(plant.polygons[&0].positions[i as usize].map(f64::from)));
    0.5 * (b - a).cross(c - a).length()
}

#[test]
fn tropism_bends_by_the_torque() {
    // One horizontal segment, then bent down by e · |H × T| = .1 · 2: the length of T counts.
    let (_, points) = drawn("#tropism 0, -2, 0, .1\naxiom: +(90)F(1)F(1)", 0);
    let way = points[2] - points[1];
    assert!((way - DVec3::new(-(0.2f64.cos()), -(0.2f64.sin()), 0.0)).length() < 1e-12, "{way}");
    // Four segments that turn from 45° off the vertical towards T = (0, −2, 0): the angle grows by .44 · sin after each.
    let (_, points) = drawn("#tropism 0,-2,0,.22\naxiom: +(45)FFFF", 0);
    let mut angle = std::f64::consts::FRAC_PI_4;
    let mut end = DVec3::ZERO;
    for _ in 0..4 {
        end += DVec3::new(-angle.sin(), angle.cos(), 0.0);
        angle += 0.44 * angle.sin();
    }
    assert!((points[4] - end).length() < 1e-12, "{} {end}", points[4]);
}

#[test]
fn faults_point_at_the_character() {
    for (text, line, column, what) in [
        ("axiom: F\nF -> F=F", 2, 7, "'='"),
        ("axiom: F\nF -> F[+F", 2, 7, "never closed"),
        ("axiom: F+F]", 1, 11, "closes nothing"),
        ("axiom: F\nF(x) -> F(y)", 2, 11, "y is no parameter"),
        ("axiom: F(1\nF -> F", 1, 11, "where"),
        ("#angel 20\naxiom: F", 1, 1, "#angel is not known"),
        ("axiom: F\naxiom: G", 2, 1, "second axiom"),
        ("F -> FF", 1, 1, "no axiom"),
        ("", 1, 1, "no axiom"),
        ("axiom: F\nFG -> F", 2, 1, "one symbol"),
        ("axiom: F\n -> F", 2, 2, "symbol"),
        ("axiom: F\nF(x,x) -> F", 2, 5, "second parameter x"),
        ("axiom: F\nF : 1 + -> F", 2, 9, "the end"),
        ("axiom: F\nF -> F : 0.3 0.4", 2, 14, "'0'"),
        ("axiom: ~L", 1, 9, "no #surface L"),
        ("axiom: ~", 1, 9, "surface"),
        ("#surface L { 0 0, 1 x }\naxiom: F", 1, 21, "a number"),
        ("#iterations 2.5\naxiom: F", 1, 13, "whole number"),
        ("#define x 1/0\naxiom: F", 1, 11, "finite"),
        ("#colour 1 #12345\naxiom: F", 1, 11, "six digits"),
        ("axiom: F /* ", 1, 10, "never closed"),
        ("axiom: F\u{0}G", 1, 9, "U+0000"),
        ("#axiom F\n[A] < F -> F", 2, 1, "left context"),
    ] {
        let fault = parser::grammar(text).unwrap_err();
        assert!((fault.line, fault.column) == (line, column) && fault.what.contains(what), "{text:?}: {fault:?}");
        assert!(!fault.what.contains('\n'));
    }
}

#[test]
fn grammars_without_end_are_stopped() {
    let run = |text: &str, n: u64, symbols: u64, bytes: u64| {
        let grammar = grammar(text);
        let mut turtle = Turtle::new(&grammar, 90.0);
        derive(&grammar, n, 0, &mut Budget::new(symbols, bytes), &mut |s, a, b| turtle.symbol(s, a, b))
    };
    for (text, n, symbols, bytes) in [
        ("axiom: F\nF -> F", 1_000_000_000, 1_000_000, 1 << 20),
        ("axiom: F\nF -> FF", 1_000_000_000, 1_000_000, 1 << 30),
        // Depth first, frames pile up; so do strings, brackets, corners and limbs.
        ("axiom: A\nA -> AF", 1_000_000_000, u64::MAX, 1 << 20),
        ("axiom: A\nB < A -> B\nA -> AA", 1_000, u64::MAX, 1 << 20),
        ("axiom: A\nA -> {A", 1_000_000_000, u64::MAX, 1 << 20),
        ("axiom: {A\nA -> fA", 1_000_000_000, u64::MAX, 1 << 30),
        ("axiom: A\nA -> FA", 1_000_000_000, u64::MAX, 1 << 20),
        ("axiom: F(1)\nF(x) -> F(x*100)", 100, 1000, 1 << 20),
        // Contexts that look far: looking counts too.
        ("#ignore F\naxiom: A\nA -> AF\nA < F -> F", 100_000, 1_000_000, 1 << 30),
    ] {
        assert!(matches!(run(text, n, symbols, bytes), Err(Error::Limit { .. })), "{text}");
    }
    let deep = format!("axiom: {}F{}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(run(&deep, 0, u64::MAX, 1 << 30).is_ok());
    assert!(matches!(run(&deep, 0, u64::MAX, 1 << 20), Err(Error::Limit { .. })));
    let wide = format!("axiom: F{}", "+".repeat(100_000));
    assert!(run(&wide, 0, u64::MAX, 1 << 20).is_ok());
}

proptest::proptest! {
    #[test]
    fn no_text_panics(text in "[FfAB+\\-\\[\\]{}.!'$%~ \n#:<>(),0-9x*a-z]{0,120}") {
        if let Ok(grammar) = parser::grammar(&text) {
            let mut turtle = Turtle::new(&grammar, 30.0);
            let mut budget = Budget::new(10_000, 1 << 20);
            let _ = derive(&grammar, 3, 0, &mut budget, &mut |s, a, b| turtle.symbol(s, a, b));
            turtle.finish();
        }
    }

    #[test]
    fn the_length_of_a_straight_stem(n in 1usize..40, l in 0.1f64..10.0) {
        let (plant, _) = drawn(&format!("axiom: {}", format!("F({l})").repeat(n)), 0);
        proptest::prop_assert!((length(&plant) - n as f64 * l).abs() < 1e-9 * n as f64 * l);
        proptest::prop_assert_eq!(plant.limbs.len(), 1);
    }
}

// Figures of the book: counts, ends and extents in closed form.

#[test]
fn a_curve_fills_the_cube() {
    // Fig. 1.19: Hilbert's curve in three dimensions, of order n: 8^n places, each once, by unit steps.
    let text = "#angle 90
        axiom: A
        A -> B-F+CFC+F-D&F^D-F+&&CFC+F+B//
        B -> A&F^CFB^F^D^^-F-D^|F^B|FC^F^A//
        C -> |D^|F^B-F+C^F^A&&FA&F^C+F+B^F^D//
        D -> |CFB-F+B|FA&F^A&&FB-F+B|FC//";
    for n in 1..4u64 {
        let (plant, points) = drawn(text, n);
        assert_eq!(plant.counts.segments, 8u64.pow(n as u32) - 1);
        let side = f64::from(1u32 << n) - 1.0;
        let bounds = crate::geom::Aabb::around(points.iter().copied());
        assert!((bounds.size() - side).abs().max_element() < 1e-9, "{n} {}", bounds.size());
        let mut places: Vec<[i64; 3]> = points.iter().map(|p| (*p - bounds.min).round().as_i64vec3().into()).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), 8usize.pow(n as u32));
    }
}

#[test]
fn curves_end_where_they_should() {
    // Fig. 1.11 a: the hexagonal Gosper curve: 7 for 1, ends √7 times as far apart.
    let text = "#angle 60\n#draw LR\naxiom: L\nL -> L+R++R-L--LL-R+\nR -> -L+RR++R+L--L-R";
    for n in 0..5u64 {
        let (plant, points) = drawn(text, n);
        assert_eq!(plant.counts.segments, 7u64.pow(n as u32));
        let distance = (*points.last().unwrap() - points[0]).length();
        assert!((distance / 7f64.powf(0.5 * n as f64) - 1.0).abs() < 1e-9, "{n} {distance}");
    }
    // Fig. 1.8: islands and lakes: 18 lines for 1, and moves that leave gaps; it closes.
    let text = "#angle 90\naxiom: F+F+F+F\nF -> F+f-FF+F+FF+Ff+FF-f+FF-F-FF-Ff-FFF\nf -> ffffff";
    let (plant, points) = drawn(text, 2);
    assert_eq!(plant.counts.segments, 4 * 18 * 18);
    assert!((*points.last().unwrap() - points[0]).length() < 1e-9);
    assert!(plant.limbs.len() > 4, "{}", plant.limbs.len());
    // Fig. 1.10 b: the Sierpiński gasket: 3 for 1 over twice the distance.
    let (plant, points) = drawn("#angle 60\n#draw LR\naxiom: R\nL -> R+L+R\nR -> L-R-L", 6);
    assert_eq!(plant.counts.segments, 729);
    assert!(((*points.last().unwrap() - points[0]).length() - 64.0).abs() < 1e-9);
}

#[test]
fn the_bush() {
    // Fig. 1.25: seven steps. F grows as Fibonacci's numbers, each with the leaves that its S became.
    let text = "#angle 22.5
        axiom: A
        A -> [&FL!A]/////'[&FL!A]///////'[&FL!A]
        F -> S/////F
        S -> FL
        L -> ['''^^{-f+f+f-|-f+f+f}]";
    // Segments and leaves after n steps of A, F, S, L.
    let mut counts = [[0u64, 0], [1, 0], [0, 0], [0, 0]];
    for n in 1..=7 {
        let [a, f, s, l] = counts;
        let sum = |x: [u64; 2], y: [u64; 2]| [x[0] + y[0], x[1] + y[1]];
        counts = [sum(sum(a, f), l).map(|v| 3 * v), sum(s, f), sum(f, l), [0, 1]];
        let (plant, _) = drawn(text, n);
        assert_eq!([plant.counts.segments, plant.counts.polygons], counts[0], "{n}");
    }
    assert_eq!(counts[0][0], 3891);
}

#[test]
fn trees_with_one_axis() {
    // Fig. 2.6 (Honda; Aono and Kunii): A sends out B, and B and C fork: 2^n − 1 segments.
    let text = "#define r1 .9\n#define r2 .6\n#define a0 45\n#define a2 45\n#define d 137.5\n#define wr .707
        axiom: A(1,10)
        A(l,w) : * -> !(w)F(l)[&(a0)B(l*r2,w*wr)]/(d)A(l*r1,w*wr)
        B(l,w) : * -> !(w)F(l)[-(a2)$C(l*r2,w*wr)]C(l*r1,w*wr)
        C(l,w) : * -> !(w)F(l)[+(a2)$B(l*r2,w*wr)]B(l*r1,w*wr)";
    let (plant, points) = drawn(text, 10);
    assert_eq!(plant.counts.segments, 1023);
    // The axis rises straight: 1 + r1 + r1² …; widths shrink by wr.
    let height = points.iter().map(|p| p.y).fold(0.0, f64::max);
    assert!((height - (1.0 - 0.9f64.powi(10)) / 0.1).abs() < 1e-9, "{height}");
    let trunk = plant.limbs.iter().find(|l| l.points[0] == DVec3::ZERO).unwrap();
    assert_eq!(trunk.points.len(), 11);
    for (i, r) in trunk.radii.iter().take(10).enumerate() {
        assert!((f64::from(*r) / (5.0 * 0.707f64.powi(i as i32)) - 1.0).abs() < 1e-6);
    }
    // Side branches leave at 45°, turned by 137.5° about the axis each: heading and roll of the first two.
    let ends: Vec<DVec3> = (0..2)
        .map(|i| {
            let base = trunk.points[i + 1];
            let limb = plant.limbs.iter().find(|l| l.points[0] == base && l.points.len() > 1).unwrap();
            (limb.points[1] - base).normalize()
        })
        .collect();
    assert!(ends.iter().all(|e| (e.y - 0.5f64.sqrt()).abs() < 1e-9), "{ends:?}");
    let flat = |e: DVec3| DVec3::new(e.x, 0.0, e.z).normalize();
    let turned = flat(ends[0]).dot(flat(ends[1])).acos().to_degrees();
    assert!((turned - 137.5).abs() < 1e-6, "{turned}");
}

#[test]
fn trees_that_fork() {
    // Fig. 2.7 a (sympodial): both branches fork on; 2^n − 1 segments of length (r1 + r2)^k together.
    let text = "#define r1 .9\n#define r2 .7\n#define a1 5\n#define a2 65\n#define wr .707
        axiom: A(1,10)
        A(l,w) : * -> !(w)F(l)[&(a1)B(l*r1,w*wr)]/(180)[&(a2)B(l*r2,w*wr)]
        B(l,w) : * -> !(w)F(l)[+(a1)$B(l*r1,w*wr)][-(a2)$B(l*r2,w*wr)]";
    let (plant, _) = drawn(text, 10);
    assert_eq!(plant.counts.segments, 1023);
    let want = (1.6f64.powi(10) - 1.0) / 0.6;
    assert!((length(&plant) / want - 1.0).abs() < 1e-9);
    // Fig. 2.8 a (ternary): three branches at each fork; what is there grows by lr a step, and widths by vr.
    let text = "#define d1 94.74\n#define d2 132.63\n#define a 18.95\n#define lr 1.109\n#define vr 1.732
        axiom: !(1)F(200)/(45)A
        A : * -> !(vr)F(50)[&(a)F(50)A]/(d1)[&(a)F(50)A]/(d2)[&(a)F(50)A]
        F(l) : * -> F(l*lr)
        !(w) : * -> !(w*vr)";
    let n = 6i32;
    let (plant, _) = drawn(text, n as u64);
    assert_eq!(plant.counts.segments, 1 + 2 * (3u64.pow(n as u32) - 1));
    let added: f64 = (0..n).map(|k| 200.0 * 3f64.powi(k) * 1.109f64.powi(n - 1 - k)).sum();
    let want = 200.0 * 1.109f64.powi(n) + added;
    assert!((length(&plant) / want - 1.0).abs() < 1e-9, "{}", length(&plant));
    let widest = plant.limbs.iter().flat_map(|l| &l.radii).fold(0f32, |a, b| a.max(*b));
    assert!((2.0 * f64::from(widest) / 1.732f64.powi(n) - 1.0).abs() < 1e-6, "{widest}");
}

#[test]
fn a_backslash_breaks_a_line_and_is_a_symbol_elsewhere() {
    let whole = drawn("#define a 30\n#iterations 1\naxiom: X\nX -> F(1)+(a)F(1)", 1).1;
    let text = "\u{feff}#define a 10 + \\\r\n  20\n#iterations 1\naxiom: X\nX -> F(1) \\ \n  +(a)F(1)";
    assert_eq!(drawn(text, 1).1, whole);
    // At the end of a production it rolls: what turns up without it turns left.
    let rolled = drawn("axiom: XF(1)\nX -> \\\nF(x) -> +(90)F(x)", 1).1;
    let before = drawn("axiom: XF(1)\nX -> \\ \nF(x) -> +(90)F(x)", 1).1;
    assert_eq!(rolled, before);
    assert!((rolled[1] - rolled[0] - DVec3::Z).length() < 1e-9 || (rolled[1] - rolled[0] + DVec3::Z).length() < 1e-9);
}
