//! What was measured, for people and as JSON.

use super::histogram::Histogram;
use crate::{Failed, print};
use serde_json::{Value, json};
use std::fs;

/// A line of the table.
pub struct Row {
    /// Measured quantity: `wake-up`, `0x77f`, `driver_canbus main`.
    pub name: String,
    /// Period, µs; `None` for what has none.
    pub period_us: Option<u64>,
    /// The times.
    pub times: Histogram,
    /// Further counters, by name.
    pub counts: Vec<(&'static str, u64)>,
}

/// A table with its heading.
pub struct Report {
    /// Method, in one line.
    pub how: String,
    /// Meaning of the times, in a word or two.
    pub times: &'static str,
    /// Rows.
    pub rows: Vec<Row>,
}

impl Report {
    /// Prints it: as one JSON object, or for people.
    pub fn print(&self, json: bool, histogram: bool) -> Result<(), Failed> {
        if json {
            return print(self.json(histogram));
        }
        print(self.text(histogram).trim_end())
    }

    pub fn text(&self, histogram: bool) -> String {
        use std::fmt::Write;
        let width = self.rows.iter().map(|row| row.name.len()).max().unwrap_or(0).max(self.times.len());
        let mut text = format!("{}\n", self.how);
        let _ = writeln!(
            text,
            "{:width$} {:>10} {:>9}  {:>7} {:>9} {:>7} {:>7} {:>7}",
            self.times, "period us", "count", "min us", "mean", "p99", "p99.9", "max"
        );
        for Row { name, period_us, times, counts } in &self.rows {
            let period = period_us.map_or("-".into(), |period| period.to_string());
            let _ = write!(
                text,
                "{name:width$} {period:>10} {:>9}  {:>7} {:>9.1} {:>7} {:>7} {:>7}",
                times.count(),
                times.min(),
                times.mean(),
                times.quantile(99, 100),
                times.quantile(999, 1000),
                times.max()
            );
            for (what, count) in counts {
                let _ = write!(text, "  {count} {what}");
            }
            text.push('\n');
        }
        if histogram {
            for Row { name, times, .. } in &self.rows {
                let _ = writeln!(text, "\n{name}: us, count");
                for (us, count) in times.filled() {
                    let _ = writeln!(text, "{us:06} {count:06}");
                }
            }
        }
        text
    }

    fn json(&self, histogram: bool) -> Value {
        let row = |Row { name, period_us, times, counts }: &Row| {
            let mut row = json!({
                "name": name,
                "period_us": period_us,
                "count": times.count(),
                "min_us": times.min(),
                "mean_us": times.mean(),
                "p99_us": times.quantile(99, 100),
                "p999_us": times.quantile(999, 1000),
                "max_us": times.max(),
            });
            if let Some(row) = row.as_object_mut() {
                row.extend(counts.iter().map(|(what, count)| (what.replace(' ', "_"), json!(count))));
            }
            if histogram {
                row["histogram"] = json!(times.filled().collect::<Vec<_>>());
            }
            row
        };
        let rows: Vec<Value> = self.rows.iter().map(row).collect();
        json!({ "how": self.how, "times": self.times, "kernel": kernel(), "preempt_rt": preempt_rt(), "rows": rows })
    }
}

/// The kernel that runs, for people.
pub fn kernel() -> String {
    let release = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{}{}", release.trim(), if preempt_rt() { " (PREEMPT_RT)" } else { "" })
}

/// True if it is a real-time kernel (`CONFIG_PREEMPT_RT`).
pub fn preempt_rt() -> bool {
    fs::read_to_string("/sys/kernel/realtime").is_ok_and(|is| is.trim() == "1")
}
