//! Files that a source names: URIs and paths as other programs write them → bytes, read once their size is known.

use std::borrow::Cow;
use std::io::Read;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use sha2::{Digest, Sha256};

pub use crate::format::read_file as read;

/// UriTarget of a URI in a glTF file.
#[derive(Debug, PartialEq)]
pub enum UriTarget<'a> {
    /// The decoded bytes of a data URI.
    Data(Vec<u8>),
    /// A path as the URI has it, percent signs decoded.
    File(Cow<'a, str>),
}

/// Take a URI apart; the error says what is wrong with it.
pub fn target(uri: &str) -> Result<UriTarget<'_>, String> {
    match scheme(uri) {
        Some("data") => data(&uri[5..]).map(UriTarget::Data),
        Some("file") => {
            let path = &uri[5..];
            Ok(UriTarget::File(percent_decoded(path.strip_prefix("//").unwrap_or(path))))
        }
        Some(other) => Err(format!("a URI of scheme {other}: is not read; download the file and name it by its path")),
        None => Ok(UriTarget::File(percent_decoded(uri))),
    }
}

/// Extension of a file's name, in lower case; empty where it has none.
pub fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// SHA-256 of a file in hexadecimal, a piece at a time: files may be larger than memory.
///
/// # Errors
/// `Io` where it cannot be read.
#[cfg_attr(not(feature = "bake"), allow(dead_code))]
pub fn sha256(path: &Path) -> crate::Result<String> {
    let (mut from, mut digest) = (crate::format::open_file(path)?, Sha256::new());
    let mut piece = vec![0; 1 << 20];
    loop {
        let n = from.read(&mut piece).map_err(|e| crate::Error::io(path, e))?;
        if n == 0 {
            break;
        }
        digest.update(&piece[..n]);
    }
    Ok(hex(digest.finalize()))
}

/// Bytes, such as a digest, as hexadecimal digits.
pub fn hex(bytes: impl AsRef<[u8]>) -> String {
    use std::fmt::Write as _;
    bytes.as_ref().iter().fold(String::new(), |mut out, byte| {
        let _ = write!(out, "{byte:02x}");
        out
    })
}

/// The scheme of a URI; one letter is the drive of a path, not a scheme.
pub fn scheme(uri: &str) -> Option<&str> {
    let (scheme, _) = uri.split_once(':')?;
    let mut letters = scheme.chars();
    let first = letters.next()?.is_ascii_alphabetic();
    let rest = letters.all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    (first && rest && scheme.len() > 1).then_some(scheme)
}

/// Reason why [`contained`] refuses a URI.
pub const NOT_CONTAINED: &str = "is not a relative path without scheme, query and \"..\"";

/// The path of a URI that stays within the folder of the file that names it: the rule for every URI of a landscape, so that
/// what is made of a landscape holds nothing from elsewhere on the machine.
pub fn contained(uri: &str) -> Option<Cow<'_, str>> {
    let path = percent_decoded(uri);
    let inside = path.split(['/', '\\']).all(|segment| segment != "..");
    let plain = scheme(uri).is_none() && !uri.contains(['?', '#', '\\']) && !path.contains('\0');
    let absolute = path.starts_with(['/', '\\']) || path.as_bytes().get(1) == Some(&b':');
    (!uri.is_empty() && uri.len() <= 1024 && inside && plain && !absolute).then_some(path)
}

/// `%20` → space and so on; as it is where the result is not UTF-8.
pub fn percent_decoded(text: &str) -> Cow<'_, str> {
    percent_encoding::percent_decode_str(text).decode_utf8().unwrap_or(Cow::Borrowed(text))
}

/// The part of a data URI after `data:`.
fn data(rest: &str) -> Result<Vec<u8>, String> {
    let (head, body) = rest.split_once(',').ok_or("a data URI without a comma holds no data")?;
    if !head.ends_with(";base64") {
        return Ok(percent_encoding::percent_decode_str(body).collect());
    }
    const LENIENT: GeneralPurposeConfig = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    let body = percent_decoded(body.trim());
    GeneralPurpose::new(&STANDARD, LENIENT)
        .decode(body.as_bytes())
        .map_err(|e| format!("a data URI is not base64: {e}"))
}

/// The existing file that `name` stands for beside `dir`: as it is, with `%XX` decoded, with `\` for `/`; where
/// `anywhere`, also the file of that last name in `dir`, because many exporters write paths of the machine they ran on.
#[cfg_attr(not(feature = "bake"), allow(dead_code))]
pub fn find(dir: &Path, name: &str, anywhere: bool) -> Option<PathBuf> {
    find_either(dir, name, &percent_decoded(name), anywhere)
}

