//! The page: style, script and texel in one file, under a policy that runs this script and nothing else.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

/// The script's modules, each after those that it imports. The first two are the format's own JavaScript reader.
const MODULES: [(&str, &str); 7] = [
    ("zstd", include_str!("../../../format-spec/js/zstd.mjs")),
    ("vtex", include_str!("../../../format-spec/js/vtex.mjs")),
    ("octree", include_str!("page/octree.mjs")),
    ("shader", include_str!("page/shader.mjs")),
    ("picture", include_str!("page/picture.mjs")),
    ("view", include_str!("page/view.mjs")),
    ("main", include_str!("page/main.mjs")),
];
const STYLE: &str = concat!(include_str!("page/common.css"), include_str!("page/page.css"));
const PAGE: &str = include_str!("page/page.html");

/// The page that shows `texel`, the bytes of a .vtex file.
pub fn of(texel: &[u8], title: &str) -> String {
    let script = script();
    let parts = [
        ("TITLE", escaped(title)),
        ("STYLE", STYLE.into()),
        ("SCRIPT", script.clone()),
        ("DATA", STANDARD.encode(texel)),
        ("SCRIPT-HASH", digest(&script)),
        ("STYLE-HASH", digest(STYLE)),
    ];
    let mut out = String::with_capacity(texel.len() * 4 / 3 + script.len() + PAGE.len() + STYLE.len());
    let mut rest = PAGE;
    // Once from the front to the back, so that what a part holds is never taken for a place of another.
    while let Some((before, (name, after))) =
        rest.split_once("{{").and_then(|(before, tail)| Some((before, tail.split_once("}}")?)))
    {
        out += before;
        out += parts.iter().find(|part| part.0 == name).map_or("", |part| &part.1);
        rest = after;
    }
    out + rest
}

/// All modules as one script: each becomes a function that gives what it exports. A page that is opened from a disk may not
/// load modules of its own.
fn script() -> String {
    let mut out = String::new();
    for (name, text) in MODULES {
        out += &format!("const {name} = (() => {{\n");
        let mut exports = Vec::new();
        for line in text.lines() {
            if let Some((names, from)) = line.strip_prefix("import ").and_then(|rest| rest.split_once(" from \"./")) {
                out += &format!("const {names} = {};\n", from.trim_end_matches(".mjs\";"));
                continue;
            }
            let own = line.strip_prefix("export ").unwrap_or(line);
            if own.len() < line.len() {
                let end = |c: char| !c.is_alphanumeric() && c != '_';
                exports.extend(own.split(end).nth(1));
            }
            out += own;
            out.push('\n');
        }
        out += &format!("return {{ {} }};\n}})();\n", exports.join(", "));
    }
    out
}

/// What a content security policy calls a script or a style.
fn digest(text: &str) -> String {
    format!("sha256-{}", STANDARD.encode(Sha256::digest(text.as_bytes())))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_page_of_known_size_that_asks_for_nothing() {
        let page = of(b"a texel", "<b>{{DATA}}</b>");
        assert!(page.len() < 400_000, "{}", page.len());
        assert!(page.contains("&lt;b&gt;{{DATA}}&lt;/b&gt;") && page.contains(&STANDARD.encode(b"a texel")));
        for outside in ["http://", "https://", "import ", "fetch(", "XMLHttpRequest", "eval("] {
            assert!(!page.contains(outside), "{outside}");
        }
        // The policy is that of the very script between the marks.
        let script =
            page.rsplit_once("<script type=\"module\">").and_then(|(_, s)| s.rsplit_once("</script>")).unwrap().0;
        assert!(page.contains(&digest(script)) && page.contains("default-src 'none'"));
        assert!(!script.contains("</script") && !script.contains("{{"));
    }

    #[test]
    fn modules_become_functions() {
        let script = script();
        assert!(script.contains("const { decompress } = zstd;\n") && script.contains("return { decompress };"));
        assert!(!script.lines().any(|line| line.starts_with("export ") || line.starts_with("import ")));
    }
}
