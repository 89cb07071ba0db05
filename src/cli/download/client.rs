//! One file by HTTP: the request, what its answer may be, and limits on bytes and time.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use ureq::Body;
use ureq::http::header::{CONTENT_RANGE, LOCATION, RANGE};
use ureq::http::{Response, StatusCode};

use super::url::Url;
use crate::progress::Progress;
use crate::{Error, Result};

/// A machine that does not answer within this time is not there.
const CONNECT: Duration = Duration::from_secs(10);
const PIECE: usize = 1 << 16;

/// What came of a file.
pub struct Answer {
    /// Bytes of the file that were written, from its start on.
    pub got: u64,
    /// Length of the file, where the server says it.
    pub total: Option<u64>,
    /// Why less came than was asked for.
    pub broke: Option<String>,
}

/// Requests of one command, which share its limits.
pub struct Client {
    allow_remote: bool,
    /// Bytes that may still come.
    pub left: u64,
    deadline: Instant,
    seconds: u64,
}

impl Client {
    /// `bytes` and `seconds` are the most that all requests may take together.
    pub fn new(allow_remote: bool, bytes: u64, seconds: u64) -> Client {
        Client { allow_remote, left: bytes, deadline: Instant::now() + Duration::from_secs(seconds), seconds }
    }

    /// Write the first `most` bytes of a file, or all where it has fewer, to `to`. `None` where there is no such file.
    ///
    /// # Errors
    /// `Options` for another machine, `Input` for an answer that is no file, `Io` where no answer comes.
    pub fn get(&mut self, url: &Url, most: u64, to: &Path, progress: &dyn Progress) -> Result<Option<Answer>> {
        self.check(url)?;
        let most = most.min(self.left);
        let mut response = self.request(url, most)?;
        let Some(total) = length(&response).map_err(|what| Error::input(&url.text, "", what))? else {
            return Ok(None);
        };
        let total = total.bytes;
        let mut body = response.body_mut().as_reader().take(if total == Some(0) { 0 } else { most });
        let (got, mut broke) = copy(&mut body, to, progress)?;
        self.left -= got;
        if total.is_some_and(|total| got < total.min(most)) && broke.is_none() {
            broke = Some("the server closed the connection".into());
        }
        Ok(Some(Answer { got, total, broke }))
    }

    /// Check that a file may be asked for.
    fn check(&self, url: &Url) -> Result<()> {
        if !url.is_loopback && !self.allow_remote {
            let what = "is on another machine; option `allow_remote` lets URLs name such";
            return Err(Error::Options(format!("{}: {what}", url.text)));
        }
        if self.left == 0 {
            return Err(Error::Limit {
                what: format!("to download {} too, in bytes,", url.text),
                needed: 1,
                allowed: 0,
            });
        }
        Ok(())
    }

    /// Ask for the first `most` bytes of a file.
    fn request(&self, url: &Url, most: u64) -> Result<Response<Body>> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(self.too_slow(url));
        }
        // An agent for each request: what is left of the time is an agent's. Redirects are not followed, since they would
        // lead away from what was named. Proxies are for other networks than those that are meant here.
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .proxy(None)
            .timeout_connect(Some(CONNECT.min(left)))
            .timeout_global(Some(left))
            .user_agent(concat!("vtex/", env!("CARGO_PKG_VERSION")))
            // Ranges are of the bytes of the file, not of what a server packs them into.
            .accept_encoding("identity");
        let range = format!("bytes=0-{}", most - 1);
        config.build().new_agent().get(&url.text).header(RANGE, range).call().map_err(|e| match e {
            ureq::Error::Timeout(_) if Instant::now() >= self.deadline => self.too_slow(url),
            e => Error::io(&url.text, e.into_io()),
        })
    }

    fn too_slow(&self, url: &Url) -> Error {
        let what = format!("not fetched within {} s (option `download_timeout`)", self.seconds);
        Error::io(&url.text, std::io::Error::new(std::io::ErrorKind::TimedOut, what))
    }
}

/// Length of a file, where the server says it.
struct Length {
    bytes: Option<u64>,
}

/// The length of the file that an answer begins; `None` where there is no such file, and what is wrong with an answer that is no
/// file.
fn length(response: &Response<Body>) -> std::result::Result<Option<Length>, String> {
    let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let bytes = match response.status() {
        StatusCode::PARTIAL_CONTENT => {
            let range = header(CONTENT_RANGE);
            total_of(range).ok_or_else(|| format!("the server gives {range:?} of it, not its beginning"))?
        }
        // It does not know ranges; what is not needed is not read.
        StatusCode::OK => response.body().content_length(),
        // Of an empty file there is no first byte.
        StatusCode::RANGE_NOT_SATISFIABLE => Some(0),
        StatusCode::NOT_FOUND | StatusCode::GONE => return Ok(None),
        status if status.is_redirection() => {
            return Err(format!("the server refers to {:?}; name that, if it is meant", header(LOCATION)));
        }
        status => return Err(format!("the server answers {status}")),
    };
    Ok(Some(Length { bytes }))
}

/// Write a body to the file `to`: how many bytes came, and why no more, where that is not its end.
fn copy(body: &mut dyn Read, to: &Path, progress: &dyn Progress) -> Result<(u64, Option<String>)> {
    let mut file = File::create(to).map_err(|e| Error::io(to, e))?;
    let (mut piece, mut got) = (vec![0; PIECE], 0);
    loop {
        match body.read(&mut piece) {
            Ok(0) => return Ok((got, None)),
            Ok(n) => {
                file.write_all(&piece[..n]).map_err(|e| Error::io(to, e))?;
                got += n as u64;
                progress.advance(n as u64);
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Ok((got, Some(e.to_string()))),
        }
    }
}

/// The length of a file of which a `Content-Range` of its beginning is given; `None` within where the server does not know
/// it, and `None` for another range.
fn total_of(range: &str) -> Option<Option<u64>> {
    let (given, total) = range.strip_prefix("bytes 0-")?.split_once('/')?;
    given.parse::<u64>().ok()?;
    if total == "*" { Some(None) } else { total.parse().ok().map(Some) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_beginning_of_a_file_is_its_beginning() {
        assert_eq!(total_of("bytes 0-99/1234"), Some(Some(1234)));
        assert_eq!(total_of("bytes 0-99/*"), Some(None));
        for wrong in ["", "bytes 1-99/1234", "bytes */1234", "bytes 0-99", "bytes 0-x/5", "bytes 0-9/-1", "items 0-1/2"]
        {
            assert_eq!(total_of(wrong), None, "{wrong}");
        }
    }
}
