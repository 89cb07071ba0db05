//! `vtex bench` and `vtex stress` from the outside.

use assert_cmd::Command;

#[test]
fn a_bench_writes_its_points_and_plots() {
    let dir = tempfile::tempdir().unwrap();
    let words = ["bench", "-o", "b", "--quick", "--scene", "sheet", "--size", "96x54", "--samples", "4", "--quiet"];
    let vtex = || Command::new(env!("CARGO_BIN_EXE_vtex"));
    let run = |more: &[&str]| vtex().current_dir(dir.path()).args(words).args(more).assert().success();
    let printed = run(&[]);
    assert!(String::from_utf8_lossy(&printed.get_output().stdout).contains("neyret"));
    let csv = std::fs::read_to_string(dir.path().join("b/bench.csv")).unwrap();
    let flip = |row: &str| row.split(',').nth(13).and_then(|f| f.parse::<f64>().ok()).unwrap();
    // Two lane counts with and without triangles, three bakes, three pictures of other models and of a texel that is not
    // refined, and three traced baselines.
    assert_eq!(csv.lines().count(), 1 + 4 + 3 + 3 + 3, "{csv}");
    assert!(csv.lines().skip(1).all(|row| flip(row).is_finite()));
    let found = |start: &str| csv.lines().find(|l| l.starts_with(start)).map(flip).unwrap();
    assert!(found("sheet,render,coverage,128,10,all,4") < found("sheet,render,neyret,128,10,all,1"), "{csv}");
    assert!(dir.path().join("b/bench.svg").exists() && dir.path().join("b/bench.png").exists());
    // Again: nothing is baked or traced a second time.
    let made = |name: &str| std::fs::metadata(dir.path().join("b").join(name)).unwrap().modified().unwrap();
    let before = [made("sheet-128-coverage-10.vtex"), made("sheet-32x32.exr")];
    let told = run(&["--json"]);
    assert!(super::json::of("bench", &told.get_output().stdout)["points"].as_array().unwrap().len() > 10);
    assert_eq!([made("sheet-128-coverage-10.vtex"), made("sheet-32x32.exr")], before);
}

#[test]
fn stress_finds_nothing() {
    let words = ["stress", "--rays", "20000", "--seed", "5", "--json", "--quiet"];
    let run = Command::new(env!("CARGO_BIN_EXE_vtex")).args(words).assert().success();
    let found: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    assert_eq!(found["events"], 0);
    assert!(found["rays"].as_u64().unwrap() >= 20_000);
    Command::new(env!("CARGO_BIN_EXE_vtex")).args(["stress", "--rays", "0"]).assert().code(2);
}
