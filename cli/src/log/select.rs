//! Which messages of a log: by channel and by time.

use super::source::Log;
use crate::Failed;
use lcm::subscription::Pattern;
use logger::run_name;

/// Selection of messages.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Select {
    /// Channels, by a regular expression that must match the whole name; may be given often
    #[arg(long = "channel", short = 'c', value_name = "PATTERN")]
    channels: Vec<String>,
    /// From this time, s after the log's start, or @ s since 1970
    #[arg(long = "from", alias = "start", value_name = "S", value_parser = when)]
    start: Option<When>,
    /// Up to then
    #[arg(long = "to", alias = "end", value_name = "S", value_parser = when)]
    end: Option<When>,
}

/// A moment of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    /// ns after the log's start.
    After(u64),
    /// ns since 1970.
    At(u64),
}

fn when(text: &str) -> Result<When, String> {
    let (digits, absolute) = text.strip_prefix('@').map_or((text, false), |digits| (digits, true));
    let seconds: f64 = digits.parse().map_err(|_| "expected seconds, or @ and seconds since 1970".to_string())?;
    if !(0.0..=1e10).contains(&seconds) {
        return Err("expected seconds from 0".into());
    }
    // Whole seconds apart: ns since 1970 are more than a float can hold.
    let ns = seconds.trunc() as u64 * 1_000_000_000 + (seconds.fract() * 1e9).round() as u64;
    Ok(if absolute { When::At(ns) } else { When::After(ns) })
}

/// Parsed selection.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Log times, both inclusive, ns since 1970.
    pub from: u64,
    pub to: u64,
    /// Channels; none: all.
    pub patterns: Vec<Pattern>,
    /// Beside messages of LCM those of other encodings too.
    pub all_forms: bool,
    /// `/NAME` is wanted where NAME is.
    pub with_twins: bool,
}

impl Selection {
    /// Selects all messages.
    pub fn all() -> Self {
        Self { from: 0, to: u64::MAX, patterns: Vec::new(), all_forms: true, with_twins: false }
    }

    /// Selection for a log. Where a log has messages of LCM the other encodings repeat them, and are selected only by a
    /// pattern with a slash.
    pub fn of(select: &Select, log: &Log) -> Result<Self, Failed> {
        let patterns = select.channels.iter().map(|pattern| Pattern::new(pattern));
        let patterns = patterns.collect::<Result<Vec<_>, _>>().map_err(|error| Failed::from(error.to_string()))?;
        let begin = log.span().map_or(0, |(start, _)| start);
        let ns = |when| match when {
            When::After(ns) => begin.saturating_add(ns),
            When::At(ns) => ns,
        };
        let (from, to) = (select.start.map_or(0, ns), select.end.map_or(u64::MAX, ns));
        if from > to {
            return Err("--from is after --to".into());
        }
        let all_forms = !log.has_lcm() || select.channels.iter().any(|pattern| pattern.starts_with('/'));
        Ok(Self { from, to, patterns, all_forms, with_twins: false })
    }

    /// Selects every form of each message.
    pub fn with_twins(self) -> Self {
        Self { all_forms: true, with_twins: true, ..self }
    }

    pub fn wants(&self, channel: &str, encoding: &str) -> bool {
        let twin = channel.strip_prefix('/').filter(|_| self.with_twins);
        (self.all_forms || encoding == "lcm")
            && (self.patterns.is_empty()
                || self
                    .patterns
                    .iter()
                    .any(|pattern| pattern.matches(channel) || twin.is_some_and(|twin| pattern.matches(twin))))
    }
}

/// UTC, to the microsecond: `2026-11-22 09:29:31.123456`.
pub fn date(ns: u64) -> String {
    let name = run_name(ns / 1_000_000_000);
    let parts: Vec<&str> = name.split('_').collect();
    format!("{} {}.{:06}", parts[..3].join("-"), parts[3..].join(":"), ns / 1000 % 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_counted_from_the_start_or_from_1970() {
        assert_eq!(when("1.5"), Ok(When::After(1_500_000_000)));
        assert_eq!(when("@1795302110.25"), Ok(When::At(1_795_302_110_250_000_000)));
        for wrong in ["", "@", "-1", "nan", "inf", "1e11", "x"] {
            assert!(when(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_date_is_read_by_people() {
        assert_eq!(date(951_782_400_123_456_789), "2000-02-29 00:00:00.123456");
        assert!(!date(u64::MAX).is_empty());
    }
}
