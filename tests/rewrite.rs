//! A reader while another program writes the same file again and again, and two that write it at once.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use vtex::format::{Limits, Reader, save, truncate, verify};

/// Two texels of the corpus.
fn contents() -> [Vec<u8>; 2] {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/1.0");
    ["alpha.vtex", "solid.vtex"].map(|name| std::fs::read(corpus.join(name)).unwrap())
}

/// Do `read` again and again while two threads replace the file, each by its own content; how often it was done.
fn while_it_is_written(path: &Path, read: impl Fn() + Send) -> usize {
    const TIMES: usize = 60;
    let (contents, done) = (contents(), AtomicBool::new(false));
    save(path, &contents[0]).unwrap();
    std::thread::scope(|scope| {
        let writers = contents
            .each_ref()
            .map(|content| scope.spawn(move || (0..TIMES).for_each(|_| save(path, content).unwrap())));
        let done = &done;
        let reader = scope.spawn(move || {
            let mut count = 0;
            while !done.load(Ordering::Relaxed) || count == 0 {
                read();
                count += 1;
            }
            count
        });
        writers.into_iter().for_each(|writer| writer.join().unwrap());
        done.store(true, Ordering::Relaxed);
        reader.join().unwrap()
    })
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vtex");
    (dir, path)
}

#[test]
fn a_reader_meets_one_file_or_the_other() {
    let (dir, path) = folder();
    let whole: Vec<usize> = contents().iter().map(Vec::len).collect();
    let count = while_it_is_written(&path, || {
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        assert!(whole.contains(&(reader.file_bytes() as usize)));
        // The file was replaced meanwhile, perhaps; what was opened stays what it was.
        assert!(!reader.read_all().unwrap().depths.is_empty());
        verify(&path).unwrap();
    });
    assert!(count > 0);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is left behind");
}

/// Truncation reads a file twice: its head, and then its blocks.
#[test]
fn truncation_takes_head_and_blocks_of_one_file() {
    let (dir, path) = folder();
    let short = dir.path().join("short.vtex");
    let count = while_it_is_written(&path, || {
        truncate(&path, 2, &short).unwrap();
        verify(&short).unwrap();
    });
    assert!(count > 0);
}
