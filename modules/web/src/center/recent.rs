//! The latest messages on the bus in order of time, which the diagnostic center of 2011 had beside every view.
//!
//! Most messages are periodic, and hundreds pass in a second. So a line is a *series*: the messages of a channel that
//! follow each other without a pause. A channel of data that goes on for hours is one old line; an event, a command
//! that begins, and data that return after a silence are new ones.

use base::{Duration, Instant};
use messages::Message;
use serde::Serialize;
use serde_json::Value;
use std::cmp::Reverse;
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write;

/// Maximum number of series that are kept after their end, and of lines that are sent.
const ENDED_MAX: usize = 100;
const LINES_MAX: usize = 60;
/// Maximum number of channels with a series that goes on.
const CHANNELS_MAX: usize = 256;
/// Maximum length of a message of which more than its length is shown, bytes.
const SHOWN_MAX: usize = 1024;
/// Maximum length of the words of a line, characters.
const WORDS_MAX: usize = 120;
/// Silence after which the next message begins a new series.
const PAUSE: Duration = Duration::from_secs(1);
/// Likewise of data that are published periodically, and more if their period is longer.
const PAUSE_OF_DATA: Duration = Duration::from_secs(3);
const PERIODS: u32 = 2;

/// The latest messages, at most 2 Hz: the watched channel `*`.
#[derive(Serialize)]
#[serde(tag = "part", rename = "recent")]
pub struct RecentPart {
    /// Time of the newest message, s on a monotonic scale.
    at: f64,
    /// At most 60, by their begin, the latest first.
    recent: Vec<RecentRow>,
}

/// Messages of a channel without a pause.
#[derive(Debug, PartialEq, Serialize)]
struct RecentRow {
    channel: String,
    /// First and last one, s on the scale of the part.
    since: f64,
    until: f64,
    /// Number of messages.
    count: u32,
    /// The last one in a line for people; empty if it is long.
    words: String,
    /// Length of the last one, bytes.
    length: usize,
}

/// The series of all channels.
#[derive(Debug, Default)]
pub struct Recent {
    going_on: BTreeMap<String, Series>,
    ended: VecDeque<(String, Series)>,
    newest: Instant,
    /// A message has arrived since the last part.
    pub news: bool,
}

#[derive(Debug)]
struct Series {
    since: Instant,
    until: Instant,
    count: u32,
    /// Interval between the last two messages.
    interval: Duration,
    /// The last message; empty if it is long.
    bytes: Vec<u8>,
    length: usize,
}

impl Recent {
    /// Processes a message on a channel.
    pub fn hear(&mut self, at: Instant, channel: &str, bytes: &[u8]) {
        (self.newest, self.news) = (at, true);
        let shown = if bytes.len() <= SHOWN_MAX { bytes } else { &[] };
        if let Some(series) = self.going_on.get_mut(channel) {
            let interval = at.since(series.until);
            if interval > series.pause(channel) {
                let begins = Series { count: 0, since: at, bytes: Vec::new(), ..*series };
                let ended = std::mem::replace(series, begins);
                if self.ended.len() == ENDED_MAX {
                    self.ended.pop_front();
                }
                self.ended.push_back((channel.into(), ended));
            }
            (series.until, series.interval, series.length) = (at, interval, bytes.len());
            series.count = series.count.saturating_add(1);
            series.bytes.clear();
            series.bytes.extend_from_slice(shown);
        } else if self.going_on.len() < CHANNELS_MAX {
            let (interval, bytes, length) = (Duration::ZERO, shown.to_vec(), bytes.len());
            let series = Series { since: at, until: at, count: 1, interval, bytes, length };
            self.going_on.insert(channel.into(), series);
        }
    }

    /// Forgets all of them.
    pub fn forget(&mut self) {
        *self = Self { news: true, ..Self::default() };
    }

    /// The part.
    pub fn part(&mut self) -> RecentPart {
        self.news = false;
        let ended = self.ended.iter().map(|(channel, series)| (channel, series));
        let mut all: Vec<_> = self.going_on.iter().chain(ended).collect();
        all.sort_by_key(|(_, series)| Reverse(series.since));
        let recent = all.into_iter().take(LINES_MAX).map(|(channel, series)| series.row(channel)).collect();
        RecentPart { at: seconds(self.newest), recent }
    }
}

impl Series {
    fn pause(&self, channel: &str) -> Duration {
        if channel.contains("_DATA_") { PAUSE_OF_DATA.max(self.interval * PERIODS) } else { PAUSE }
    }

    fn row(&self, channel: &str) -> RecentRow {
        let words = Message::receive(channel, &self.bytes).and_then(Result::ok).map(|message| words(&message));
        let &Self { since, until, count, length, .. } = self;
        let words = words.unwrap_or_default();
        RecentRow { channel: channel.into(), since: seconds(since), until: seconds(until), count, words, length }
    }
}

fn seconds(at: Instant) -> f64 {
    at.as_nanos() as f64 / 1e9
}

