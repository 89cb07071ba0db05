//! URLs that may be followed, and the paths of the files that stand for them.

use std::net::IpAddr;
use std::path::{Component, Path, PathBuf};

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use ureq::http::Uri;

/// What a segment of a URL's path has as `%XX`: all but RFC 3986's unreserved characters.
const ENCODED: AsciiSet = NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');
/// Longest name of a file, in bytes; most file systems have this bound.
const LONGEST_NAME: usize = 255;

/// A URL of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Url {
    /// As it was written.
    pub text: String,
    /// Scheme, host and port: "http://localhost:8080".
    pub origin: String,
    /// Its path without the slash before it, percent signs decoded.
    pub path: PathBuf,
    /// Whether its host is this machine.
    pub is_loopback: bool,
}

impl Url {
    /// Take a URL apart; the error says what is wrong with it.
    pub fn parse(text: &str) -> Result<Url, String> {
        let uri: Uri = text.parse().map_err(|e| format!("is not a URL: {e}"))?;
        let (scheme, host) = uri.scheme_str().zip(uri.host()).ok_or("is not a URL: it names no host")?;
        let authority = uri.authority().map(|a| a.as_str()).unwrap_or_default();
        if authority.contains('@') {
            return Err("has a user's name in it, which is not sent; download the file first".into());
        }
        let mut path = PathBuf::new();
        for segment in uri.path().trim_start_matches('/').split('/') {
            let name = percent_decode_str(segment).decode_utf8().map_err(|_| "has a path that is not UTF-8")?;
            let plain = !name.contains(['/', '\\', '\0', ':']) && ![".", "..", ""].contains(&&*name);
            if !plain || name.len() > LONGEST_NAME {
                return Err("is not a URL of a file: its path has parts that cannot be a file's name".into());
            }
            path.push(&*name);
        }
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let is_loopback =
            bare.parse::<IpAddr>().map_or_else(|_| bare.eq_ignore_ascii_case("localhost"), |ip| ip.is_loopback());
        Ok(Url { text: text.to_owned(), origin: format!("{scheme}://{authority}"), path, is_loopback })
    }

    /// The URL of another file of the same origin, `None` where `path` has more in it than names.
    pub fn sibling(&self, path: &Path) -> Option<Url> {
        let mut text = self.origin.clone();
        for part in path.components() {
            let Component::Normal(name) = part else { return None };
            text.push('/');
            text.extend(utf8_percent_encode(name.to_str()?, &ENCODED));
        }
        Url::parse(&text).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_become_paths() {
        let url = Url::parse("http://localhost:8080/a%20b/tree.vtex?x=1").unwrap();
        assert_eq!((url.origin.as_str(), url.path.as_path()), ("http://localhost:8080", Path::new("a b/tree.vtex")));
        let sibling = url.sibling(Path::new("a b/ü#.png")).unwrap();
        assert_eq!(sibling.text, "http://localhost:8080/a%20b/%C3%BC%23.png");
        assert_eq!(sibling.path, Path::new("a b/ü#.png"));
        assert_eq!(url.sibling(Path::new("../x")), None);
        assert_eq!(url.sibling(Path::new("/etc/x")), None);
    }

    #[test]
    fn nothing_but_names_is_in_a_path() {
        let wrong = [
            "http://localhost",
            "http://localhost/",
            "http://localhost/a/",
            "http://localhost/../a",
            "http://localhost/%2e%2e/a",
            "http://localhost/a%2Fb",
            "http://localhost/a%5Cb",
            "http://localhost/a%00b",
            "http://localhost/C%3A",
            "http://localhost/%FF",
            "http://me@localhost/a",
            "http:///a",
            "http://local host/a",
        ];
        for text in wrong {
            assert!(Url::parse(text).is_err(), "{text}");
        }
        assert!(Url::parse(&format!("http://localhost/{}", "a".repeat(256))).is_err());
    }

    #[test]
    fn this_machine_is_told_from_others() {
        let is_loopback = |host: &str| Url::parse(&format!("http://{host}/a")).unwrap().is_loopback;
        for host in ["localhost", "LOCALHOST:80", "127.0.0.1", "127.8.9.1:1", "[::1]", "[::1]:8080"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in
            ["example.com", "localhost.example.com", "127.0.0.1.example.com", "10.0.0.1", "[fe80::1]", "0.0.0.0"]
        {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
