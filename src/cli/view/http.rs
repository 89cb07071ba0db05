//! A server for browsers on this machine: HTTP/1.1 on loopback, GET alone, one answer a connection.
//!
//! Any page of any site may ask a browser to request an address of loopback. So a request is answered only where it names this
//! server as its host, which a name that was made to point here (DNS rebinding) does not, and where the browser says that it
//! comes from this server's own pages, or from the address bar.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use percent_encoding::percent_decode_str;

/// Longest head of a request, bytes, and most of its headers.
const HEAD: usize = 16 << 10;
const HEADERS: usize = 96;
/// Connections that are answered at a time.
const MAX_CONNECTIONS: usize = 32;
/// How long a request may take to arrive, and a part of an answer to leave.
const PATIENCE: Duration = Duration::from_secs(10);

/// What is asked for.
pub struct Request {
    /// Beginning with a slash, without the query.
    pub path: String,
    /// Names and values, decoded.
    query: Vec<(String, String)>,
}

impl Request {
    /// The value of a name in the query.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.query.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }
}

/// Whoever waits for the answer.
pub struct Client {
    stream: TcpStream,
}

impl Client {
    /// The whole answer. `kind`: its media type; `policy`: what a page of it may load.
    ///
    /// # Errors
    /// Where the client has gone.
    pub fn answer(&mut self, status: &str, kind: &str, policy: &str, body: &[u8]) -> io::Result<()> {
        let length = format!("Content-Length: {}\r\n", body.len());
        self.head(status, kind, policy, &length)?;
        self.stream.write_all(body)
    }

    /// The beginning of an answer that [`Client::send`] goes on with, and that ends with the connection.
    ///
    /// # Errors
    /// Where the client has gone.
    pub fn begin(&mut self, kind: &str, policy: &str) -> io::Result<()> {
        self.head("200 OK", kind, policy, "")
    }

    /// More of the answer.
    ///
    /// # Errors
    /// Where the client has gone.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }

    /// That there is no such page.
    ///
    /// # Errors
    /// Where the client has gone.
    pub fn missing(&mut self) -> io::Result<()> {
        self.answer("404 Not Found", "text/plain", NOTHING, b"there is no such page\n")
    }

    /// Whether nobody waits any more.
    pub fn is_gone(&self) -> bool {
        let look = || -> io::Result<bool> {
            self.stream.set_nonblocking(true)?;
            let peeked = self.stream.peek(&mut [0]);
            self.stream.set_nonblocking(false)?;
            match peeked {
                Ok(n) => Ok(n == 0),
                Err(e) => Ok(e.kind() != io::ErrorKind::WouldBlock),
            }
        };
        look().unwrap_or(true)
    }

    fn head(&mut self, status: &str, kind: &str, policy: &str, more: &str) -> io::Result<()> {
        let head = format!(
            "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\n{more}Content-Security-Policy: {policy}\r\n\
             Cache-Control: no-store\r\nConnection: close\r\nCross-Origin-Opener-Policy: same-origin\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nReferrer-Policy: no-referrer\r\n\
             X-Content-Type-Options: nosniff\r\n\r\n"
        );
        self.stream.write_all(head.as_bytes())
    }

    fn refuse(&mut self, status: &str) {
        let _ = self.answer(status, "text/plain", NOTHING, format!("{status}\n").as_bytes());
        // What is left unread would make the system drop the answer.
        let _ = self.stream.shutdown(std::net::Shutdown::Write);
        let _ = self.stream.set_read_timeout(Some(Duration::from_millis(100)));
        let _ = (&self.stream).take(1 << 16).read_to_end(&mut Vec::new());
    }
}

/// The policy of what is no page.
pub const NOTHING: &str = "default-src 'none'; frame-ancestors 'none'";

/// Listen on loopback; port 0 is any that is free.
///
/// # Errors
/// What the system says, such as that the port is taken.
pub fn listen(port: u16) -> io::Result<(TcpListener, u16)> {
    let listener = TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))?;
    let port = listener.local_addr()?.port();
    Ok((listener, port))
}

/// Answer requests for as long as the program runs, each on a thread of its own.
pub fn serve(listener: &TcpListener, port: u16, answer: &(dyn Fn(&Request, &mut Client) -> io::Result<()> + Sync)) {
    let open = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // Too many open files, for instance: others may close theirs.
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            let open = &open;
            if open.fetch_add(1, Ordering::Relaxed) >= MAX_CONNECTIONS {
                open.fetch_sub(1, Ordering::Relaxed);
                continue;
            }
            scope.spawn(move || {
                one(Client { stream }, port, answer);
                open.fetch_sub(1, Ordering::Relaxed);
            });
        }
    });
}

fn one(mut client: Client, port: u16, answer: &(dyn Fn(&Request, &mut Client) -> io::Result<()> + Sync)) {
    let set = |stream: &TcpStream| stream.set_write_timeout(Some(PATIENCE)).and_then(|()| stream.set_nodelay(true));
    if set(&client.stream).is_err() {
        return;
    }
    match read(&mut client.stream, port) {
        // A client that goes away is no failure of ours.
        Ok(request) => drop(answer(&request, &mut client)),
        Err(Some(status)) => client.refuse(status),
        Err(None) => {}
    }
}

