//! `vtex render --tile` and `vtex stitch`: the picture that is put together has the bytes of the one made whole.

use crate::outputs::Folder;

/// Rows and columns that no block of pixels ends at, over a picture of 50×36.
const TILES: [&str; 5] = ["0,0,17,23", "17,0,33,9", "17,9,32,14", "49,9,1,14", "0,23,50,13"];

/// A landscape whose texels stand before a camera that sees ground, sky and what is near.
fn landscape() -> Folder {
    let folder = Folder::with_landscape();
    folder.succeeds(&[
        "map",
        "ground.gltf",
        "--texel",
        "quad.vtex",
        "--planar",
        "y",
        "--cell",
        "0.4",
        "-o",
        "w.gltf",
        "--wind",
        "0.5",
    ]);
    folder
}

const VIEW: [&str; 6] = ["w.gltf", "--eye=-1,1.5,5", "--look-at", "2,0,2", "--size", "50x36"];

/// The picture made whole, and the one of tiles.
fn both(folder: &Folder, options: &[&str], ending: &str) -> [Vec<u8>; 2] {
    let [whole, stitched] = ["whole", "stitched"].map(|name| format!("{name}.{ending}"));
    let render = [&["render"], &VIEW[..], options].concat();
    folder.succeeds(&[&render[..], &["-o", &whole]].concat());
    let names = TILES.map(|tile| format!("t.{tile}.{ending}"));
    for (tile, name) in TILES.iter().zip(&names) {
        folder.succeeds(&[&render[..], &["--tile", tile, "-o", name]].concat());
    }
    let names: Vec<&str> = names.iter().rev().map(String::as_str).collect();
    folder.succeeds(&[&["stitch"], &names[..], &["-o", &stitched]].concat());
    [whole, stitched].map(|name| std::fs::read(folder.path(&name)).unwrap())
}

#[test]
fn tiles_make_the_picture() {
    let folder = landscape();
    let cases: [(&[&str], &str); 4] = [
        (&["--lanes", "4"], "png"),
        (&["--sky", "clear", "--sun", "20,120", "--haze", "20", "--time", "0.3", "--lanes", "2"], "exr"),
        (&["--exposure", "auto", "--tonemap", "agx", "--ambient", "occluded"], "png"),
        (&["--near", "voxels", "--threads", "1", "--depth-bias", "1"], "exr"),
    ];
    for (options, ending) in cases {
        let [whole, stitched] = both(&folder, options, ending);
        assert!(whole == stitched, "{options:?}");
    }
}

/// Other programs find the place of a tile in an EXR's windows.
#[test]
fn an_exr_tile_lies_in_its_display_window() {
    let folder = landscape();
    folder.succeeds(&[&["render"], &VIEW[..], &["--tile", "17,9,32,14", "-o", "t.exr"]].concat());
    let meta = exr::meta::MetaData::read_from_file(folder.path("t.exr"), true).unwrap();
    let header = &meta.headers[0];
    let display = header.shared_attributes.display_window;
    assert_eq!((display.position.0, display.position.1, display.size.0, display.size.1), (0, 0, 50, 36));
    let at = header.own_attributes.layer_position;
    assert_eq!((at.0, at.1, header.layer_size.0, header.layer_size.1), (17, 9, 32, 14));
}

