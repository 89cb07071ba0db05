//! The JSON Schema of landscapes: what vtex writes keeps it, and it refuses what the reader refuses.
//!
//! A hundred lines evaluate the keywords that it uses, and fail at any other: the crate `jsonschema` brings 32 crates with it.
//! `format-spec/conformance.sh` holds the schema, and the same landscapes, to Python's jsonschema.

use std::path::Path;

use serde_json::{Value, json};
use vtex::scene::gltf::{self, ReadOptions};

use crate::corpus;

/// What of `value` breaks `schema`, with its place.
fn broken(root: &Value, schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let Some(rules) = schema.as_object() else {
        return if schema == &json!(false) { vec![format!("{at}: is not allowed")] } else { Vec::new() };
    };
    let number = value.as_f64();
    let list = value.as_array();
    let keeps = |schema: &Value, value: &Value| broken(root, schema, value, at).is_empty();
    let mut all = Vec::new();
    for (keyword, rule) in rules {
        let limit = rule.as_f64().unwrap_or(f64::NAN);
        let count = rule.as_u64().unwrap_or(0) as usize;
        let fine = match keyword.as_str() {
            "$schema" | "$id" | "$defs" | "title" | "description" | "default" | "then" | "else" => true,
            "$ref" => {
                let target = root.pointer(rule.as_str().unwrap().strip_prefix('#').unwrap()).unwrap();
                all.extend(broken(root, target, value, at));
                true
            }
            "type" => match rule.as_str().unwrap() {
                "object" => value.is_object(),
                "array" => value.is_array(),
                "string" => value.is_string(),
                "boolean" => value.is_boolean(),
                "number" => value.is_number(),
                "integer" => number.is_some_and(|n| n.fract() == 0.0),
                other => panic!("the type {other}"),
            },
            "enum" => rule.as_array().unwrap().contains(value),
            "const" => rule == value || number.is_some_and(|n| Some(n) == rule.as_f64()),
            "minimum" => number.is_none_or(|n| n >= limit),
            "maximum" => number.is_none_or(|n| n <= limit),
            "exclusiveMinimum" => number.is_none_or(|n| n > limit),
            "minLength" => value.as_str().is_none_or(|s| s.chars().count() >= count),
            "maxLength" => value.as_str().is_none_or(|s| s.chars().count() <= count),
            "pattern" => value.as_str().is_none_or(|s| matches(rule.as_str().unwrap(), s)),
            "minItems" => list.is_none_or(|l| l.len() >= count),
            "maxItems" => list.is_none_or(|l| l.len() <= count),
            "uniqueItems" => list.is_none_or(|l| (1..l.len()).all(|i| !l[..i].contains(&l[i]))),
            "contains" => list.is_none_or(|l| l.iter().any(|item| keeps(rule, item))),
            "maxProperties" => value.as_object().is_none_or(|o| o.len() <= count),
            "required" => rule
                .as_array()
                .unwrap()
                .iter()
                .all(|key| value.is_object() && value.get(key.as_str().unwrap()).is_some()),
            "not" => !keeps(rule, value),
            "anyOf" => rule.as_array().unwrap().iter().any(|schema| keeps(schema, value)),
            "if" => {
                let branch = rules.get(if keeps(rule, value) { "then" } else { "else" });
                all.extend(branch.iter().flat_map(|schema| broken(root, schema, value, at)));
                true
            }
            "items" => {
                let each = list.into_iter().flatten().enumerate();
                all.extend(each.flat_map(|(i, item)| broken(root, rule, item, &format!("{at}/{i}"))));
                true
            }
            "properties" | "patternProperties" | "additionalProperties" => {
                for (key, inner) in value.as_object().into_iter().flatten() {
                    let known = rules.get("properties").is_some_and(|p| p.get(key).is_some());
                    let schema = match keyword.as_str() {
                        "properties" => rule.get(key),
                        "patternProperties" => {
                            rule.as_object().unwrap().iter().find(|(p, _)| matches(p, key)).map(|(_, s)| s)
                        }
                        _ => Some(rule).filter(|_| !known),
                    };
                    all.extend(schema.iter().flat_map(|s| broken(root, s, inner, &format!("{at}/{key}"))));
                }
                true
            }
            other => panic!("the keyword {other} is not evaluated"),
        };
        if !fine {
            all.push(format!("{at}: {keyword} {rule}"));
        }
    }
    all
}

