//! The command line that makes the picture which a page shows.

use std::path::Path;

/// Options that the page says, by the camera, the exposure and the size that it has.
const OWN: [&str; 7] = ["--eye", "--look-at", "--fov", "--camera", "--size", "--lanes", "--exposure"];

/// The beginning of the command: the landscape, and those of the options that no page changes.
pub fn command(landscape: &Path, options: &[String]) -> String {
    let mut words = vec!["vtex".to_owned(), "render".into(), landscape.display().to_string()];
    let mut left = options.iter();
    while let Some(word) = left.next() {
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        if OWN.contains(&name) {
            if name.len() == word.len() {
                left.next();
            }
        } else if word != "--frame" {
            words.push(word.clone());
        }
    }
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// As a POSIX shell takes it for one word.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_-./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_page_says_is_left_out() {
        let options = [
            "--eye",
            "-1,2,3",
            "--sun",
            "-5,240",
            "--size=4x4",
            "--frame",
            "--exposure",
            "-1",
            "--look-at",
            "0,0,0",
            "--no-shadows",
        ];
        let command = command(Path::new("it's a/land.gltf"), &options.map(String::from));
        assert_eq!(command, r"vtex render 'it'\''s a/land.gltf' --sun -5,240 --no-shadows");
        assert_eq!(super::command(Path::new("a.glb"), &[]), "vtex render a.glb");
        assert_eq!(quoted(""), "''");
    }
}
