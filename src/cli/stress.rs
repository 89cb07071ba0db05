//! `vtex stress`: rays through hostile geometry, and a count of what went wrong.

use super::Ui;
use super::results::print;
use crate::render::stress::{Options, SUITES, Suite, Tally, stress};
use crate::{Error, Result, par};

#[derive(clap::Args)]
pub struct Args {
    /// Rays of all suites together
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    rays: u64,
    /// Other geometry and rays
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Only this suite; may be given again
    #[arg(long, value_name = "NAME", value_parser = SUITES.map(|s| s.name))]
    suite: Vec<String>,
    /// Threads to use [default: all cores]
    #[arg(long, default_value_t = 0, hide_default_value = true, value_name = "N")]
    threads: usize,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Fails where anything was counted.
pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let options = Options { rays: args.rays, seed: args.seed };
    let wanted = |s: &Suite| args.suite.is_empty() || args.suite.iter().any(|n| n == s.name);
    let found = par::with_threads(args.threads, || stress(&options, &wanted, ui))??;
    ui.finish();
    let events: u64 = found.iter().map(|f| f.1.events()).sum();
    let rays: u64 = found.iter().map(|f| f.1.rays).sum();
    if args.json {
        let suite = |(suite, tally): &(&Suite, Tally)| {
            let mut row = serde_json::json!(tally);
            row["name"] = suite.name.into();
            row["about"] = suite.about.into();
            row
        };
        let suites: Vec<_> = found.iter().map(suite).collect();
        let all = serde_json::json!({ "rays": rays, "events": events, "seed": args.seed, "suites": suites });
        print(all, true, ui)?;
    } else {
        out!("{}", table(&found))?;
        outln!("{rays} rays, {events} events")?;
    }
    if events > 0 {
        return Err(Error::Failed(format!(
            "{events} of {rays} rays went wrong; --seed {} makes them again",
            args.seed
        )));
    }
    Ok(())
}

fn table(found: &[(&Suite, Tally)]) -> String {
    let mut out = format!(
        "{:8} {:>11} {:>6} {:>6} {:>6} {:>6} {:>8}  {:>9} {:>9} {:>9}\n",
        "suite", "rays", "NaN", "leaks", "rises", "steps", "oracle", "cut", "worst", "relative"
    );
    for (suite, t) in found {
        out += &format!(
            "{:8} {:>11} {:>6} {:>6} {:>6} {:>6} {:>8}  {:>9.1e} {:>9.1e} {:>9.1e}\n",
            suite.name, t.rays, t.nan, t.leaks, t.rises, t.steps, t.deviations, t.worst_step, t.worst, t.worst_relative
        );
    }
    out += "\n";
    for (suite, _) in found {
        out += &format!("{:8} {}\n", suite.name, suite.about);
    }
    out
}