/// The fields of a message in a line, without its time.
fn words(message: &Message) -> String {
    let Ok(Value::Object(fields)) = serde_json::to_value(message) else { return String::new() };
    let mut line = String::new();
    for (name, value) in fields.iter().filter(|(name, _)| *name != "timestamp") {
        if line.len() > WORDS_MAX {
            break;
        }
        let comma = if line.is_empty() { "" } else { ", " };
        // Writing to a string does not fail.
        let _ = match value {
            Value::Null => write!(line, "{comma}{name} –"),
            Value::Number(number) => write!(line, "{comma}{name} {}", figure(number)),
            Value::String(text) => write!(line, "{comma}{name} {text}"),
            Value::Array(list) => write!(line, "{comma}{name} [{}]", list.len()),
            Value::Object(_) => write!(line, "{comma}{name} {{…}}"),
            Value::Bool(is) => write!(line, "{comma}{name} {is}"),
        };
    }
    if line.chars().count() > WORDS_MAX {
        line = line.chars().take(WORDS_MAX - 1).chain(['…']).collect();
    }
    line
}

/// A whole number as it is, another with three decimals.
fn figure(number: &serde_json::Number) -> String {
    match number.as_f64() {
        Some(float) if number.is_f64() => format!("{float:.3}"),
        _ => number.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{CmdMotion, DataOdo, EventStop};

    fn at(millis: u64) -> Instant {
        Instant::from_millis(100_000 + millis)
    }

    fn say(recent: &mut Recent, millis: u64, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).unwrap();
        recent.hear(at(millis), &message.channel_name(), &bytes);
    }

    fn lines(recent: &mut Recent) -> Vec<(String, f64, u32)> {
        let rows = recent.part().recent.into_iter();
        rows.map(|row| (row.channel, row.since - 100.0, row.count)).collect()
    }

    #[test]
    fn what_goes_on_is_one_line_and_what_begins_is_a_new_one() {
        let mut recent = Recent::default();
        for n in 0..200 {
            say(&mut recent, 50 * n, DataOdo::default());
            if n == 100 {
                say(&mut recent, 50 * n, EventStop { engaged: true, source: "bumper".into(), ..EventStop::default() });
            }
        }
        (0..20).for_each(|n| say(&mut recent, 8000 + 50 * n, CmdMotion::default()));
        say(&mut recent, 9500, EventStop::default());
        let line = |channel: &str, since, count| (channel.to_owned(), since, count);
        let wanted = [
            line("LL_EVENT_STOP", 9.5, 1),
            line("LL_CMD_MOTION", 8.0, 20),
            line("LL_EVENT_STOP", 5.0, 1),
            line("LL_DATA_ODO", 0.0, 200),
        ];
        assert_eq!(lines(&mut recent), wanted);
        // They were silent, and begin anew.
        say(&mut recent, 13_000, DataOdo::default());
        say(&mut recent, 13_500, CmdMotion::default());
        let all = lines(&mut recent);
        assert_eq!(all[..2], [line("LL_CMD_MOTION", 13.5, 1), line("LL_DATA_ODO", 13.0, 1)]);
        assert_eq!(all.len(), 6);
        // A recorded run goes on from an earlier place.
        recent.forget();
        say(&mut recent, 2000, DataOdo::default());
        assert_eq!(lines(&mut recent), [line("LL_DATA_ODO", 2.0, 1)]);
    }

    #[test]
    fn rare_data_are_one_line_from_their_second_message_on() {
        let mut recent = Recent::default();
        (0..5).for_each(|n| say(&mut recent, 10_000 * n, DataOdo::default()));
        assert_eq!(lines(&mut recent).iter().map(|line| line.2).collect::<Vec<_>>(), [4, 1]);
    }

    #[test]
    fn a_line_says_what_the_last_message_says() {
        let mut recent = Recent::default();
        let source = "x".repeat(200);
        say(&mut recent, 0, CmdMotion { timestamp: 7, speed: 0.4, steering: f64::NAN, priority: 2, source });
        recent.hear(at(1), "LL_DATA_RAW_A", &[0; SHOWN_MAX + 1]);
        recent.hear(at(2), "STRANGE", b"abc");
        let rows = recent.part().recent;
        assert_eq!((rows[0].words.as_str(), rows[0].length), ("", 3));
        assert_eq!((rows[1].words.as_str(), rows[1].length), ("", SHOWN_MAX + 1));
        let words = &rows[2].words;
        assert!(words.starts_with("priority 2, source xxx") || words.starts_with("speed 0.400"), "{words}");
        assert!(words.ends_with('…') && words.chars().count() == WORDS_MAX, "{words}");
    }

    #[test]
    fn a_flood_of_channels_and_series_is_bounded() {
        let mut recent = Recent::default();
        for n in 0..10_000 {
            recent.hear(at(2000 * n), &format!("C{}", n % 500), b"x");
        }
        assert_eq!((recent.going_on.len(), recent.ended.len()), (CHANNELS_MAX, ENDED_MAX));
        assert_eq!(recent.part().recent.len(), LINES_MAX);
    }
}
