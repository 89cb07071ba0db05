//! `--depfile`: what an output depends on, as a rule that make and ninja read.

use std::path::{Path, PathBuf};

use crate::{Error, Result, format};

#[derive(clap::Args)]
pub struct DepfileArg {
    /// Write what the output depends on, for make and ninja
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
}

impl DepfileArg {
    /// Where the rule goes, if it is asked for.
    pub fn path(&self) -> Option<&Path> {
        self.depfile.as_deref()
    }

    /// Write the rule of `output`, made of `inputs`.
    pub fn write(&self, output: &Path, inputs: &[PathBuf]) -> Result<()> {
        self.path().map_or(Ok(()), |path| format::save(path, rule(output, inputs)?.as_bytes()))
    }
}

/// The rule, and a rule without anything for each input, so that make does not ask for one that is gone (as `gcc -MP`).
fn rule(output: &Path, inputs: &[PathBuf]) -> Result<String> {
    let names = inputs.iter().map(|input| escaped(input)).collect::<Result<Vec<_>>>()?;
    let mut out = format!("{}: {}\n", escaped(output)?, names.join(" \\\n  "));
    out.extend(names.iter().map(|name| format!("\n{name}:\n")));
    Ok(out)
}

/// A name as make and ninja read it: `$` is doubled; a space, `#` and `:` have a backslash before them, and the backslashes
/// that stand before a space or `#` are doubled (N of them and the character become 2N + 1 and the character).
fn escaped(path: &Path) -> Result<String> {
    let (mut out, mut backslashes) = (String::new(), 0);
    for c in path.to_string_lossy().chars() {
        match c {
            ' ' | '\t' | '#' => {
                out.extend(std::iter::repeat_n('\\', backslashes + 1));
                out.push(c);
            }
            ':' => out.push_str("\\:"),
            '$' => out.push_str("$$"),
            '\n' | '\r' => {
                let what = "has a line break in its name, which no depfile can hold; rename it";
                return Err(Error::Options(format!("{}: {what}", path.display())));
            }
            _ => out.push(c),
        }
        backslashes = if c == '\\' { backslashes + 1 } else { 0 };
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_escaped() {
        let inputs = ["a b.gltf", "c$#.bin", "d:e", r"f\ g\\#h\i"].map(PathBuf::from);
        let names = [r"a\ b.gltf", r"c$$\#.bin", r"d\:e", r"f\\\ g\\\\\#h\i"];
        let phony: String = names.iter().map(|name| format!("\n{name}:\n")).collect();
        let want = format!("o.vtex: {}\n{phony}", names.join(" \\\n  "));
        assert_eq!(rule(Path::new("o.vtex"), &inputs).unwrap(), want);
        assert!(rule(Path::new("o\nx.vtex"), &[]).is_err());
    }
}
