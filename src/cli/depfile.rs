//! Depfiles: what an output was made of, as a rule that make and ninja read.
//!
//! Names are escaped as GCC does it (`mkdeps.cc`) and as both readers take it back: `\ ` with 2N+1 backslashes where N stand
//! before the space, the same before `#` and `:`, and `$$`. Each prerequisite is also a target of its own without a recipe
//! (`gcc -MP`), so that one that is gone makes its output anew and does not stop the build. As names, ninja's reader does
//! not know `*`, `<`, `>`, `^`, a backtick, up to version 1.11 an apostrophe, and a backslash before `#`, `:` or `$`: an
//! output of such a file is made anew each time.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use super::Ui;
use crate::{Result, Warnings, format};

/// The option of every command that makes a file of others.
#[derive(clap::Args)]
pub struct DepfileArgs {
    /// Write what the output depends on, for make and ninja
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
}

impl DepfileArgs {
    pub fn path(&self) -> Option<&Path> {
        self.depfile.as_deref()
    }

    /// Write the rules of outputs with the files that were read for each; those that are not there are left out.
    pub fn write<'a>(&self, rules: impl IntoIterator<Item = (&'a Path, Vec<PathBuf>)>, ui: &Ui) -> Result<()> {
        let Some(path) = &self.depfile else { return Ok(()) };
        let (mut text, mut warnings) = (Vec::new(), Warnings::default());
        for (output, read) in rules {
            let (mut files, mut known) = (Vec::new(), std::collections::BTreeSet::new());
            for file in read.into_iter().filter(|file| file.exists() && known.insert(file.clone())) {
                if is_writable(file.as_os_str()) {
                    files.push(file);
                } else {
                    let what = "left out of the depfile: make cannot be told such a name";
                    warnings.add(format!("{}: {what}", file.display()));
                }
            }
            text.extend(rule(output, files));
        }
        format::save(path, &text)?;
        ui.warn(&warnings)
    }
}

/// The files that a landscape is read from: itself, its buffers, images and texels, and of the meshes that texels were baked
/// from the files that they name in turn.
pub fn of_landscape(path: &Path) -> Vec<PathBuf> {
    use crate::scene::{files, gltf};
    let mut all = vec![path.to_path_buf()];
    for file in gltf::named_files(path) {
        let is_model = ["gltf", "glb"].contains(&files::extension(&file).as_str());
        let inner = if is_model { gltf::named_files(&file) } else { Vec::new() };
        all.push(file);
        all.extend(inner);
    }
    all
}

/// Whether make can be told the name at all.
fn is_writable(name: &OsStr) -> bool {
    let bytes = name.as_encoded_bytes();
    !bytes.iter().any(|&b| b.is_ascii_control() || b";|".contains(&b)) && !bytes.ends_with(b"\\")
}

fn rule(output: &Path, mut files: Vec<PathBuf>) -> Vec<u8> {
    let has = |path: &Path, byte: u8| path.as_os_str().as_encoded_bytes().contains(&byte);
    // `output: a=b` sets a variable, `output: c a=b` does not.
    files.sort_by_key(|file| has(file, b'='));
    let mut out = escaped(output);
    out.push(b':');
    for (i, file) in files.iter().enumerate() {
        out.extend(if i == 0 { &b" "[..] } else { b" \\\n  " });
        out.extend(escaped(file));
    }
    out.push(b'\n');
    // A target with % would be a pattern, and one with = a variable.
    for file in files.iter().filter(|file| !has(file, b'%') && !has(file, b'=')) {
        out.push(b'\n');
        out.extend(escaped(file));
        out.extend(b":\n");
    }
    out
}

fn escaped(path: &Path) -> Vec<u8> {
    let (mut out, mut backslashes) = (Vec::new(), 0);
    for &byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b' ' | b'#' | b':' => {
                out.extend(std::iter::repeat_n(b'\\', backslashes + 1));
                out.push(byte);
            }
            b'$' => out.extend(b"$$"),
            _ => out.push(byte),
        }
        backslashes = if byte == b'\\' { backslashes + 1 } else { 0 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(output: &str, files: &[&str]) -> String {
        String::from_utf8(rule(Path::new(output), files.iter().map(PathBuf::from).collect())).unwrap()
    }

    #[test]
    fn rules_are_escaped() {
        let names = [
            ("a b", "a\\ b"),
            ("a  b", "a\\ \\ b"),
            ("a\\ b", "a\\\\\\ b"),
            ("a\\\\ b", "a\\\\\\\\\\ b"),
            ("a\\b", "a\\b"),
            ("c$#:", "c$$\\#\\:"),
            ("é", "é"),
        ];
        for (name, written) in names {
            let wanted = format!("{written}: {written}\n\n{written}:\n");
            assert_eq!(text(name, &[name]), wanted);
        }
        assert_eq!(text("o", &["a=b", "c"]), "o: c \\\n  a=b\n\nc:\n");
        assert_eq!(text("o", &["a%b", "c"]), "o: a%b \\\n  c\n\nc:\n");
        assert_eq!(text("o", &[]), "o:\n");
        for name in ["a\nb", "a\tb", "a;b", "a|b", "a\\"] {
            assert!(!is_writable(OsStr::new(name)), "{name}");
        }
    }
}
