//! Results as programs read them, and one command for several inputs.
//!
//! JSON keys are snake_case. A command prints one object; of several inputs an array, in their order.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::Ui;
use super::flags::named;
use super::ui::{message, put_json};
use crate::{Error, Result};

/// Do `one` for each input; what it gives is printed where `json` is asked for, with the warnings that came up.
///
/// # Errors
/// What `one` gives where there is one input. Of several each failure is a line of its own and the others are done; in the
/// end it is `Failed`.
pub fn each(inputs: &[PathBuf], json: bool, ui: &Ui, mut one: impl FnMut(&Path) -> Result<Value>) -> Result<()> {
    if let [input] = inputs {
        let value = one(input)?;
        return print(value, json, ui);
    }
    let (mut all, mut failed) = (Vec::new(), 0);
    for input in inputs {
        let done = one(input);
        ui.finish();
        let value = done.unwrap_or_else(|e| {
            failed += 1;
            message("error: ", &e.to_string());
            json!({ "input": shown(input), "error": named(&e.to_string()) })
        });
        all.push(with_warnings(value, ui));
    }
    if json {
        put_json(&all)?;
    }
    if failed > 0 { Err(Error::Failed(format!("{failed} of {} inputs failed", inputs.len()))) } else { Ok(()) }
}

/// Print one result where `json` is asked for, with the warnings that came up.
pub fn print(value: Value, json: bool, ui: &Ui) -> Result<()> {
    ui.finish();
    let value = with_warnings(value, ui);
    if json { put_json(&value) } else { Ok(()) }
}

/// A path as text.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn with_warnings(mut value: Value, ui: &Ui) -> Value {
    let warned = ui.take_warnings();
    if let Some(map) = value.as_object_mut() {
        let list = warned.iter().map(|(text, n)| json!({ "message": named(text), "count": n })).collect();
        map.insert("warnings".into(), list);
    }
    value
}

/// The file that is written for `input`, by its name with `extension`: `asked` where that is a name; in the folder `asked`
/// where that ends in a slash, or is a folder and `several` inputs share it; else in the current folder.
pub fn output_for(input: &Path, asked: Option<&Path>, several: bool, extension: &str) -> Result<PathBuf> {
    let name = Path::new(input.file_name().unwrap_or_default()).with_extension(extension);
    let Some(asked) = asked else { return Ok(name) };
    let slashed = asked.as_os_str().as_encoded_bytes().last().is_some_and(|&b| std::path::is_separator(b.into()));
    if slashed || (several && asked.is_dir()) {
        return Ok(asked.join(name));
    }
    if several {
        let what = "several inputs need a folder to write to: make it, and name it with a slash at its end";
        return Err(Error::Options(format!("{}: {what}", asked.display())));
    }
    Ok(asked.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_their_inputs() {
        let dir = tempfile::tempdir().unwrap();
        let of = |asked: Option<&Path>, several| output_for(Path::new("in/a.b.glb"), asked, several, "vtex");
        assert_eq!(of(None, false).unwrap(), Path::new("a.b.vtex"));
        assert_eq!(of(Some(Path::new("o.vtex")), false).unwrap(), Path::new("o.vtex"));
        assert_eq!(of(Some(Path::new("out/")), false).unwrap(), Path::new("out/a.b.vtex"));
        assert_eq!(of(Some(Path::new("out/")), true).unwrap(), Path::new("out/a.b.vtex"));
        assert_eq!(of(Some(dir.path()), true).unwrap(), dir.path().join("a.b.vtex"));
        assert_eq!(of(Some(dir.path()), false).unwrap(), dir.path());
        assert!(of(Some(Path::new("o.vtex")), true).is_err());
    }
}
