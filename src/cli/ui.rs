//! What the user sees while work goes on: a progress bar on a terminal, in a log a line now and then; lines to stderr,
//! results to stdout.

use std::cell::RefCell;
use std::fmt;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::progress_log::ProgressLog;
use super::{fetched, flags, text};
use crate::Warnings;
#[cfg(feature = "bake")]
use crate::par;
use crate::progress::Progress;

/// The terminal, as the commands use it.
pub struct Ui {
    bar: Option<Mutex<ProgressBar>>,
    /// Where stderr is no terminal.
    log: Option<Arc<ProgressLog>>,
    quiet: bool,
    /// Warnings are not printed, only kept.
    silent: bool,
    /// Warnings since they were last taken.
    warned: Mutex<Vec<(String, u64)>>,
    /// Warnings are failures.
    pub strict: bool,
}

impl Ui {
    /// A bar is drawn when stderr is a terminal; else a line tells every ten seconds how far it is. Neither with `quiet`.
    pub fn new(quiet: bool, strict: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (!quiet && terminal).then(|| Mutex::new(ProgressBar::hidden()));
        let log = (!quiet && !terminal).then(Arc::default);
        log.iter().for_each(watch);
        Ui { bar, log, quiet, silent: false, warned: Mutex::default(), strict }
    }

    /// Nothing is drawn or told; warnings are kept for [`Ui::take_warnings`].
    pub fn silent() -> Self {
        Ui { bar: None, log: None, quiet: true, silent: true, warned: Mutex::default(), strict: false }
    }

    /// One line about what is being done, to stderr; not with `--quiet`.
    pub fn say(&self, line: &str) {
        if self.quiet {
            return;
        }
        match self.bar() {
            Some(bar) if !bar.is_finished() && !bar.is_hidden() => bar.suspend(|| message("", line)),
            _ => message("", line),
        }
    }

    /// Print counted warnings; an error under `--strict`.
    pub fn warn(&self, warnings: &Warnings) -> crate::Result<()> {
        for (text, n) in warnings.iter() {
            let times = if n > 1 { format!(" ({n} times)") } else { String::new() };
            if !self.silent {
                message("warning: ", &format!("{text}{times}"));
            }
            self.warned.lock().iter_mut().for_each(|all| all.push((text.to_owned(), n)));
        }
        if self.strict && !warnings.is_empty() {
            return Err(crate::Error::Warned(warnings.iter().map(|(_, n)| n).sum()));
        }
        Ok(())
    }

    /// The warnings since this was last asked for, with their counts.
    pub fn take_warnings(&self) -> Vec<(String, u64)> {
        self.warned.lock().map(|mut all| std::mem::take(&mut *all)).unwrap_or_default()
    }

    /// Take the bar away: no stage is going on.
    pub fn finish(&self) {
        self.log.iter().for_each(|log| log.finish());
        if let Some(bar) = self.bar() {
            bar.finish_and_clear();
        }
    }

    fn bar(&self) -> Option<ProgressBar> {
        self.bar.as_ref().and_then(|bar| bar.lock().ok().map(|bar| bar.clone()))
    }
}

/// Tell from time to time how far `log` is, as long as somebody holds it.
fn watch(log: &Arc<ProgressLog>) {
    const LOOK: Duration = Duration::from_millis(500);
    let (log, start) = (Arc::downgrade(log), Instant::now());
    std::thread::spawn(move || {
        while let Some(log) = log.upgrade() {
            log.line(start.elapsed()).iter().for_each(|line| message("", line));
            drop(log);
            std::thread::sleep(LOOK);
        }
    });
}

/// Write one line to stderr: `kind`, and `line` with flags for options and nothing in it that could look like another line.
/// Where stderr is closed there is nobody to be told.
pub fn message(kind: &str, line: &str) {
    let _ = writeln!(std::io::stderr(), "{kind}{}", text::one_line(&fetched::named(&flags::named(line))));
}

/// Write JSON to stdout; else as [`put`].
pub fn put_json(value: &impl serde::Serialize) -> crate::Result<()> {
    let json = serde_json::to_string_pretty(value).map_err(|e| crate::Error::Options(format!("--json: {e}")))?;
    write(&format!("{}\n", text::json(&fetched::named(&json))))
}

/// Write a result to stdout. A reader that has gone away (`| head`) is no error: what it does not read is dropped.
///
/// # Errors
/// `Io` where it cannot be written, on a full disk for instance.
pub fn put(text: fmt::Arguments) -> crate::Result<()> {
    write(&text::lines(&fetched::named(&text.to_string())))
}

thread_local! {
    /// What this thread prints instead of to stdout, while [`captured`] runs.
    static CAPTURED: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Run `f`, and give what it prints on this thread instead of stdout.
///
/// # Errors
/// What `f` gives; what it has printed is dropped.
#[cfg(feature = "bake")]
pub fn captured(f: impl FnOnce() -> crate::Result<()>) -> crate::Result<String> {
    let outer = CAPTURED.replace(Some(String::new()));
    let result = f();
    let text = CAPTURED.replace(outer);
    result.map(|()| text.unwrap_or_default())
}

/// [`par::with_threads`] for what prints from within: where this thread's prints are captured, they still are.
#[cfg(feature = "bake")]
pub fn with_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    let held = CAPTURED.take();
    let (result, printed) = par::with_threads(threads, || {
        let outer = CAPTURED.replace(held);
        let result = f();
        (result, CAPTURED.replace(outer))
    })?;
    CAPTURED.set(printed);
    Ok(result)
}

fn write(text: &str) -> crate::Result<()> {
    let kept = CAPTURED.with_borrow_mut(|captured| captured.as_mut().map(|all| all.push_str(text)).is_some());
    if kept {
        return Ok(());
    }
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(crate::Error::io("standard output", e)),
        _ => Ok(()),
    }
}

impl Progress for Ui {
    fn stage(&self, name: &str, total: u64) {
        self.log.iter().for_each(|log| log.stage(name, total));
        let Some(slot) = &self.bar else { return };
        let bar = ProgressBar::new(total);
        let template =
            if total > 0 { "{msg:12} {wide_bar} {percent:>3}% {eta:>4}" } else { "{msg:12} {spinner} {elapsed}" };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(name.to_owned());
        if let Ok(mut slot) = slot.lock() {
            slot.finish_and_clear();
            *slot = bar;
        }
    }

    fn advance(&self, steps: u64) {
        self.log.iter().for_each(|log| log.advance(steps));
        if let Some(bar) = self.bar() {
            bar.inc(steps);
        }
    }
}
