//! Inputs by HTTP: from nginx, which knows ranges and tells in its log what it sent, and from servers that break off. Tests that
//! need nginx print a line and pass where it is not installed.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::outputs::Folder;

/// nginx, serving the folder `root` in a folder of its own.
struct Server {
    child: Child,
    port: u16,
    folder: tempfile::TempDir,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Server {
    /// `None`, and a line that says so, where there is no nginx.
    fn start() -> Option<Server> {
        let program =
            ["/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/bin/nginx"].into_iter().find(|p| Path::new(p).exists());
        let Some(program) = program else {
            println!("nginx is not installed: not tested");
            return None;
        };
        // Another program may take the port before nginx does.
        (0..10).find_map(|_| {
            Server::on_port(program, TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port())
        })
    }

    fn on_port(program: &str, port: u16) -> Option<Server> {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().display();
        std::fs::create_dir(folder.path().join("root")).unwrap();
        // Without a master process, so that nginx keeps the rights of who runs the tests.
        let temporary: String =
            ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"].map(|t| format!("{t}_temp_path {at}/t;\n")).concat();
        let settings = format!(
            "daemon off; master_process off; pid {at}/pid; error_log {at}/errors;\nevents {{}}\nhttp {{\n{temporary}\
             log_format told '$request_method|$request_uri|$status|$http_range|$body_bytes_sent';\n\
             access_log {at}/log told;\ntypes {{ model/vnd.vtex vtex; }}\n\
             server {{ listen 127.0.0.1:{port}; root {at}/root;\nlocation = /moved.vtex {{ return 302 /a.vtex; }}\n\
             location = /locked.vtex {{ return 403; }} }} }}\n"
        );
        std::fs::write(folder.path().join("settings"), settings).unwrap();
        let path = folder.path().join("settings");
        let mut child =
            Command::new(program).arg("-c").arg(path).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(20) {
            if TcpStream::connect(("127.0.0.1", port)).is_ok() {
                return Some(Server { child, port, folder });
            }
            if child.try_wait().unwrap().is_some() {
                return None;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = (child.kill(), child.wait());
        None
    }

    fn root(&self) -> PathBuf {
        self.folder.path().join("root")
    }

    fn url(&self, name: &str) -> String {
        format!("http://127.0.0.1:{}/{name}", self.port)
    }

    /// Address, status, range and bytes of the body of each answer since this was last asked for.
    fn answers(&self, count: usize) -> Vec<(String, u16, String, u64)> {
        let path = self.folder.path().join("log");
        // nginx writes its line after the answer.
        let start = Instant::now();
        let mut text = String::new();
        while start.elapsed() < Duration::from_secs(20) {
            text = std::fs::read_to_string(&path).unwrap();
            if text.lines().count() >= count {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        std::fs::File::options().write(true).open(&path).unwrap().set_len(0).unwrap();
        let answer = |line: &str| {
            let parts: Vec<&str> = line.trim_start_matches('\0').split('|').collect();
            (parts[1].to_owned(), parts[2].parse().unwrap(), parts[3].to_owned(), parts[4].parse().unwrap())
        };
        text.lines().map(answer).collect()
    }
}

/// Run vtex in a folder, which also holds its temporary files.
fn vtex(folder: &Path, arguments: &[&str]) -> Output {
    let temporary = folder.join("temporary");
    std::fs::create_dir_all(&temporary).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_vtex"));
    let output = command.args(arguments).current_dir(folder).env("TMPDIR", &temporary).output().unwrap();
    let left: Vec<_> = std::fs::read_dir(&temporary).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(left.is_empty(), "{arguments:?} leaves {left:?}");
    output
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A command that fails with `code` and one line, which is given.
fn refused(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = vtex(folder, arguments);
    let line = said(&output);
    assert_eq!((output.status.code(), line.lines().count()), (Some(code), 1), "{arguments:?}: {line}");
    line
}

/// Bytes of some ranges of a file, by one request; the body of the answer, which has more in it where there are several ranges.
fn request(port: u16, name: &str, ranges: &str) -> Vec<u8> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    write!(stream, "GET /{name} HTTP/1.1\r\nHost: localhost\r\nRange: bytes={ranges}\r\nConnection: close\r\n\r\n")
        .unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    assert!(answer.starts_with(b"HTTP/1.1 206 "), "{}", String::from_utf8_lossy(&answer[..60.min(answer.len())]));
    let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
    answer.split_off(end)
}

/// The sample tree, 64³, as `tree.vtex` of a folder. Its coarse depths are as large as those of a finer one.
fn tree(folder: &Path) {
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/tree.glb");
    let arguments = ["bake", sample, "-r", "64", "-q", "-o", "tree.vtex"];
    let output = Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
}

#[test]
fn a_part_of_a_texel_takes_two_requests() {
    const MOST: u64 = 64 << 10;
    let Some(server) = Server::start() else { return };
    tree(&server.root());
    let file = std::fs::read(server.root().join("tree.vtex")).unwrap();
    let head = vtex::format::Reader::open(server.root().join("tree.vtex"), &Default::default()).unwrap().head().clone();

    // §7.1 of vtex-1.md: the head and the coarse depths, then the bytes up to the end of the depth that is wanted.
    let first = request(server.port, "tree.vtex", "0-16383");
    let end = head.depths[5].block_end;
    let second = request(server.port, "tree.vtex", &format!("16384-{}", end - 1));
    let prefix = [first.clone(), second].concat();
    assert_eq!(prefix, file[..end as usize]);
    assert!(prefix.len() as u64 <= MOST, "32³: {} bytes", prefix.len());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("prefix.vtex");
    std::fs::write(&path, &prefix).unwrap();
    let found = vtex::format::Reader::open_prefix(&path, &Default::default()).unwrap().read_all().unwrap();
    let whole =
        vtex::format::Reader::open(server.root().join("tree.vtex"), &Default::default()).unwrap().read_all().unwrap();
    assert_eq!(found.depths.len(), 6);
    (0..6).for_each(|d| assert_eq!(found.depths[d].voxels, whole.depths[d].voxels, "depth {d}"));

    // The sections of opacity and colour at 64³ and the topology that leads there, which is all that a plain picture needs.
    let stream = |name: &[u8; 4]| head.streams.iter().position(|s| s.semantic == *name).unwrap() as u8;
    let [rate, albedo] = [stream(b"RATE"), stream(b"ALBD")];
    let wanted = |s: &&vtex::format::SectionEntry| match s.kind {
        vtex::format::SectionKind::Topo => s.offset + s.length > 16384,
        vtex::format::SectionKind::Page => s.depth == 6 && [rate, albedo].contains(&s.stream),
        _ => false,
    };
    let mut ranges: Vec<[u64; 2]> = Vec::new();
    for section in head.sections.iter().filter(wanted) {
        let (from, to) = (section.offset.max(16384), section.offset + section.length);
        match ranges.last_mut().filter(|last| from <= last[1] + 8) {
            Some(last) => last[1] = to,
            None => ranges.push([from, to]),
        }
    }
    let text: Vec<String> = ranges.iter().map(|[from, to]| format!("{from}-{}", to - 1)).collect();
    let body = request(server.port, "tree.vtex", &text.join(","));
    assert!(ranges.len() > 1, "{text:?}");
    for [from, to] in ranges {
        let part = &file[from as usize..to as usize];
        assert!(body.windows(part.len()).any(|w| w == part), "{from}-{to}");
    }
    let all = (first.len() + body.len()) as u64;
    println!("64³, opacity and colour: {all} bytes; all of 64³: {} bytes", head.depths[6].block_end);
    assert!(all <= MOST, "64³, opacity and colour: {all} bytes");
}

#[test]
fn inspect_of_a_url_takes_one_request() {
    let Some(server) = Server::start() else { return };
    tree(&server.root());
    let folder = tempfile::tempdir().unwrap();
    let url = server.url("tree.vtex");
    let by_url = vtex(folder.path(), &["inspect", &url, "--json"]);
    assert!(by_url.status.success(), "{}", said(&by_url));
    let answers = server.answers(1);
    assert!(
        matches!(&answers[..], [(name, 206, range, 65536)] if name == "/tree.vtex" && range == "bytes=0-65535"),
        "{answers:?}"
    );
    let by_file = vtex(&server.root(), &["inspect", "tree.vtex", "--json"]);
    let [mut by_url, by_file] = [by_url, by_file].map(|o| crate::json::of("inspect", &o.stdout));
    assert_eq!(by_url["input"], url.as_str());
    by_url["input"] = "tree.vtex".into();
    assert_eq!(by_url, by_file);

    // A preview shows voxels, so all of the file is fetched.
    let done = vtex(folder.path(), &["inspect", &url, "--preview", "a.png", "--preview-size", "16"]);
    assert!(done.status.success(), "{}", said(&done));
    assert_eq!(server.answers(1)[0].3, std::fs::metadata(server.root().join("tree.vtex")).unwrap().len());
    // Within the limit are some depths.
    let done = vtex(
        folder.path(),
        &["inspect", &url, "--preview", "a.png", "--preview-size", "16", "--max-download", "20000"],
    );
    let line = said(&done);
    assert!(done.status.success() && line.contains(&format!("{url}: is cut short after 20000 of ")), "{line}");
    assert!(line.contains("depths up to 4 are whole"), "{line}");
    assert_eq!(server.answers(1)[0].3, 20000);
}

#[test]
fn a_landscape_comes_with_what_it_names() {
    let Some(server) = Server::start() else { return };
    let local = Folder::with_landscape();
    // Below a folder whose name is percent-encoded, as other names may be.
    let root = server.root().join("a b");
    std::fs::create_dir(&root).unwrap();
    for entry in std::fs::read_dir(local.path(".")).unwrap().map(|e| e.unwrap()).filter(|e| e.path().is_file()) {
        std::fs::copy(entry.path(), root.join(entry.file_name())).unwrap();
    }
    let url = server.url("a%20b/land.gltf");
    let options = ["--frame", "--size", "32x18"];
    let by_file = vtex(&local.path("."), &[&["render", "land.gltf", "-o", "file.png"][..], &options].concat());
    assert!(by_file.status.success(), "{}", said(&by_file));
    let by_url = vtex(&local.path("."), &[&["render", &url, "--json"][..], &options].concat());
    assert!(by_url.status.success(), "{}", said(&by_url));
    let told = crate::json::of("render", &by_url.stdout);
    assert_eq!((told["input"].as_str(), told["output"].as_str()), (Some(url.as_str()), Some("land.png")));
    let read = |name: &str| std::fs::read(local.path(name)).unwrap();
    assert!(read("file.png") == read("land.png"), "the pictures are the same");
    let names: Vec<String> = server.answers(2).into_iter().map(|a| a.0).collect();
    assert!(names.contains(&"/a%20b/quad.vtex".to_owned()), "{names:?}");
    assert!(names.iter().all(|name| name.starts_with("/a%20b/")), "{names:?}");

    let line = refused(&local.path("."), &["render", &url, "--depfile", "d"], 2);
    assert!(line.contains("--depfile"), "{line}");
    std::fs::remove_file(root.join("quad.vtex")).unwrap();
    let done = vtex(&local.path("."), &[&["render", &url][..], &options].concat());
    let missing = format!("error: {}: No such file", server.url("a b/quad.vtex"));
    assert!(done.status.code() == Some(1) && said(&done).contains(&missing), "{}", said(&done));
}

#[test]
fn what_is_not_to_be_followed_is_refused_in_one_line() {
    let Some(server) = Server::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let vector = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/");
    for (from, to) in [("ok-lean.vtex", "a.vtex"), ("bad-head-crc-1.vtex", "bad.vtex")] {
        std::fs::copy(format!("{vector}{from}"), server.root().join(to)).unwrap();
    }
    std::fs::write(server.root().join("empty.vtex"), "").unwrap();
    let here = |name: &str| server.url(name);
    let export = |url: &str, code| refused(folder.path(), &["export", url, "-o", "a.html"], code);
    assert!(export(&here("moved.vtex"), 1).contains("refers to \"http://127.0.0.1:"));
    assert!(export(&here("locked.vtex"), 1).contains("answers 403"));
    assert!(export(&here("none.vtex"), 1).contains("no such file"));
    assert!(export(&here("empty.vtex"), 1).contains("[magic"));
    assert!(export(&here(""), 2).contains("not a URL of a file"));
    // Another machine is not even asked: this address is nobody's (RFC 5737).
    assert!(export("http://192.0.2.1/a.vtex", 2).contains("--allow-remote"));
    // Of a page, all is needed.
    let line = refused(folder.path(), &["export", &here("a.vtex"), "-o", "a.html", "--max-download", "1000"], 1);
    assert!(line.contains("the limit is 1000"), "{line}");
    let line = refused(folder.path(), &["inspect", &here("a.vtex"), "--max-download", "200"], 1);
    assert!(line.contains("the head of") && line.contains("the limit is 200"), "{line}");
    // What is wrong with a file is told of its URL.
    let line = refused(folder.path(), &["inspect", &here("bad.vtex"), "--preview", "a.png"], 1);
    assert!(line.contains(&format!("{}: not a valid vtex file", here("bad.vtex"))), "{line}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "only the folder for temporary files");
}

/// A server that gives the first `given` bytes of a file and then `then`; its port.
fn breaking(file: Vec<u8>, given: usize, then: fn(TcpStream)) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            let _ = stream.read(&mut [0; 4096]);
            let (last, total) = (file.len() - 1, file.len());
            let header = format!(
                "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-{last}/{total}\r\nContent-Length: {total}\r\n\r\n"
            );
            let _ = stream
                .write_all(header.as_bytes())
                .and_then(|()| stream.write_all(&file[..given]))
                .and_then(|()| stream.flush());
            then(stream);
        }
    });
    port
}

#[test]
fn a_download_that_breaks_off_shows_what_came() {
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/ok-lean.vtex")).unwrap();
    let given = file.len() - 1;
    let port = breaking(file, given, drop);
    let url = format!("http://localhost:{port}/a.vtex");
    let done = vtex(folder.path(), &["inspect", &url, "--preview", "a.png", "--preview-size", "16"]);
    let lines = said(&done);
    assert!(
        done.status.success() && lines.contains(&format!("{url}: the connection broke after {given} bytes")),
        "{lines}"
    );
    assert!(lines.contains(&format!("{url}: is cut short after {given} of ")), "{lines}");
    let line = refused(folder.path(), &["export", &url, "-o", "a.html"], 1);
    assert!(line.contains("the connection broke"), "{line}");
}

#[test]
fn a_server_that_says_nothing_more_is_waited_for_so_long() {
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/ok-lean.vtex")).unwrap();
    // The stream is kept open until the test ends.
    let port = breaking(file, 100, std::mem::forget);
    let url = format!("http://localhost:{port}/a.vtex");
    let line = refused(folder.path(), &["export", &url, "-o", "a.html", "--download-timeout", "1"], 1);
    assert!(line.contains(&url), "{line}");
}
