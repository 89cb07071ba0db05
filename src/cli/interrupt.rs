//! SIGINT, SIGTERM and SIGHUP: nothing half-written is left, and the exit code is 128 + the signal's number. SIGBUS: a mapped
//! input that others cut short while it is read is one line and exit code 1.

/// Watch for signals from now on. Those that the caller ignores (`nohup`, jobs in the background) stay ignored.
#[cfg(unix)]
pub fn watch() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let ignored = ignored();
    let wanted = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    crate::system::exit_on_bus_error(CUT_SHORT);
    // Without a handler the signals still end the program, as they do by default.
    let Ok(mut signals) = signal_hook::iterator::Signals::new(wanted) else { return };
    std::thread::spawn(move || {
        if let Some(signal) = signals.forever().next() {
            remove_parts(&|_| true);
            super::fetched::remove_all();
            signal_hook::low_level::exit(128 + signal);
        }
    });
}

#[cfg(not(unix))]
pub fn watch() {}

#[cfg(unix)]
const CUT_SHORT: &[u8] = b"error: an input became shorter while it was read, or its disk failed; try again\n";

/// Set of the signals that this process was started to ignore: bit n − 1 for signal n.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Remove the temporary files that this process has open. They are told by the identity of the open file, since another
/// machine's process of the same number may be writing to the same folder. Where the system does not list open files,
/// temporary files stay. Only folders that are `within` what is asked for.
#[cfg(unix)]
fn remove_parts(within: &dyn Fn(&std::path::Path) -> bool) {
    use crate::format::PART_NAME;
    use std::os::unix::fs::MetadataExt;
    let [start, end] = PART_NAME;
    for open in std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten() {
        // The entry of a file that had no name when it was opened names the folder all the same.
        let (Ok(mine), Ok(link)) = (std::fs::metadata(open.path()), std::fs::read_link(open.path())) else { continue };
        let Some(folder) = link.parent().filter(|folder| mine.is_file() && folder.is_absolute() && within(folder))
        else {
            continue;
        };
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let is_part = name.to_str().is_some_and(|name| name.starts_with(start) && name.ends_with(end));
            let same = |other: std::fs::Metadata| (other.dev(), other.ino()) == (mine.dev(), mine.ino());
            if is_part && entry.metadata().is_ok_and(same) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn only_own_temporary_files_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let real = dir.path().canonicalize().unwrap();
        let [own, others, plain] = [".vtex-1-0.part", ".vtex-1-1.part", "a.vtex"].map(|name| dir.path().join(name));
        let open = [std::fs::File::create(&own).unwrap(), std::fs::File::create(&plain).unwrap()];
        std::fs::write(&others, "").unwrap();
        remove_parts(&|folder| folder == real);
        drop(open);
        assert!(!own.exists() && others.exists() && plain.exists());
    }
}
