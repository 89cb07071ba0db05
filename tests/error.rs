//! `vtex error` from the outside: what it prints, draws, warns of and refuses.

use assert_cmd::Command;
use serde_json::Value;

fn vtex(dir: &std::path::Path, args: &[&str]) -> assert_cmd::assert::Assert {
    Command::new(env!("CARGO_BIN_EXE_vtex")).current_dir(dir).args(args).assert()
}

#[test]
fn a_texel_is_measured_against_its_source() {
    let dir = tempfile::tempdir().unwrap();
    let samples = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/");
    let (fern, tree) = (format!("{samples}fern.glb"), format!("{samples}tree.glb"));
    vtex(dir.path(), &["bake", &fern, "-r", "32", "-o", "fern.vtex", "--quiet"]).success();
    let words = ["error", "fern.vtex", "--source", &fern, "--pixels", "8", "--rays", "64", "--depths", "3", "--strict"];
    let run = vtex(dir.path(), &[&words[..], &["--json", "--plot", "e.svg"]].concat()).success();
    let found: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let depths = found["depths"].as_array().unwrap();
    assert_eq!(depths.iter().map(|d| d["depth"].as_u64().unwrap()).collect::<Vec<_>>(), [3, 4, 5]);
    for d in depths {
        // Alpha-masked cards: were they measured as whole rectangles, nothing would agree.
        assert!(d["opacity"]["mean"].as_f64().unwrap() < 0.08, "{d}");
        assert!((d["opacity"]["area"].as_f64().unwrap() - 1.0).abs() < 0.1, "{d}");
        for key in ["/opacity/p95", "/opacity/bias", "/sigma/mean", "/sigma/p95", "/albedo/mean", "/shadow/mean"] {
            assert!(d.pointer(key).and_then(Value::as_f64).is_some_and(f64::is_finite), "{key}: {d}");
        }
        assert!(d["albedo"]["mean"].as_f64().unwrap() < 0.05, "{d}");
    }
    assert!(std::fs::read_to_string(dir.path().join("e.svg")).unwrap().contains("</svg>"));
    // The same figures again, as a table.
    let table = vtex(dir.path(), &words).success();
    let first = format!("{:.3}", depths[0]["opacity"]["mean"].as_f64().unwrap());
    assert!(String::from_utf8_lossy(&table.get_output().stdout).contains(&first));
    // Another file is measured, with a word; under --strict it is refused. So is a plot of another kind.
    let other = ["error", "fern.vtex", "--source", &tree, "--pixels", "1", "--depths", "1", "--rays", "4"];
    let run = vtex(dir.path(), &other).success();
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains("is not the file"));
    vtex(dir.path(), &[&other[..], &["--strict"]].concat()).code(1);
    vtex(dir.path(), &[&words[..], &["--plot", "e.pdf"]].concat()).code(2);
    vtex(dir.path(), &[&words[..], &["--line-width", "0.1"]].concat()).code(1);
}

/// Blocks that are right each for itself leak where a sheet goes on from one to the next; only groups of them can tell.
#[test]
fn a_sheet_across_the_grid_does_not_leak() {
    let dir = tempfile::tempdir().unwrap();
    let corners = [(0.121, 0.456, 0.816), (0.792, 0.255, 0.816), (0.879, 0.544, 0.184), (0.208, 0.745, 0.184)];
    let obj: String = corners.iter().map(|(x, y, z)| format!("v {x} {y} {z}\n")).collect();
    std::fs::write(dir.path().join("sheet.obj"), obj + "f 1 2 3 4\n").unwrap();
    vtex(dir.path(), &["bake", "sheet.obj", "-r", "128", "-o", "sheet.vtex", "--quiet"]).success();
    let words = ["error", "sheet.vtex", "--source", "sheet.obj", "--turned", "--pixels", "16", "--rays", "64"];
    let run = vtex(dir.path(), &[&words[..], &["--depths", "1", "--json"]].concat()).success();
    let found: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let opacity = &found["depths"][0]["opacity"];
    let (area, mean) = (opacity["area"].as_f64().unwrap(), opacity["mean"].as_f64().unwrap());
    // .986 and .0266; groups of half as many lines give .980 and .0306.
    assert!((area - 1.0).abs() < 0.017 && mean < 0.0285, "{opacity}");
}
