//! The README's main command, from the samples to pictures that show a forest.

use assert_cmd::Command;

#[test]
fn the_demo_makes_pictures_of_a_forest() {
    let folder = tempfile::tempdir().unwrap();
    let run = Command::cargo_bin("vtex")
        .unwrap()
        .current_dir(&folder)
        .args(["demo", "--size", "96x54", "--json"])
        .assert()
        .success()
        .get_output()
        .clone();
    let told = super::json::of("demo", &run.stdout);
    assert_eq!(told["pictures"], serde_json::json!(["vtex-demo/near.png", "vtex-demo/far.png"]));
    let said = String::from_utf8(run.stderr).unwrap();
    assert!(said.contains("pictures: vtex-demo/near.png and vtex-demo/far.png"), "{said}");
    for name in ["near", "far"] {
        let picture = image::open(folder.path().join(format!("vtex-demo/{name}.png"))).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (96, 54));
        let green = picture.pixels().filter(|p| p[1] > p[0] && p[1] > p[2]).count();
        let sky = picture.pixels().filter(|p| p[2] > p[0] && p[2] > p[1]).count();
        // Forest and meadow fill most of both views; the sky is the upper third.
        assert!(green > 96 * 54 / 3, "{name}: {green} green pixels");
        assert!(sky > 96 * 54 / 10, "{name}: {sky} of sky");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path().join("vtex-demo")).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(left.iter().all(|p| p.extension().is_none_or(|e| e != "part")), "{left:?}");
}
