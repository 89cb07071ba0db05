//! Progress where stderr is no terminal: a line every ten seconds, so that a log shows that work goes on, and how far it is.

use std::sync::Mutex;
use std::time::Duration;

/// Time between two lines, and before the first.
const EVERY: Duration = Duration::from_secs(10);

/// How far the work is. Time is told to it, so that it needs no clock.
#[derive(Default)]
pub struct ProgressLog(Mutex<State>);

#[derive(Default)]
struct State {
    /// None between two works.
    stage: Option<Stage>,
    /// When the last line was given.
    told: Duration,
}

struct Stage {
    name: String,
    /// 0: unknown.
    total: u64,
    done: u64,
}

impl ProgressLog {
    /// A stage of `total` steps begins (0: unknown).
    pub fn stage(&self, name: &str, total: u64) {
        self.with(|state| state.stage = Some(Stage { name: name.to_owned(), total, done: 0 }));
    }

    pub fn advance(&self, steps: u64) {
        self.with(|state| state.stage.iter_mut().for_each(|stage| stage.done = stage.done.saturating_add(steps)));
    }

    /// No stage is going on.
    pub fn finish(&self) {
        self.with(|state| state.stage = None);
    }

    /// The line that is due `now`, so long after the start, if one is.
    pub fn line(&self, now: Duration) -> Option<String> {
        self.with(|state| {
            let stage = state.stage.as_ref().filter(|_| now.saturating_sub(state.told) >= EVERY)?;
            state.told = now;
            let Stage { name, total, done } = stage;
            let seconds = now.as_secs();
            Some(match done.saturating_mul(100).checked_div(*total) {
                Some(percent) => format!("progress: {name} {} %, {seconds} s", percent.min(100)),
                None => format!("progress: {name}, {seconds} s"),
            })
        })
    }

    fn with<T: Default>(&self, f: impl FnOnce(&mut State) -> T) -> T {
        self.0.lock().map(|mut state| f(&mut state)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_every_ten_seconds_of_work() {
        let log = ProgressLog::default();
        let at = |seconds: f64| log.line(Duration::from_secs_f64(seconds));
        assert_eq!(at(60.0), None, "nothing is going on");
        log.stage("read", 0);
        assert_eq!(at(9.9), None);
        assert_eq!(at(10.0).as_deref(), Some("progress: read, 10 s"));
        log.stage("bake", 300);
        assert_eq!(at(19.9), None);
        log.advance(100);
        log.advance(1);
        assert_eq!(at(21.0).as_deref(), Some("progress: bake 33 %, 21 s"));
        assert_eq!(at(30.9), None, "ten seconds from the last line on");
        log.advance(u64::MAX);
        assert_eq!(at(31.0).as_deref(), Some("progress: bake 100 %, 31 s"));
        log.finish();
        assert_eq!(at(100.0), None);
    }
}