/// The regular expressions of the schema, by hand.
fn matches(pattern: &str, text: &str) -> bool {
    let other = |prefix: &str, known: &[&str]| text.strip_prefix(prefix).is_some_and(|rest| !known.contains(&rest));
    match pattern {
        "^[0-9a-f]{32}$" => text.len() == 32 && text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b)),
        p if p.starts_with("^_VTEX_(?!(UVW|") => other("_VTEX_", &["UVW", "HEIGHT", "DW", "JITTER"]),
        p if p.starts_with("^_VTEX_(?!(VARIANT|") => other("_VTEX_", &["VARIANT", "TINT", "PHASE"]),
        p if p.starts_with("^(?!/)") => {
            let lower = text.to_ascii_lowercase();
            let scheme = text.split_once(':').is_some_and(|(scheme, _)| {
                scheme.starts_with(|c: char| c.is_ascii_alphabetic())
                    && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+.-".contains(c))
            });
            let up = lower.replace("%2e", ".").split('/').any(|segment| segment == "..");
            let coded = ["%2f", "%5c", "%00"].iter().any(|code| lower.contains(code));
            !text.is_empty() && !text.starts_with('/') && !scheme && !up && !coded && !text.contains(['?', '#', '\\'])
        }
        other => panic!("the pattern {other} is not evaluated"),
    }
}

fn schema() -> Value {
    serde_json::from_str(include_str!("../format-spec/landscape-1.schema.json")).unwrap()
}

/// The JSON of a `.gltf` or `.glb` file.
fn json_of(bytes: &[u8]) -> Value {
    let text = if bytes.starts_with(b"glTF") {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        &bytes[20..20 + length]
    } else {
        bytes
    };
    serde_json::from_slice(text).unwrap()
}

/// That a landscape keeps the schema.
fn check(path: &Path) {
    let schema = schema();
    let faults = broken(&schema, &schema, &json_of(&std::fs::read(path).unwrap()), "");
    assert!(faults.is_empty(), "{}: {}", path.display(), faults.join("\n"));
}

#[test]
fn landscapes_of_every_version_keep_the_schema() {
    let all: Vec<_> = corpus::versions().iter().flat_map(|folder| corpus::files(folder, "glb")).collect();
    assert!(!all.is_empty());
    all.iter().for_each(|path| check(path));
}

/// `format-spec/exporter.py`, written from the text alone: what it makes keeps the schema, and is rendered without a warning. Nothing
/// is tested where there is no Python.
#[test]
fn an_exporter_by_the_text_alone_is_understood() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let land = folder.path().join("land.gltf");
    let mut python = std::process::Command::new("python3");
    python.arg(root.join("format-spec/exporter.py")).arg(root.join("tests/corpus/1.0/alpha.vtex")).arg(&land);
    let Ok(output) = python.output() else {
        println!("python3 is not installed: nothing was tested");
        return;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    check(&land);
    let mut vtex = assert_cmd::Command::cargo_bin("vtex").unwrap();
    vtex.current_dir(folder.path()).args(["render", "--strict", "-q", "--size", "32x18", "-o", "a.png", "land.gltf"]);
    vtex.assert().success();
    let pixels = image::open(folder.path().join("a.png")).unwrap().to_rgb8();
    let colours: std::collections::BTreeSet<[u8; 3]> = pixels.pixels().map(|p| p.0).collect();
    assert!(colours.len() > 50, "{}", colours.len());
}

