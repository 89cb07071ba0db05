//! `vtex compare` from the outside.

use std::path::Path;
use std::process::Command;

use vtex::render::image_io::{read, write_png};

fn compare(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let vtex = env!("CARGO_BIN_EXE_vtex");
    let output = Command::new(vtex).arg("compare").args(arguments).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// Black, with a white square of `side` pixels in the corner.
fn picture(folder: &Path, name: &str, [width, height]: [usize; 2], side: usize) {
    let pixel = |i: usize| if i % width < side && i / width < side { [255; 3] } else { [0; 3] };
    let rgb: Vec<[u8; 3]> = (0..width * height).map(pixel).collect();
    write_png(&folder.join(name), width, height, &rgb).unwrap();
}

#[test]
fn prints_measures_and_writes_pictures() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), "a.png", [40, 20], 10);
    picture(folder.path(), "b.png", [40, 20], 5);
    let arguments = ["a.png", "b.png", "--json", "--background", "0,0,0", "--map", "map.png", "--sheet", "sheet.png"];
    let (code, json, errors) = compare(folder.path(), &arguments);
    assert_eq!((code, errors.as_str()), (0, ""));
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    // 75 of 800 pixels differ by 1 in every channel.
    let number = |path: &str| found.pointer(path).unwrap().as_f64().unwrap();
    assert!((number("/all/rmse") - (75.0f64 / 800.0).sqrt()).abs() < 1e-9);
    assert!((number("/all/bias") - 75.0 / 800.0).abs() < 1e-9);
    assert_eq!(number("/area/ratio"), 4.0);
    assert_eq!(number("/covered/pixels"), 100.0);
    assert!(number("/all/flip") > 0.05);
    let size = |name: &str| read(&folder.path().join(name)).map(|i| (i.width, i.height)).unwrap();
    assert_eq!((size("map.png"), size("sheet.png")), ((40, 20), (3 * 40 + 16, 20)));

    let (code, table, _) = compare(folder.path(), &["a.png", "b.png"]);
    assert_eq!(code, 0);
    for word in ["a.png against b.png, 40×20", "RMSE", "relMSE", "PSNR", "FLIP", "bias"] {
        assert!(table.contains(word), "{word} in {table}");
    }
    assert!(!table.contains("covered"));
}

#[test]
fn refuses_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), "a.png", [4, 4], 2);
    picture(folder.path(), "b.png", [4, 5], 2);
    let cases: [(&[&str], i32, &str); 5] = [
        (&["a.png", "b.png"], 1, "a.png: 4×4, but b.png is 4×5"),
        (&["a.png", "none.png"], 1, "none.png"),
        (&["a.png", "a.txt"], 1, "a.txt"),
        (&["a.png", "a.png", "--ppd", "0"], 2, "1 to 1000"),
        (&["a.png", "a.png", "--background", "red"], 2, "r,g,b"),
    ];
    for (arguments, wanted, words) in cases {
        let (code, output, errors) = compare(folder.path(), arguments);
        assert_eq!((code, output.as_str()), (wanted, ""), "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: {errors}");
    }
}
