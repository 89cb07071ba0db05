//! Inputs run in a child process, so that one that ends it (a stack that overflows, memory that is refused) is found as well; the
//! next child goes on behind it.

use std::fmt::Write as _;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use crate::memory;
use crate::mutators::{Dice, mutate};
use crate::run::{MAX_MEMORY, run};
use crate::seeds::{Format, formats, kind, put};

/// How an input ended.
pub struct Outcome {
    pub number: u64,
    pub format: String,
    /// `baked`, `refused`, or a fault.
    pub result: String,
    pub text: String,
    /// The most memory that it took, bytes.
    pub peak: u64,
}

/// Seconds of the processor that a long run gives an input.
const MAX_SECONDS: u64 = 60;
const SEED: u64 = 1;

/// The part of the numbers that a child process runs.
pub struct Job {
    numbers: Range<u64>,
    folder: PathBuf,
}

const JOB: &str = "VTEX_MUTATIONS_JOB";

impl Job {
    /// What this process was started for, if it is a child.
    pub fn of_this_process() -> Option<Job> {
        let text = std::env::var(JOB).ok()?;
        let mut words = text.splitn(3, ' ');
        let mut number = || words.next()?.parse().ok();
        let numbers = number()?..number()?;
        Some(Job { numbers, folder: words.next()?.into() })
    }

    /// Run its inputs, and write how each ended into the folder's `log`.
    pub fn work(&self) {
        let made = self.folder.join("seeds");
        std::fs::create_dir_all(&made).unwrap();
        let mut formats = formats(&made);
        if let Ok(wanted) = std::env::var("VTEX_MUTATIONS_OF") {
            formats.retain(|f| wanted.split(',').any(|w| w == f.name));
        }
        std::panic::set_hook(Box::new(|info| {
            let place = info.location().map(|l| format!(" at {}:{}", l.file(), l.line())).unwrap_or_default();
            let payload = info.payload();
            let words = payload.downcast_ref::<String>().map(String::as_str);
            let text = words.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or_default();
            *PANIC.lock().unwrap() = format!("{text}{place}");
        }));
        vtex::par::with_threads(1, || self.numbers.clone().for_each(|number| self.one(number, &formats))).unwrap();
    }

    fn one(&self, number: u64, formats: &[Format]) {
        let format = &formats[number as usize % formats.len()];
        let input = self.folder.join("input");
        let _ = std::fs::remove_dir_all(&input);
        std::fs::write(self.folder.join("current"), format!("{number} {}", format.name)).unwrap();
        // The first input of each format is as it was made: a seed that is not read would be a test of nothing.
        let whole = (number as usize) < formats.len();
        let main = lay_out(number, format, &input, whole);
        let (result, peak) = memory::peak(|| catch_unwind(AssertUnwindSafe(|| run(format.command, &main, number))));
        let (result, text) = match result {
            Ok(Ok(())) => ("baked", String::new()),
            Ok(Err(e)) => {
                let text = e.to_string();
                let wrong = text.is_empty() || text.contains(['\n', '\r']);
                (if whole || wrong { "text" } else { "refused" }, text)
            }
            Err(_) => ("panic", std::mem::take(&mut *PANIC.lock().unwrap())),
        };
        let result = if peak as u64 > MAX_MEMORY { "memory" } else { result };
        let mut line = String::new();
        let _ = writeln!(line, "{number}\t{}\t{result}\t{peak}\t{}", format.name, text.escape_debug());
        let log = std::fs::OpenOptions::new().create(true).append(true).open(self.folder.join("log"));
        std::io::Write::write_all(&mut log.unwrap(), line.as_bytes()).unwrap();
    }
}

static PANIC: Mutex<String> = Mutex::new(String::new());

/// Write the input of this number, mutated unless it stays `whole`; the file or folder that is to be opened.
fn lay_out(number: u64, format: &Format, folder: &Path, whole: bool) -> PathBuf {
    let mut dice = Dice::new(SEED, number);
    let seed = if whole { &format.seeds[0] } else { dice.of(&format.seeds) };
    // The first file is the one that is opened; those beside it change less often.
    let changed = if dice.one_in(2) { 0 } else { dice.below(seed.files.len()) };
    for (i, (name, bytes)) in seed.files.iter().enumerate() {
        let bytes = if i == changed && !whole {
            let alike: Vec<&Vec<u8>> =
                format.seeds.iter().flat_map(|s| &s.files).filter(|f| kind(&f.0) == kind(name)).map(|f| &f.1).collect();
            let other = *dice.of(&alike);
            &mutate(&mut dice, kind(name), bytes, other)
        } else {
            bytes
        };
        put(&folder.join(name), bytes);
    }
    folder.join(&seed.main)
}

