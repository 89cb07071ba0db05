//! The README's main command, from the samples to pictures that show a forest; and drafts of the other landscapes.

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

/// Where a landscape's draft shows its sky, if it has one, and the mean and spread of its brightness are those of a picture that
/// shows something: none of them is black, white or of one colour.
fn draft(name: &str, picture: &str, moves: bool) {
    let folder = tempfile::tempdir().unwrap();
    let size = ["--draft", "--size", "64x36", "-o", "out"];
    let mut vtex = Command::cargo_bin("vtex").unwrap();
    let run = vtex.current_dir(&folder).args(["demo", name]).args(size).assert().success().get_output().clone();
    let said = String::from_utf8(run.stderr).unwrap();
    // What a script brings about should not make the program warn; but shells end where their grounds do, out of the picture.
    let warns = |line: &&str| {
        line.contains("warning:") && !line.contains("stand where it or its texture coordinates end are cut")
    };
    assert_eq!(said.lines().find(warns), None, "{name}: {said}");
    let bytes = std::fs::read(folder.path().join("out").join(picture)).unwrap();
    let seen = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png).unwrap().to_luma32f();
    assert_eq!(seen.dimensions(), (64, 36));
    let mean = seen.pixels().map(|p| p[0]).sum::<f32>() / (64.0 * 36.0);
    let spread = seen.pixels().map(|p| (p[0] - mean).abs()).sum::<f32>() / (64.0 * 36.0);
    assert!((0.08..0.9).contains(&mean) && spread > 0.03, "{name}: {mean} {spread}");
    assert_eq!(bytes.windows(4).any(|w| w == b"acTL"), moves, "{name}: animated or not");
}

#[test]
fn drafts_of_meshes_are_pictures() {
    draft("lawn", "lawn.png", false);
    draft("teddy", "teddy.png", false);
    draft("wind", "wind.apng", true);
}

#[test]
fn drafts_of_mountains_and_of_the_crypt_are_pictures() {
    draft("mountains", "mountains.png", false);
    draft("crypt", "crypt.png", false);
}

#[test]
fn drafts_of_many_trees_are_pictures() {
    draft("trees", "trees.png", false);
    draft("million", "million.png", false);
    draft("zoom", "zoom.apng", true);
}
