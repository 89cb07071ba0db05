//! What the user sees while work goes on: a progress bar on a terminal, lines to stderr, results to stdout.

use std::fmt;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};

use super::text;
use crate::Warnings;
use crate::progress::Progress;

/// The terminal, as the commands use it.
pub struct Ui {
    bar: Option<Mutex<ProgressBar>>,
    quiet: bool,
    /// Warnings are failures.
    pub strict: bool,
}

impl Ui {
    /// A bar is drawn only when stderr is a terminal and `quiet` is off.
    pub fn new(quiet: bool, strict: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| Mutex::new(ProgressBar::hidden()));
        Ui { bar, quiet, strict }
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
            message("warning: ", &format!("{text}{times}"));
        }
        if self.strict && !warnings.is_empty() {
            return Err(crate::Error::Warned(warnings.iter().map(|(_, n)| n).sum()));
        }
        Ok(())
    }

    /// Take the bar away.
    pub fn finish(&self) {
        if let Some(bar) = self.bar() {
            bar.finish_and_clear();
        }
    }

    fn bar(&self) -> Option<ProgressBar> {
        self.bar.as_ref().and_then(|bar| bar.lock().ok().map(|bar| bar.clone()))
    }
}

/// Write one line to stderr: `kind`, and `line` with nothing in it that could look like another line. Where stderr is
/// closed there is nobody to be told.
pub fn message(kind: &str, line: &str) {
    let _ = writeln!(std::io::stderr(), "{kind}{}", text::one_line(line));
}

/// Write JSON to stdout; else as [`put`].
pub fn put_json(value: &impl serde::Serialize) -> crate::Result<()> {
    let json = serde_json::to_string_pretty(value).map_err(|e| crate::Error::Options(format!("--json: {e}")))?;
    write(&format!("{}\n", text::json(&json)))
}

/// Write a result to stdout. A reader that has gone away (`| head`) is no error: what it does not read is dropped.
///
/// # Errors
/// `Io` where it cannot be written, on a full disk for instance.
pub fn put(text: fmt::Arguments) -> crate::Result<()> {
    write(&text::lines(&text.to_string()))
}

fn write(text: &str) -> crate::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(crate::Error::io("standard output", e)),
        _ => Ok(()),
    }
}

impl Progress for Ui {
    fn stage(&self, name: &str, total: u64) {
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
        if let Some(bar) = self.bar() {
            bar.inc(steps);
        }
    }
}