#[test]
fn frames_are_stitched_by_their_numbers() {
    let folder = landscape();
    let frames = ["--frames", "3-4", "--fps", "2"];
    folder.succeeds(&[&["render"], &VIEW[..], &frames, &["-o", "whole.##.png"]].concat());
    for (tile, name) in [("0,0,50,10", "a.##.png"), ("0,10,50,26", "b.##.png")] {
        folder.succeeds(&[&["render"], &VIEW[..], &frames, &["--tile", tile, "-o", name]].concat());
    }
    folder.succeeds(&["stitch", "b.##.png", "a.##.png", "--frames", "3-4", "-o", "s.##.png", "--depfile", "s.d"]);
    for n in ["03", "04"] {
        let [whole, stitched] =
            ["whole", "s"].map(|name| std::fs::read(folder.path(&format!("{name}.{n}.png"))).unwrap());
        assert!(whole == stitched, "{n}");
    }
    let rules = std::fs::read_to_string(folder.path("s.d")).unwrap();
    assert!(rules.contains("s.04.png: b.04.png \\\n  a.04.png"), "{rules}");

    // What is there is kept, if it has the size that is asked for.
    let again = |tile: &str| {
        let (code, _, said) =
            folder.run(&[&["render"], &VIEW[..], &frames, &["--tile", tile, "-o", "a.##.png"]].concat());
        assert_eq!(code, 0, "{said}");
        said
    };
    assert!(again("0,0,50,10").contains("2 frames that were there already are kept"));
    assert!(!again("0,0,50,11").contains("kept"));
    // A line for each frame, and one for all.
    let (code, _, error) = folder.run(&["stitch", "b.##.png", "a.##.png", "--frames", "3-4", "-o", "s.##.png"]);
    let said = |line: &str| error.contains(line);
    assert!(code == 1 && said("a.03.png: overlaps b.03.png") && said("2 of 2 inputs failed"), "{error}");
    let error = folder.fails(2, &["stitch", "b.03.png", "a.##.png", "--frames", "3-4", "-o", "s.##.png"]);
    assert!(error.contains("b.03.png: --frames needs a place for the number"), "{error}");
}

#[test]
fn tiles_that_do_not_fit_are_one_line() {
    let folder = landscape();
    let render = |more: &[&str]| folder.succeeds(&[&["render"], &VIEW[..], more].concat());
    render(&["--tile", "0,0,50,10", "-o", "a.png"]);
    render(&["--tile", "0,10,50,26", "-o", "b.png"]);
    render(&["--tile", "0,10,50,26", "-o", "later.png", "--time", "2"]);
    render(&["--tile", "0,10,50,26", "-o", "brighter.png", "--exposure", "1"]);
    render(&["--tile", "0,10,50,26", "-o", "one.png", "--threads", "1", "--memory", "1G"]);
    folder.succeeds(&["stitch", "a.png", "one.png", "-o", "ab.png"]);
    let refused = |code: i32, tiles: &[&str], what: &str| {
        let error = folder.fails(code, &[&["stitch"], tiles, &["-o", "out.png"]].concat());
        assert!(error.contains(what), "{error}");
        assert!(!folder.path("out.png").exists());
    };
    refused(1, &["a.png"], "out.png: pixel 0,10 of 50×36 is in none of the 1 tiles");
    refused(1, &["a.png", "b.png", "one.png"], "one.png: overlaps b.png");
    refused(1, &["a.png", "later.png"], "later.png: is of another landscape, moment, choice of options or version");
    refused(1, &["a.png", "brighter.png"], "brighter.png: is of another landscape");
    refused(1, &["grass.png"], "grass.png: is no tile");
    refused(1, &["a.png", "missing.png"], "missing.png");
    refused(2, &["a.png", "quad.vtex"], "quad.vtex: is not of the kind of out.png");
    folder.save("cut.png", &std::fs::read(folder.path("a.png")).unwrap()[..100]);
    refused(1, &["cut.png"], "cut.png: cannot be read as a PNG");
    let error = folder.fails(2, &["stitch", "a.png", "b.png", "-o", "a.png"]);
    assert!(error.contains("is also an input"), "{error}");

    for (tile, what) in
        [("0,0,0,3", "does not lie in"), ("40,0,11,3", "does not lie in"), ("50,0,1,1", "does not lie in")]
    {
        let error = folder.fails(2, &[&["render"], &VIEW[..], &["--tile", tile, "-o", "out.png"]].concat());
        assert!(error.contains(what), "{error}");
    }
    let moving = ["--frames", "2", "--tile", "0,0,5,5", "-o", "out.gif"];
    let error = folder.fails(2, &[&["render"], &VIEW[..], &moving].concat());
    assert!(error.contains("--tile"), "{error}");
}
