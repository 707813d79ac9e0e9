//! Patterns: what an output does from the moment on at which a situation begins.

use base::Duration;
use std::fmt;

/// No part of a pattern is shorter than this, s: devices on a line and relays must be able to follow.
const PART_MIN_S: f64 = 0.05;
/// No part of a pattern is longer, s.
const PART_MAX_S: f64 = 60.0;
/// Pulses of a pattern at most.
const PULSES_MAX: u8 = 20;

/// What an output does while an entry applies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// On.
    On,
    /// Off: entries below do not apply.
    Off,
    /// On and off in turn.
    Blink {
        /// Frequency, Hz.
        hz: f64,
        /// Share of the time for which it is on, 0 to 1.
        duty: f64,
    },
    /// Groups of pulses.
    Pulses {
        /// Pulses of a group.
        count: u8,
        /// Length of a pulse, s.
        on_s: f64,
        /// Pause between two pulses of a group, s.
        off_s: f64,
        /// Pause between two groups, s.
        rest_s: f64,
    },
    /// One group of pulses when the situation begins, then off.
    Beep {
        /// Pulses.
        count: u8,
        /// Length of a pulse, s.
        on_s: f64,
        /// Pause between two pulses, s.
        off_s: f64,
    },
}

impl Pattern {
    /// What [`Pattern::parse`] accepts, for people.
    pub const EXPECTED: &'static str = "\"on\", \"off\", \"blink HZ [DUTY]\", \"pulses N ON_S OFF_S REST_S\" or \
                                        \"beep N ON_S OFF_S\", N from 1 to 20, no part shorter than 0.05 s or longer \
                                        than 60 s";

    /// Reads the value of the key `pattern`; `None` if it is no pattern, or one with a part that is out of its range.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut words = text.split_whitespace();
        let kind = words.next()?;
        let numbers: Vec<f64> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
        let count = |number: f64| {
            let count = number as u8;
            (f64::from(count) == number && (1..=PULSES_MAX).contains(&count)).then_some(count)
        };
        let pattern = match (kind, &numbers[..]) {
            ("on", []) => Self::On,
            ("off", []) => Self::Off,
            ("blink", [hz]) => Self::Blink { hz: *hz, duty: 0.5 },
            ("blink", [hz, duty]) => Self::Blink { hz: *hz, duty: *duty },
            ("pulses", [number, on_s, off_s, rest_s]) => {
                Self::Pulses { count: count(*number)?, on_s: *on_s, off_s: *off_s, rest_s: *rest_s }
            }
            ("beep", [number, on_s, off_s]) => Self::Beep { count: count(*number)?, on_s: *on_s, off_s: *off_s },
            _ => return None,
        };
        let fits = |part: &f64| (PART_MIN_S..=PART_MAX_S).contains(part);
        pattern.parts().iter().all(fits).then_some(pattern)
    }

    /// Its parts, s: what is on, what is off, and the pause after a group.
    fn parts(self) -> Vec<f64> {
        match self {
            Self::On | Self::Off => Vec::new(),
            Self::Blink { hz, duty } => vec![duty / hz, (1.0 - duty) / hz],
            Self::Pulses { on_s, off_s, rest_s, .. } => vec![on_s, off_s, rest_s],
            Self::Beep { on_s, off_s, .. } => vec![on_s, off_s],
        }
    }

    /// True if the output changes while the pattern lasts.
    #[must_use]
    pub fn changes(self) -> bool {
        !matches!(self, Self::On | Self::Off)
    }

    /// True if the output is on at `since` after the pattern's begin; and when it changes next, from the begin on.
    #[must_use]
    pub fn at(self, since: Duration) -> (bool, Option<Duration>) {
        // Saturates; what `parse` has not checked must neither overflow nor stand still.
        let nanos = |seconds: f64| (seconds * 1e9) as u64;
        let (count, on, off, rest) = match self {
            Self::On => return (true, None),
            Self::Off => return (false, None),
            Self::Blink { hz, duty } => (1, nanos(duty / hz), 0, Some(nanos((1.0 - duty) / hz))),
            Self::Pulses { count, on_s, off_s, rest_s } => (count, nanos(on_s), nanos(off_s), Some(nanos(rest_s))),
            Self::Beep { count, on_s, off_s } => (count, nanos(on_s), nanos(off_s), None),
        };
        let (on, rest) = (on.max(1), rest.map(|rest| rest.max(1)));
        let step = on.saturating_add(off);
        // The last pulse has no pause of its own.
        let group = step.saturating_mul(count.max(1).into()).saturating_sub(off);
        let since = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        let period = rest.map(|rest| group.saturating_add(rest));
        let begin = period.map_or(0, |period| since - since % period);
        let within = since - begin;
        let edge = |offset: u64| Some(Duration::from_nanos(begin.saturating_add(offset)));
        if within >= group {
            return (false, period.and_then(edge));
        }
        let pulse = within - within % step;
        if within - pulse < on {
            (true, edge(pulse.saturating_add(on)))
        } else {
            (false, edge(pulse.saturating_add(step)))
        }
    }
}