/// The request, or the status that refuses it; nothing where the connection breaks off.
fn read(stream: &mut TcpStream, port: u16) -> Result<Request, Option<&'static str>> {
    let (mut head, start) = (Vec::new(), Instant::now());
    loop {
        let left = PATIENCE.saturating_sub(start.elapsed());
        if left.is_zero() {
            return Err(Some("408 Request Timeout"));
        }
        stream.set_read_timeout(Some(left)).map_err(|_| None)?;
        let mut part = [0; 2048];
        let n = stream.read(&mut part).map_err(|_| None)?;
        if n == 0 {
            return Err(None);
        }
        head.extend_from_slice(&part[..n]);
        match parse(&head, port) {
            Ok(Some(request)) => return Ok(request),
            Ok(None) if head.len() < HEAD => {}
            Ok(None) => return Err(Some("431 Request Header Fields Too Large")),
            Err(status) => return Err(Some(status)),
        }
    }
}

/// The request that `head` is, if it is whole, or the status that refuses it.
fn parse(head: &[u8], port: u16) -> Result<Option<Request>, &'static str> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    match parsed.parse(head) {
        Ok(status) if status.is_partial() => return Ok(None),
        Ok(_) => {}
        Err(httparse::Error::TooManyHeaders) => return Err("431 Request Header Fields Too Large"),
        Err(_) => return Err("400 Bad Request"),
    }
    let value = |name: &str| {
        let mut own = parsed.headers.iter().filter(|h| h.name.eq_ignore_ascii_case(name));
        // Said twice it is said by nobody.
        own.next().filter(|_| own.next().is_none()).and_then(|h| std::str::from_utf8(h.value).ok())
    };
    let host = value("host").and_then(|host| host.rsplit_once(':'));
    let is_here = host.is_some_and(|(name, own)| {
        (name == "127.0.0.1" || name.eq_ignore_ascii_case("localhost")) && own.parse() == Ok(port)
    });
    let is_own = value("sec-fetch-site").is_none_or(|site| site == "same-origin" || site == "none");
    if !is_here || !is_own {
        return Err("403 Forbidden");
    }
    if parsed.method != Some("GET") {
        return Err("405 Method Not Allowed");
    }
    let target = parsed.path.filter(|path| path.starts_with('/')).ok_or("400 Bad Request")?;
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let decoded = |text: &str| percent_decode_str(text).decode_utf8_lossy().into_owned();
    let pair = |text: &str| text.split_once('=').map(|(name, value)| (decoded(name), decoded(value)));
    Ok(Some(Request { path: decoded(path), query: query.split('&').filter_map(pair).collect() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(head: &str) -> Result<bool, &'static str> {
        parse(head.as_bytes(), 8000).map(|request| request.is_some())
    }

    #[test]
    fn only_our_own_host_is_answered() {
        for host in ["127.0.0.1:8000", "localhost:8000", "LOCALHOST:8000"] {
            assert_eq!(status(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")), Ok(true), "{host}");
        }
        for host in ["127.0.0.1", "127.0.0.1:8001", "evil.example:8000", "127.0.0.1.evil.example:8000", ":8000", ""] {
            assert_eq!(status(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")), Err("403 Forbidden"), "{host}");
        }
        assert_eq!(status("GET / HTTP/1.1\r\n\r\n"), Err("403 Forbidden"));
        let twice = "GET / HTTP/1.1\r\nHost: localhost:8000\r\nHost: evil.example\r\n\r\n";
        assert_eq!(status(twice), Err("403 Forbidden"));
    }

    #[test]
    fn requests_of_other_sites_are_refused() {
        let of =
            |site: &str| status(&format!("GET / HTTP/1.1\r\nHost: localhost:8000\r\nSec-Fetch-Site: {site}\r\n\r\n"));
        assert_eq!([of("none"), of("same-origin")], [Ok(true); 2]);
        assert_eq!([of("cross-site"), of("same-site")], [Err("403 Forbidden"); 2]);
    }

    #[test]
    fn heads_are_read_when_whole() {
        let head = "GET /picture?eye=1,2%2C3&x=&y HTTP/1.1\r\nHost: localhost:8000\r\n\r\n";
        for end in 0..head.len() {
            assert_eq!(status(&head[..end]), Ok(false), "{end}");
        }
        let request = parse(head.as_bytes(), 8000).unwrap().unwrap();
        assert_eq!(
            (request.path.as_str(), request.value("eye"), request.value("x")),
            ("/picture", Some("1,2,3"), Some(""))
        );
        assert_eq!((request.value("y"), request.value("z")), (None, None));
        assert_eq!(status("POST / HTTP/1.1\r\nHost: localhost:8000\r\n\r\n"), Err("405 Method Not Allowed"));
        assert_eq!(
            status("GET http://localhost:8000/ HTTP/1.1\r\nHost: localhost:8000\r\n\r\n"),
            Err("400 Bad Request")
        );
        assert_eq!(status("\0\0"), Err("400 Bad Request"));
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(HEADERS + 1));
        assert_eq!(status(&many), Err("431 Request Header Fields Too Large"));
    }
}