/// The existing file that `written` stands for, or `decoded`, which is `written` with `%XX` decoded once. Nothing is decoded a
/// second time: `%252e%252e` is a name with percent signs, and not the folder above.
fn find_either(dir: &Path, written: &str, decoded: &str, anywhere: bool) -> Option<PathBuf> {
    let forward = [written, decoded].map(|name| name.replace('\\', "/"));
    let last = forward.each_ref().map(|name| name.rsplit('/').next().unwrap_or_default());
    let [own, other] = last.map(|name| anywhere.then_some(name));
    [Some(written), Some(decoded), Some(&forward[0]), Some(&forward[1]), own, other]
        .into_iter()
        .flatten()
        .filter(|n| !n.is_empty())
        .map(|n| dir.join(n))
        .find(|p| p.is_file())
}

/// The file that `uri`, whose path is `name`, stands for beside `dir`; see [`find`]. It may not be there.
pub fn locate(dir: &Path, uri: &str, name: &str, anywhere: bool) -> PathBuf {
    find_either(dir, uri, name, anywhere).unwrap_or_else(|| dir.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_told_apart() {
        assert_eq!(target("a%20b%E2%9D%A4.bin"), Ok(UriTarget::File("a b❤.bin".into())));
        assert_eq!(target("100%.bin"), Ok(UriTarget::File("100%.bin".into())));
        assert_eq!(target("data:application/octet-stream;base64,AQID"), Ok(UriTarget::Data(vec![1, 2, 3])));
        assert_eq!(target("data:;base64,AQIDBA"), Ok(UriTarget::Data(vec![1, 2, 3, 4])), "padding may be missing");
        assert_eq!(target("data:text/plain,a%20b"), Ok(UriTarget::Data(b"a b".to_vec())));
        assert_eq!(target("file:///tmp/x"), Ok(UriTarget::File("/tmp/x".into())));
        assert!(target("http://example.com/a.bin").unwrap_err().contains("scheme http"));
        assert!(target("data:;base64,A*").is_err());
        assert!(target("data:base64").is_err());
        assert_eq!(scheme("C:/textures/a.png"), None);
        assert_eq!(scheme(":"), None);
        assert_eq!(scheme("a/b:c"), None);
    }

    #[test]
    fn a_landscape_names_nothing_outside_its_folder() {
        for uri in ["a.bin", "tex/a%20b.png", "./a", "a..b/c", "é.png"] {
            assert!(contained(uri).is_some(), "{uri}");
        }
        let outside = [
            "",
            "/etc/hosts",
            "../a",
            "a/../../b",
            "%2e%2e/a",
            "a/%2E%2e/b",
            "%2Fetc/hosts",
            "file:a",
            "file:///a",
            "http://a/b",
            "C:/a",
            "C%3A/a",
            "..\\a",
            "%2e%2e%5ca",
            "%5c%5chost/a",
            "a?b",
            "a#b",
            "a%00b",
        ];
        for uri in outside {
            assert_eq!(contained(uri), None, "{uri}");
        }
        assert_eq!(contained(&"a".repeat(1025)), None);
    }

    #[test]
    fn names_from_other_machines_are_found() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("tex")).unwrap();
        for name in ["a b.png", "tex/c.png", "100%25.png"] {
            std::fs::write(dir.path().join(name), b"x").unwrap();
        }
        let found = |name: &str, anywhere| find(dir.path(), name, anywhere).is_some();
        assert!(found("a%20b.png", false) && found("a b.png", false) && found("100%25.png", false));
        assert!(found("tex\\c.png", false) && found("./tex/../tex/c.png", false));
        assert!(!found("C:\\work\\a b.png", false) && found("C:\\work\\a b.png", true));
        assert!(!found("tex", true) && !found("", true));
        let located = |uri: &str| locate(dir.path(), uri, &percent_decoded(uri), false);
        assert_eq!(located("a%20b.png"), dir.path().join("a b.png"));
        // What is decoded once is not decoded again.
        std::fs::write(dir.path().join("secret"), b"x").unwrap();
        assert_eq!(located("tex/%252e%252e/secret"), dir.path().join("tex/%2e%2e/secret"));
        assert!(!found("tex/%252e%252e/secret", false) && found("100%2525.png", false));
    }
}