/// The scripts of `samples/landscapes/`, with texels of 16 voxels and without the pictures.
#[cfg(unix)]
#[test]
fn landscapes_of_the_samples_keep_the_schema() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    let program = Path::new(env!("CARGO_BIN_EXE_vtex")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    for script in corpus::files(&samples.join("landscapes"), "sh") {
        let text = std::fs::read_to_string(&script).unwrap().replace("vtex render", ": vtex render");
        let mut pieces = text.split(" -r ");
        let mut quick = pieces.next().unwrap().to_owned();
        for piece in pieces {
            quick += " -r 16";
            quick += piece.trim_start_matches(|c: char| c.is_ascii_digit());
        }
        let folder = tempfile::tempdir().unwrap();
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &quick]).env("S", &samples).env("PATH", &path).current_dir(folder.path());
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{}: {}", script.display(), String::from_utf8_lossy(&output.stderr));
        check(&folder.path().join("landscape.glb"));
    }
}

/// The GLB with other JSON.
fn with_json(glb: &[u8], json: &Value) -> Vec<u8> {
    let old = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut text = serde_json::to_vec(json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &glb[20 + old..];
    let total = (20 + text.len() + rest.len()) as u32;
    [&glb[..8], &total.to_le_bytes(), &(text.len() as u32).to_le_bytes(), &glb[16..20], &text, rest].concat()
}

const X: &str = "VTEX_volumetric_texture";

/// A place in the landscape of shells or of copies, and what is put there that the schema and the reader refuse.
fn wrong() -> Vec<(&'static str, Value)> {
    vec![
        ("texels", json!([])),
        ("texels", json!({})),
        ("texels/0/frames", json!([])),
        ("texels/0/frames/0", json!({})),
        ("texels/0/frames/0", json!({"uri": "a.vtex", "bufferView": 0})),
        ("texels/0/frames/0", json!({"bufferView": -1})),
        ("texels/0/frames/0/uri", json!("../a.vtex")),
        ("texels/0/frames/0/uri", json!("a/%2e%2E/a.vtex")),
        ("texels/0/frames/0/uri", json!("http://localhost/a.vtex")),
        ("texels/0/frames/0/uri", json!("/a.vtex")),
        ("texels/0/frames/0/uri", json!("C:/a.vtex")),
        ("texels/0/frames/0/uri", json!("a.vtex?b")),
        ("texels/0/frames/0/uri", json!("a\\b.vtex")),
        ("texels/0/frames/0/uri", json!("")),
        ("texels/0/frames/0/uri", json!("a".repeat(1025))),
        ("texels/0/frames/0/contentId", json!("00")),
        ("texels/0/frames/0/contentId", json!("ABCDEF0123456789ABCDEF0123456789")),
        ("texels/0/frames/0/pose", json!({"animations": "walk"})),
        ("texels/0/maxDepth", json!(17)),
        ("texels/0/name", json!(3)),
        ("texels/0/geometry", json!({"uri": "..%2fa.glb"})),
        ("environment", json!({"sky": [1, 1]})),
        ("environment", json!({"sky": [1, 1, -1]})),
        ("environment", json!({"clear": {"turbidity": 11}})),
        ("environment", json!({"image": {}})),
        ("environment", json!({"haze": 0})),
        ("environment", json!({"sunAngle": 2})),
        ("wind", json!({"strength": 5})),
        ("wind", json!({"direction": [0, 0, 0]})),
        ("wind", json!({"seed": 4294967296u64})),
        ("M/layers", json!([])),
        ("M/layers/0/texel", json!(-1)),
        ("M/layers/0/texel", json!(0.5)),
        ("M/layers/0", json!({"wrap": ["repeat", "repeat", "empty"]})),
        ("M/layers/0/wrap", json!(["repeat", "mirror"])),
        ("M/layers/0/wrap", json!(["repeat", "mirror", "clamp"])),
        ("M/layers/0/scale", json!([1, 0, 1])),
        ("M/layers/0/skinRange", json!([0.5, 0.5])),
        ("M/layers/0/skinRange", json!([0, 1.5])),
        ("M/layers/0/combine", json!("plus")),
        ("M/layers/0/opacityScale", json!(-1)),
        ("M/layers/0/phong", json!({"diffuseFactor": [1, 1]})),
        ("M/layers/0/phong", json!({"useTexelAlbedo": 1})),
        ("M/layers/0/phong", json!({"ambientFactor": [1, 1, 2]})),
        ("M/layers/0/phong", json!({"specularFactor": [0, -1, 0]})),
        ("M/layers/0/phong", json!({"shininess": 10001})),
        ("M/layers/0/phong", json!({"diffuseTexture": {}})),
        ("M/layers/0/phong", json!({"noise": {"frequency": [0, 0, 0]}})),
        ("M/layers/0/phong", json!({"noise": {"space": "object"}})),
        ("M/layers/0/phong", json!({"noise": {"diffuse": [[1, 1, 1]]}})),
        ("M/layers/0/palette", json!({"leaf": {"noise": {}}})),
        ("M/layers/0/palette", json!({"leaf": []})),
        ("M/layers/0/jitter", json!({"discrete": {"orientations": "w3"}})),
        ("M/layers/0/jitter", json!({"discrete": {"mirror": [true, false]}})),
        ("M/layers/0/jitter", json!({"discrete": {"scale": [0, 1]}})),
        ("M/layers/0/jitter", json!({"discrete": {"displace": [5, 0, 0]}})),
        ("M/layers/0/jitter", json!({"discrete": {"presence": 1.1}})),
        ("M/layers/0/jitter", json!({"discrete": {"tint": [[1, 1, 1]]}})),
        ("M/layers/0/jitter", json!({"discrete": {"variants": [{}]}})),
        ("M/layers/0/jitter", json!({"discrete": {"variants": [{"texel": 0, "weight": 0}]}})),
        ("M/layers/0/jitter", json!({"continuous": {"noise": "simplex"}})),
        ("M/layers/0/jitter", json!({"continuous": {"space": "object"}})),
        ("M/layers/0/jitter", json!({"continuous": {"frequency": [0, 1, 1]}})),
        ("M/layers/0/jitter", json!({"continuous": {"octaves": 9}})),
        ("M/layers/0/jitter", json!({"continuous": {"heightTilt": 1.3}})),
        ("M/layers/0/jitter", json!({"continuous": {"heightScale": 0.95}})),
        ("M/layers/0/animation", json!({"mode": "once"})),
        ("M/layers/0/animation", json!({"phaseScale": 0})),
        ("M/layers/0/animation", json!({"framesPerSecond": -1})),
        ("M/thickness", json!(0)),
        ("M/texCoord", json!(8)),
        ("M/surface", json!("none")),
        ("C/copies", json!({})),
        ("C/copies", json!({"variants": []})),
        ("C/copies/texel", json!("tree")),
        ("C/copies/wind", json!({"gustScale": 0})),
    ]
}

/// The same, of what neither refuses.
fn right() -> Vec<(&'static str, Value)> {
    vec![
        ("texels/0/frames/0/uri", json!("lean.vtex")),
        ("texels/0/frames/0/pose", json!({"time": -1.5, "animations": ["walk"]})),
        ("texels/0/maxDepth", json!(16)),
        ("texels/0/extras", json!([1])),
        ("environment", json!({"sky": [0, 0.5, 2], "background": [0, 0, 0], "sunAngle": 0.009, "haze": 1e3})),
        ("environment", json!({"clear": {}})),
        ("wind", json!({"direction": [0, 0, -2], "strength": 0, "gustScale": 1e-6, "speed": 0, "seed": 4294967295u32})),
        ("M/layers/0/wrap", json!(["mirror", "empty", "repeat"])),
        ("M/layers/0/skinRange", json!([0.25, 0.5])),
        ("M/layers/0/scale", json!([-1, 2, 1e-3])),
        ("M/layers/0/phong", json!({"diffuseFactor": [0, 3, 1], "useTexelAlbedo": false, "extras": {}})),
        (
            "M/layers/0/jitter",
            json!({"discrete": {"orientations": "cube24", "scale": [0.5, 0.5], "presence": 0, "displace": [4, 0, 4]}}),
        ),
        (
            "M/layers/0/jitter",
            json!({"continuous": {"noise": "perlin2002", "space": "texel", "octaves": 8, "frequency": [64, 1, 1]}}),
        ),
        ("M/layers/0/phong", json!({"ambientFactor": [0, 1, 1], "specularFactor": [0, 1, 0], "shininess": 10000})),
        (
            "M/layers/0/phong",
            json!({"noise": {"space": "world", "frequency": [0, 64, 0], "diffuse": [[0, 0, 0], [2, 1, 1]]}}),
        ),
        ("M/layers/0/palette", json!({"frond": {"specularFactor": [0.1, 0.1, 0.1], "shininess": 0}})),
        ("M/layers/0/combine", json!("over")),
        ("M/layers/0/animation", json!({"mode": "random", "phase": "noise", "frame": -3, "framesPerSecond": 0})),
        ("M/thickness", json!(1e-9)),
        ("M/wind", json!({})),
        ("C/copies", json!({"texel": 0})),
        ("C/copies", json!({"variants": [{"texel": 0}]})),
    ]
}

/// Both of the corpus's landscapes with `value` at `place`; `M/` and `C/` are the objects of a material with a shell, and with
/// copies.
fn changed(place: &str, value: Value) -> (Value, Vec<u8>) {
    let folder = corpus::versions().pop().unwrap();
    let glb = std::fs::read(folder.join(if place.starts_with("C/") { "copies.glb" } else { "shells.glb" })).unwrap();
    let mut json = json_of(&glb);
    let material = |key: &str| {
        let all = json["materials"].as_array().unwrap();
        all.iter()
            .position(|m| m["extensions"][X].get(key).is_some())
            .unwrap_or_else(|| panic!("no material has {key}"))
    };
    let mut at = match place.split_at(2) {
        ("M/", rest) => format!("/materials/{}/extensions/{X}/{rest}", material("layers")),
        ("C/", rest) => format!("/materials/{}/extensions/{X}/{rest}", material("copies")),
        _ => format!("/extensions/{X}/{place}"),
    };
    let key = at.split_off(at.rfind('/').unwrap())[1..].to_owned();
    match json.pointer_mut(&at).unwrap() {
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        object => object[&key] = value,
    }
    let bytes = with_json(&glb, &json);
    (json, bytes)
}

#[test]
fn the_schema_refuses_what_the_reader_refuses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let options = ReadOptions { contained: true, ..ReadOptions::default() };
    let schema = schema();
    for (is_right, (place, value)) in
        wrong().into_iter().map(|c| (false, c)).chain(right().into_iter().map(|c| (true, c)))
    {
        let said = format!("{place}: {value}");
        let (json, bytes) = changed(place, value);
        std::fs::write(&path, bytes).unwrap();
        let read = gltf::read(&path, &options);
        assert_eq!(read.is_ok(), is_right, "the reader, {said}: {:?}", read.err());
        let faults = broken(&schema, &schema, &json, "");
        assert_eq!(faults.is_empty(), is_right, "the schema, {said}: {faults:?}");
    }
}

/// A reader of a later version may know more, so it ignores what it does not know; a writer made a mistake.
#[test]
fn the_schema_refuses_properties_that_nobody_knows() {
    let schema = schema();
    for place in
        ["texls", "texels/0/frame", "wnd", "M/layer", "M/layers/0/texels", "M/layers/0/jitter", "C/copies/phase"]
    {
        let value = if place.ends_with("jitter") { json!({"discrete": {"sead": 1}}) } else { json!(1) };
        let (json, _) = changed(place, value);
        assert!(!broken(&schema, &schema, &json, "").is_empty(), "{place}");
    }
    let (mut json, _) = changed("wind", json!({}));
    json["meshes"][0]["primitives"][0]["attributes"]["_VTEX_HIGHT"] = json!(0);
    assert!(!broken(&schema, &schema, &json, "").is_empty());
    let (mut json, _) = changed("wind", json!({}));
    json["extensionsUsed"] = json!(["FB_ngon_encoding"]);
    assert!(!broken(&schema, &schema, &json, "").is_empty());
}
