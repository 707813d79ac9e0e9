//! Lines for people on stderr: `HH:MM:SS.mmm module SEVERITY name subject: message`, in UTC.

use super::clock;
use base::{Level, Report, Severity};
use std::fmt::{self, Display, Write as _};
use std::io::Write;

/// Printer of one module's lines.
#[derive(Clone, Debug)]
pub struct Log {
    module: String,
}

impl Log {
    /// Creates the printer of a module.
    #[must_use]
    pub fn new(module: &str) -> Self {
        Self { module: module.into() }
    }

    /// Prints a report; `place`: with the place in the source where it was made.
    pub fn report(&self, report: &Report, place: bool) {
        self.line(format_args!("{}", ReportLine { report, place }));
    }

    /// Prints a line with its level; INFO has no prefix.
    pub fn text(&self, level: Level, text: impl Display) {
        match level {
            Level::Info => self.line(text),
            other => self.line(format_args!("{} {text}", other.name())),
        }
    }

    /// Prints a line of any kind.
    pub fn line(&self, text: impl Display) {
        let time = TimeOfDay(clock::wall());
        // One write per line, so that lines of several processes do not mix. Without stderr nothing can be reported.
        let line = format!("{time} {} {text}\n", self.module);
        let _ = std::io::stderr().write_all(line.as_bytes());
    }
}

struct ReportLine<'a> {
    report: &'a Report,
    place: bool,
}

impl Display for ReportLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = self.report;
        let severity = match report.severity {
            Severity::Notice => "NOTICE",
            Severity::Warning => "WARNING",
            Severity::Error => "ERROR",
        };
        write!(f, "{severity} {}", report.fault.name())?;
        if !report.subject.is_empty() {
            write!(f, " {}", report.subject)?;
        }
        write!(f, ": {}", OneLine(&report.message))?;
        if report.fatal {
            f.write_str(" (fatal: the module ends)")?;
        }
        if self.place {
            write!(f, " ({}:{})", report.location.file, report.location.line)?;
        }
        Ok(())
    }
}

/// Displays a text on one line: control characters become spaces.
pub struct OneLine<'a>(pub &'a str);

impl Display for OneLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|c| f.write_char(if c.is_control() { ' ' } else { c }))
    }
}

/// Nanoseconds since the UNIX epoch, displayed as the time of day.
pub struct TimeOfDay(pub u64);

impl Display for TimeOfDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = self.0 / 1_000_000 % 86_400_000;
        let (s, m, h) = (ms / 1000 % 60, ms / 60_000 % 60, ms / 3_600_000);
        write!(f, "{h:02}:{m:02}:{s:02}.{:03}", ms % 1000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Fault;

    #[test]
    fn a_report_is_one_line_that_names_what_it_is_about() {
        let report = Report::new(Severity::Warning, Fault::BoardLost, "sd1_front", "no answer\nfor 2 s");
        let line = |report: &Report, place| ReportLine { report, place }.to_string();
        assert_eq!(line(&report, false), "WARNING BoardLost sd1_front: no answer for 2 s");
        let here = format!(" ({}:{})", report.location.file, report.location.line);
        assert!(here.contains("log.rs:") && line(&report, true).ends_with(&here), "{}", line(&report, true));
        let report = Report::new(Severity::Error, Fault::WatchdogSilent, "", "it stops");
        assert_eq!(line(&report, false), "ERROR WatchdogSilent: it stops");
        assert_eq!(line(&report.fatal(), false), "ERROR WatchdogSilent: it stops (fatal: the module ends)");
    }

    #[test]
    fn the_time_of_the_day_has_milliseconds() {
        assert_eq!(TimeOfDay(86_400_000_000_000 + 45_296_789_999_999).to_string(), "12:34:56.789");
    }
}