/// As it is read.
impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::On => f.write_str("on"),
            Self::Off => f.write_str("off"),
            Self::Blink { hz, duty } => write!(f, "blink {hz} {duty}"),
            Self::Pulses { count, on_s, off_s, rest_s } => write!(f, "pulses {count} {on_s} {off_s} {rest_s}"),
            Self::Beep { count, on_s, off_s } => write!(f, "beep {count} {on_s} {off_s}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges of the first seconds: when, ms, and what the output is from then on.
    fn edges(text: &str, until_ms: u64) -> Vec<(u64, bool)> {
        let pattern = Pattern::parse(text).unwrap();
        let (mut edges, mut at) = (Vec::new(), Duration::ZERO);
        loop {
            let (on, next) = pattern.at(at);
            edges.push((at.as_millis() as u64, on));
            match next.filter(|next| next.as_millis() as u64 <= until_ms) {
                Some(next) => {
                    assert!(next > at, "{text}: it goes on");
                    assert_eq!(pattern.at(next - Duration::from_nanos(1)).0, on, "{text}: {at:?}");
                    at = next;
                }
                None => return edges,
            }
        }
    }

    #[test]
    fn patterns_change_when_they_should() {
        assert_eq!(edges("on", 9000), [(0, true)]);
        assert_eq!(edges("off", 9000), [(0, false)]);
        let blink = [(0, true), (250, false), (500, true), (750, false), (1000, true)];
        assert_eq!(edges("blink 2", 1000), blink);
        assert_eq!(edges("blink 1 0.1", 1100), [(0, true), (100, false), (1000, true), (1100, false)]);
        let pulses = [(0, true), (100, false), (300, true), (400, false), (1400, true), (1500, false), (1700, true)];
        assert_eq!(edges("pulses 2 0.1 0.2 1", 1700), pulses);
        assert_eq!(edges("beep 2 0.1 0.2", 60_000), [(0, true), (100, false), (300, true), (400, false)]);
    }

    #[test]
    fn what_is_read_is_written_and_all_else_is_refused() {
        for text in ["on", "off", "blink 1.5 0.5", "pulses 3 0.1 0.2 1", "beep 1 0.25 0.5"] {
            assert_eq!(Pattern::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Pattern::parse("blink 1.5"), Pattern::parse(" blink  1.5 0.5"));
        let bad = [
            "",
            "On",
            "on 1",
            "off 0",
            "blink",
            "blink 0",
            "blink -1",
            "blink nan",
            "blink inf",
            "blink 20",
            "blink 1 0",
            "blink 1 1",
            "blink 1 0.01",
            "blink 1 0.5 2",
            "pulses 2 0.1 0.2",
            "pulses 0 0.1 0.2 1",
            "pulses 21 0.1 0.2 1",
            "pulses 1.5 0.1 0.2 1",
            "pulses 2 0.01 0.2 1",
            "pulses 2 0.1 0.2 61",
            "beep 2 0.1",
            "beep -1 0.1 0.1",
            "beep nan 0.1 0.1",
            "blink 1,5",
            "honk 1",
        ];
        for text in bad {
            assert_eq!(Pattern::parse(text), None, "{text}");
        }
    }

    #[test]
    fn a_pattern_that_was_not_read_hangs_nothing() {
        let odd = [
            Pattern::Blink { hz: f64::NAN, duty: 7.0 },
            Pattern::Blink { hz: 0.0, duty: 0.0 },
            Pattern::Pulses { count: 0, on_s: -1.0, off_s: f64::INFINITY, rest_s: 0.0 },
            Pattern::Beep { count: 255, on_s: 1e300, off_s: 1e300 },
        ];
        for pattern in odd {
            for since in [Duration::ZERO, Duration::from_secs(1), Duration::MAX] {
                let (_, next) = pattern.at(since);
                let soon = Duration::from_nanos(u64::MAX);
                assert!(next.is_none_or(|next| next > since.min(soon) || next == soon), "{pattern:?} {since:?}");
            }
        }
    }
}