/// Run all inputs of these numbers; `long`: watch that each ends.
pub fn all(numbers: Range<u64>, folder: &Path, keep: Option<&Path>, long: bool) -> Vec<Outcome> {
    let mut outcomes = Vec::new();
    let mut next = numbers.start;
    while next < numbers.end {
        let _ = std::fs::remove_file(folder.join("log"));
        let _ = std::fs::remove_file(folder.join("current"));
        let end = child(&(next..numbers.end), folder, long);
        let log = std::fs::read_to_string(folder.join("log")).unwrap_or_default();
        let done: Vec<Outcome> = log.lines().filter_map(parsed).collect();
        next += done.len() as u64;
        outcomes.extend(done);
        if let Some(why) = end {
            let current = std::fs::read_to_string(folder.join("current")).unwrap_or_default();
            let (number, format) = current.split_once(' ').expect("the child started an input");
            assert_eq!(number.parse(), Ok(next), "the child's log: {log}");
            let ended = |result: &str, text| Outcome {
                number: next,
                format: format.into(),
                result: result.into(),
                text,
                peak: 0,
            };
            outcomes.push(ended("ended", why));
            next += 1;
        }
        if let Some(keep) = keep {
            outcomes.iter().for_each(|o| kept(o, folder, keep));
        }
    }
    outcomes
}

/// Keep the input of a fault, with its text beside it.
fn kept(outcome: &Outcome, folder: &Path, keep: &Path) {
    let own = keep.join(format!("{}-{}-{}", outcome.format, outcome.number, outcome.result));
    if ["baked", "refused"].contains(&outcome.result.as_str()) || own.exists() {
        return;
    }
    std::fs::create_dir_all(&own).unwrap();
    std::fs::write(own.join("fault.txt"), &outcome.text).unwrap();
    let mut formats = formats(&folder.join("seeds"));
    formats.retain(|f| f.name == outcome.format);
    if let Some(format) = formats.first() {
        lay_out(outcome.number, format, &own, false);
    }
}

fn parsed(line: &str) -> Option<Outcome> {
    let mut fields = line.splitn(5, '\t');
    let mut field = || fields.next().map(str::to_owned);
    let (number, format, result, peak) = (field()?.parse().ok()?, field()?, field()?, field()?.parse().ok()?);
    Some(Outcome { number, format, result, peak, text: field()? })
}

/// Run a child over these numbers. `None` where it came to its end, else why it did not.
fn child(numbers: &Range<u64>, folder: &Path, long: bool) -> Option<String> {
    let job = format!("{} {} {}", numbers.start, numbers.end, folder.display());
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "mutated_inputs_are_refused_in_a_line", "--nocapture"])
        .env(JOB, job)
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(folder.join("stderr")).unwrap())
        .spawn()
        .unwrap();
    if !long {
        let status = child.wait().unwrap();
        return (!status.success()).then(|| why(&status.to_string(), folder));
    }
    let (mut current, mut since) = (String::new(), 0);
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return (!status.success()).then(|| why(&status.to_string(), folder));
        }
        std::thread::sleep(Duration::from_millis(200));
        let now = std::fs::read_to_string(folder.join("current")).unwrap_or_default();
        let used = seconds(child.id());
        if now != current {
            (current, since) = (now, used);
        } else if used.saturating_sub(since) > MAX_SECONDS {
            child.kill().unwrap();
            child.wait().unwrap();
            return Some(format!("it takes more than {MAX_SECONDS} s"));
        }
    }
}

fn why(status: &str, folder: &Path) -> String {
    let said = std::fs::read_to_string(folder.join("stderr")).unwrap_or_default();
    let last: Vec<&str> = said.lines().filter(|l| !l.trim().is_empty()).collect();
    format!("{status}; {}", last[last.len().saturating_sub(3)..].join(" / "))
}

/// Seconds of the processor that a process has taken; 0 where the system does not say.
fn seconds(process: u32) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let after = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks: u64 = after.split_whitespace().skip(11).take(2).filter_map(|w| w.parse::<u64>().ok()).sum();
    // Ticks are hundredths of a second wherever Linux says so to users.
    ticks / 100
}
