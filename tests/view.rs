//! `vtex view`: what its server answers, to whom, and that the last picture of a landscape is the one of `vtex render`.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use serde_json::Value;

use crate::outputs::Folder;

/// A server that ends with the test.
struct Server {
    child: Child,
    port: u16,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Server {
    fn new(folder: &Folder, words: &[&str]) -> Server {
        let mut command = folder.command(&[&["view"], words].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let port = line.trim().strip_prefix("http://127.0.0.1:").and_then(|rest| rest.strip_suffix('/'));
        let port = port.unwrap_or_else(|| panic!("{line:?}")).parse().unwrap();
        Server { child, port }
    }

    /// Status line and headers, and the body, of an answer to `head`, in which PORT is the server's.
    fn ask(&self, head: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.write_all(head.replace("PORT", &self.port.to_string()).as_bytes()).unwrap();
        let mut all = Vec::new();
        stream.read_to_end(&mut all).unwrap();
        let end = all.windows(4).position(|w| w == b"\r\n\r\n").unwrap_or_else(|| panic!("{all:?}"));
        (String::from_utf8(all[..end].to_vec()).unwrap(), all[end + 4..].to_vec())
    }

    fn get(&self, path: &str) -> (String, Vec<u8>) {
        self.ask(&format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n"))
    }

    fn status(&self, head: &str) -> String {
        self.ask(head).0.lines().next().unwrap().to_owned()
    }
}

#[test]
fn a_texels_page_is_the_exported_one() {
    let folder = Folder::new();
    folder.succeeds(&["export", "quad.vtex", "-o", "quad.html"]);
    let server = Server::new(&folder, &["quad.vtex"]);
    let (head, page) = server.get("/");
    assert!(page == std::fs::read(folder.path("quad.html")).unwrap());
    for header in ["Content-Type: text/html", "frame-ancestors 'none'", "X-Content-Type-Options: nosniff", "no-store"] {
        assert!(head.contains(header), "{header}: {head}");
    }
    assert!(!head.contains("Access-Control"), "no other site may read it: {head}");
    assert!(server.get("/quad.vtex").0.starts_with("HTTP/1.1 404 "));
}

#[test]
fn only_pages_of_this_server_are_answered() {
    let folder = Folder::new();
    let server = Server::new(&folder, &["quad.vtex"]);
    // A name of elsewhere that was made to point here, and a page of elsewhere that asks.
    for head in [
        "GET / HTTP/1.1\r\nHost: evil.example:PORT\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nSec-Fetch-Site: cross-site\r\n\r\n",
    ] {
        assert_eq!(server.status(head), "HTTP/1.1 403 Forbidden", "{head}");
    }
    let post = "POST / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Length: 3\r\n\r\nabc";
    assert_eq!(server.status(post), "HTTP/1.1 405 Method Not Allowed");
    assert_eq!(server.status("what is this\r\n\r\n"), "HTTP/1.1 400 Bad Request");
    let long = format!("GET /{} HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n", "a".repeat(20_000));
    assert_eq!(server.status(&long), "HTTP/1.1 431 Request Header Fields Too Large");
    // It still answers.
    assert_eq!(server.status("GET / HTTP/1.1\r\nHost: localhost:PORT\r\n\r\n"), "HTTP/1.1 200 OK");
}

/// A picture of a stream.
struct Picture {
    size: [usize; 2],
    lanes: u16,
    rgb: Vec<u8>,
}

/// The pictures of a stream, and whether it came to its end.
fn pictures(mut stream: &[u8]) -> (Vec<Picture>, bool) {
    let mut all: Vec<Picture> = Vec::new();
    while stream.len() >= 16 {
        let word = |i: usize| usize::from(u16::from_le_bytes([stream[2 * i], stream[2 * i + 1]]));
        let [kind, lanes, width, height, x, y, w, h] = std::array::from_fn(word);
        if kind == 2 {
            return (all, stream.len() == 16);
        }
        assert_eq!(kind, 1);
        let (size, lanes) = ([width, height], lanes as u16);
        if all.last().is_none_or(|last| last.size != size || last.lanes != lanes) {
            all.push(Picture { size, lanes, rgb: vec![0; 3 * width * height] });
        }
        let rgb = &mut all.last_mut().unwrap().rgb;
        for row in 0..h {
            let (to, from) = (3 * ((y + row) * width + x), 16 + 3 * row * w);
            rgb[to..to + 3 * w].copy_from_slice(&stream[from..from + 3 * w]);
        }
        stream = &stream[16 + 3 * w * h..];
    }
    (all, false)
}

#[test]
fn a_landscapes_pictures_end_with_the_one_of_its_command() {
    let folder = Folder::with_landscape();
    let server = Server::new(&folder, &["land.gltf", "-q", "--", "--sun", "-5,240", "--size", "9x9", "--frame"]);
    let about: Value = serde_json::from_slice(&server.get("/scene").1).unwrap();
    assert_eq!(about["command"], "vtex render land.gltf --sun -5,240");
    for number in ["/camera/fov", "/camera/eye/2", "/camera/target/0", "/radius"] {
        assert!(about.pointer(number).unwrap().is_f64(), "{number}: {about}");
    }
    // More than one tile.
    let (head, stream) = server.get("/picture?eye=-1,1.5,5&target=2,0,2&fov=40&size=150x50&step=8");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    let (all, ended) = pictures(&stream);
    assert!(ended);
    let sizes: Vec<_> = all.iter().map(|p| (p.size, p.lanes)).collect();
    assert_eq!(sizes, [([19, 7], 1), ([75, 25], 1), ([150, 50], 1), ([150, 50], 4)], "coarse first");
    let command =
        "render land.gltf --sun -5,240 --eye=-1,1.5,5 --look-at 2,0,2 --fov 40 --size 150x50 -o made.png --lanes";
    for picture in &all[2..] {
        let lanes = picture.lanes.to_string();
        folder.succeeds(&command.split(' ').chain([lanes.as_str()]).collect::<Vec<_>>());
        let made = image::open(folder.path("made.png")).unwrap().to_rgb8();
        assert!(made.as_raw() == &picture.rgb, "{lanes} lanes");
    }
    // Brighter, as a page asks for it.
    assert_eq!(about["exposure"], serde_json::json!({ "said": false, "auto": false, "stops": 0.0 }));
    let view = |more: &str| {
        let (_, stream) = server.get(&format!("/picture?eye=-1,1.5,5&target=2,0,2&fov=40&size=30x20&step=1{more}"));
        pictures(&stream).0.pop().unwrap().rgb
    };
    let brighter = view("&exposure=1.25");
    let command =
        "render land.gltf --sun -5,240 --eye=-1,1.5,5 --look-at 2,0,2 --fov 40 --size 30x20 --lanes 4 -o made.png";
    folder.succeeds(&command.split(' ').chain(["--exposure", "1.25"]).collect::<Vec<_>>());
    assert!(image::open(folder.path("made.png")).unwrap().to_rgb8().as_raw() == &brighter);
    assert!(brighter != view("") && view("") == view("&exposure=auto"));
    // The ground lies at y = 0 below the middle of a view down on it.
    let (_, point) = server.get("/point?eye=0.5,3,0.5&target=0.5,0,0.51&fov=40&size=60x40&step=1&x=30&y=20");
    let point: Option<[f64; 3]> = serde_json::from_slice(&point).unwrap();
    assert!(point.is_some_and(|p| p[1] > -0.1 && p[1] < 1.0 && (p[0] - 0.5).abs() < 0.2), "{point:?}");
    let (head, page) = server.get("/");
    assert!(head.contains("default-src 'none'; script-src 'self'") && !head.contains("unsafe"), "{head}");
    let page = String::from_utf8(page).unwrap();
    assert!(!page.contains("http") && !page.contains("<script>") && !page.contains("style="), "{page}");
    for module in ["/landscape.mjs", "/camera.mjs", "/pictures.mjs", "/view.mjs"] {
        assert!(server.get(module).0.contains("Content-Type: text/javascript"), "{module}");
    }
}

#[test]
fn what_no_camera_is_is_refused() {
    let folder = Folder::with_landscape();
    let server = Server::new(&folder, &["land.gltf", "-q"]);
    for (query, said) in [
        ("", "fov is missing"),
        ("eye=0,1,0&target=0,0,0&fov=180&size=4x4&step=1", "fov lies between"),
        ("eye=0,1,0&target=0,0,0&fov=NaN&size=4x4&step=1", "fov lies between"),
        ("eye=0,inf,0&target=0,0,0&fov=40&size=4x4&step=1", "eye: "),
        ("eye=0,1,0&target=0,0&fov=40&size=4x4&step=1", "target: "),
        ("eye=0,1,0&target=0,0,0&fov=40&size=4097x4&step=1", "size: "),
        ("eye=0,1,0&target=0,0,0&fov=40&size=0x4&step=1", "size: "),
        ("eye=0,1,0&target=0,0,0&fov=40&size=4x4&step=3", "step is a power of two"),
        ("eye=0,1,0&target=0,0,0&fov=40&size=4x4&step=1&exposure=bright", "exposure: "),
    ] {
        let (head, body) = server.get(&format!("/picture?{query}"));
        let body = String::from_utf8(body).unwrap();
        assert!(head.starts_with("HTTP/1.1 400 ") && body.starts_with(said), "{query}: {head} {body}");
    }
    // An eye at its own target is found out by the renderer, and told in the stream.
    let (_, body) = server.get("/picture?eye=0,1,0&target=0,1,0&fov=40&size=4x4&step=1");
    assert_eq!(body[0], 3);
    assert!(String::from_utf8_lossy(&body[16..]).contains("must differ"));
}

#[test]
fn what_cannot_be_shown_is_one_line() {
    let folder = Folder::with_landscape();
    let server = Server::new(&folder, &["quad.vtex", "-q"]);
    let port = server.port.to_string();
    let line = folder.fails(1, &["view", "quad.vtex", "--port", &port]);
    assert!(line.contains("taken by another program") && line.contains("--port 0"), "{line}");
    assert!(folder.fails(1, &["view", "nothing.vtex"]).contains("nothing.vtex"));
    assert!(folder.fails(1, &["view", "nothing.glb"]).contains("nothing.glb"));
    assert!(folder.fails(2, &["view", "quad.vtex", "--", "--sun", "1,2"]).contains("of a landscape"));
    assert!(folder.fails(2, &["view", "land.gltf", "--", "-o", "x.png"]).contains("--output"));
    assert!(folder.fails(2, &["view", "land.gltf", "--", "--what"]).contains("after --: "));
    assert!(folder.fails(2, &["view", "land.gltf", "--", "--eye", "1,1,1"]).contains("--look-at"));
}

#[test]
fn json_names_the_page() {
    let folder = Folder::new();
    let mut command = folder.command(&["view", "quad.vtex", "--json", "-q"]);
    let mut server = Server { child: command.stdout(Stdio::piped()).spawn().unwrap(), port: 0 };
    let mut text = String::new();
    let mut lines = BufReader::new(server.child.stdout.take().unwrap()).lines();
    while !text.ends_with("}\n") {
        text += &(lines.next().unwrap().unwrap() + "\n");
    }
    let told: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(told["input"], "quad.vtex");
    assert!(told["url"].as_str().unwrap().starts_with("http://127.0.0.1:"), "{told}");
}
