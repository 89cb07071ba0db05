//! `vtex export`: the page holds the texel, and what cannot be written is refused.

use assert_cmd::Command;
use base64::Engine;

fn vtex(arguments: &[&str], folder: &std::path::Path) -> std::process::Output {
    Command::cargo_bin("vtex").unwrap().args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn a_page_holds_the_very_texel() {
    let dir = tempfile::tempdir().unwrap();
    let vector = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/ok-materials-3.vtex");
    let texel = dir.path().join("a <tree> & more.vtex");
    std::fs::copy(vector, &texel).unwrap();
    let done = vtex(&["export", "a <tree> & more.vtex", "-o", "page.html"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let page = std::fs::read_to_string(dir.path().join("page.html")).unwrap();
    assert!(page.contains("<title>a &lt;tree&gt; &amp; more</title>"));
    let data = page.split_once("id=\"data\">").unwrap().1.split_once('<').unwrap().0;
    let found = base64::engine::general_purpose::STANDARD.decode(data).unwrap();
    assert_eq!(found, std::fs::read(vector).unwrap());
    // What a page weighs without its texel, which the mail that carries it has to bear.
    assert!(page.len() - data.len() < 400_000, "{}", page.len());
}

#[test]
fn what_is_no_texel_or_no_page_is_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let bad = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/bad-digest-1.vtex");
    let head = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/bad-head-crc-1.vtex");
    for (arguments, code, said) in [
        (vec!["export", head, "-o", "x.html"], 1, "head-crc"),
        (vec!["export", bad, "-o", "x.obj"], 2, ".html"),
        (vec!["export", "nothing.vtex", "-o", "x.html"], 1, "nothing.vtex"),
        (vec!["export", bad, "-o", "missing/x.html"], 1, "folder"),
    ] {
        let done = vtex(&arguments, dir.path());
        let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(code), "{arguments:?}: {stderr}");
        assert!(stderr.contains(said) && stderr.lines().count() == 1, "{arguments:?}: {stderr}");
        assert!(std::fs::read_dir(dir.path()).unwrap().next().is_none(), "{arguments:?} left a file");
    }
}
