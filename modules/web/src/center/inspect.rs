//! Newest message of each channel, and the latest of all; as JSON for watched channels.

use super::recent::Recent;
use axum::extract::ws::Utf8Bytes;
use base::{Duration, Instant, Ticker};
use messages::{Channel, Message};
use serde::Serialize;
use std::collections::BTreeMap;

/// Maximum number of unwatched channels that are kept.
const CHANNELS_MAX: usize = 256;
/// Maximum length of a message that is shown, bytes.
const SHOWN_MAX: usize = 64 << 10;
/// Minimum interval of updates of a watched message; more for a long one.
const UPDATE_PERIOD: Duration = Duration::from_millis(50);
const LONG_MESSAGE: usize = 8 << 10;
const LONG_UPDATE_PERIOD: Duration = Duration::from_millis(500);
/// Watched for the latest messages of all channels.
pub const ALL: &str = "*";
/// Minimum interval of updates of these.
const RECENT_PERIOD: Duration = Duration::from_millis(500);

/// State of all channels.
#[derive(Debug)]
pub struct Inspector {
    /// In step with the parts of the view, so that it causes no extra wake-ups.
    ticker: Ticker,
    channels: BTreeMap<String, Latest>,
    /// The latest messages of all channels: what is received on [`ALL`], which is no channel.
    recent: Recent,
}

/// State of a channel.
#[derive(Debug, Default)]
struct Latest {
    /// Payload; empty if it is too long.
    bytes: Vec<u8>,
    length: usize,
    at: Option<Instant>,
    watchers: u32,
    /// Not sent to the watchers yet.
    news: bool,
    /// Earliest time of the next update of a long message.
    next: Instant,
    /// Last update, and its turn.
    told: Option<(u64, Utf8Bytes)>,
}

/// The newest message of a watched channel, at most 20 Hz.
#[derive(Serialize)]
#[serde(tag = "part", rename = "message")]
struct MessagePart<'a> {
    channel: &'a str,
    r#type: &'static str,
    /// s on a monotonic scale.
    at: f64,
    value: Option<Message>,
    /// Reason for a missing value: the type is unknown, the bytes are malformed, or it is too long.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Default for Inspector {
    fn default() -> Self {
        let ticker = Ticker::new(Instant::ZERO, UPDATE_PERIOD);
        Self { ticker, channels: BTreeMap::new(), recent: Recent::default() }
    }
}

impl Inspector {
    /// Processes a message on a channel.
    pub fn hear(&mut self, at: Instant, channel: &str, bytes: &[u8]) {
        self.recent.hear(at, channel, bytes);
        if !self.channels.contains_key(channel) {
            if self.channels.len() >= CHANNELS_MAX {
                return;
            }
            self.channels.insert(channel.into(), Latest::default());
        }
        let Some(latest) = self.channels.get_mut(channel) else { return };
        latest.bytes.clear();
        if bytes.len() <= SHOWN_MAX {
            latest.bytes.extend_from_slice(bytes);
        }
        (latest.length, latest.at, latest.news) = (bytes.len(), Some(at), true);
    }

    /// Forgets the latest messages: a recorded run goes on elsewhere.
    pub fn forget_recent(&mut self) {
        self.recent.forget();
    }

    /// A viewer begins to watch a channel.
    pub fn watch(&mut self, channel: &str) {
        let latest = self.channels.entry(channel.into()).or_default();
        latest.watchers += 1;
        // The last message is sent to all watchers again.
        latest.news |= latest.at.is_some();
        self.recent.news |= channel == ALL;
    }

    /// A viewer ends watching a channel.
    pub fn leave(&mut self, channel: &str) {
        let Some(latest) = self.channels.get_mut(channel) else { return };
        latest.watchers = latest.watchers.saturating_sub(1);
        if latest.watchers == 0 {
            latest.told = None;
            if latest.at.is_none() || self.channels.len() > CHANNELS_MAX {
                self.channels.remove(channel);
            }
        }
    }

    /// Converts due messages; true if there were any.
    pub fn turn(&mut self, now: Instant, turn: u64) -> bool {
        if !self.is_watched() || !self.ticker.due(now) {
            return false;
        }
        let mut any = false;
        if self.recent.news
            && let Some(latest) = self.channels.get_mut(ALL).filter(|latest| latest.watchers > 0 && latest.next <= now)
        {
            let part = serde_json::to_string(&self.recent.part()).unwrap_or_default();
            (latest.next, latest.told, any) = (now + RECENT_PERIOD, Some((turn, part.into())), true);
        }
        for (channel, latest) in self.channels.iter_mut().filter(|(channel, _)| *channel != ALL) {
            let (true, true, Some(at)) = (latest.watchers > 0 && latest.news, latest.next <= now, latest.at) else {
                continue;
            };
            latest.next = if latest.length > LONG_MESSAGE { now + LONG_UPDATE_PERIOD } else { now };
            (latest.news, any) = (false, true);
            latest.told = Some((turn, json(channel, at, latest).into()));
        }
        any
    }

    /// Deadline of the next turn.
    pub fn due(&self) -> Instant {
        if self.is_watched() { self.ticker.next() } else { Instant::NEVER }
    }

    fn is_watched(&self) -> bool {
        self.channels.values().any(|latest| latest.watchers > 0)
    }

    /// Update of a channel after a turn, if any.
    pub fn told(&self, channel: &str, after: u64) -> Option<Utf8Bytes> {
        let told = self.channels.get(channel)?.told.as_ref();
        told.filter(|(turn, _)| *turn > after).map(|(_, text)| text.clone())
    }
}

fn json(channel: &str, at: Instant, latest: &Latest) -> String {
    let known = Channel::from_name(channel);
    let (value, error) = match Message::receive(channel, &latest.bytes) {
        _ if latest.length > SHOWN_MAX => (None, Some(format!("{} bytes are too many to be shown", latest.length))),
        None => (None, Some("a message of none of the robot's types".into())),
        Some(Err(error)) => (None, Some(error.to_string())),
        Some(Ok(message)) => (Some(message), None),
    };
    let r#type = known.map_or("", Channel::type_name);
    let part = MessagePart { channel, r#type, at: at.as_nanos() as f64 / 1e9, value, error };
    serde_json::to_string(&part).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::DataOdo;
    use serde_json::Value;

    const T0: Instant = Instant::from_millis(1000);

    fn odometry(path: f64) -> Vec<u8> {
        let mut bytes = Vec::new();
        Message::from(DataOdo { path, ..DataOdo::default() }).encode(&mut bytes).unwrap();
        bytes
    }

    fn told(inspector: &Inspector, channel: &str, after: u64) -> Option<Value> {
        inspector.told(channel, after).map(|text| serde_json::from_str(&text).unwrap())
    }

    #[test]
    fn a_watcher_gets_the_newest_message_at_once_at_a_limited_rate() {
        let mut inspector = Inspector::default();
        inspector.hear(T0, "LL_DATA_ODO", &odometry(1.0));
        assert!(!inspector.turn(T0, 1), "no watcher");
        inspector.watch("LL_DATA_ODO");
        assert!(inspector.turn(T0, 2));
        let first = told(&inspector, "LL_DATA_ODO", 1).unwrap();
        assert_eq!((&first["value"]["path"], &first["at"]), (&1.0.into(), &1.0.into()));
        assert_eq!((&first["type"], first.get("error")), (&"lowlevel.data_odo_t".into(), None));
        assert!(told(&inspector, "LL_DATA_ODO", 2).is_none());
        for (n, millis) in [10, 20, 30].into_iter().enumerate() {
            inspector.hear(T0 + Duration::from_millis(millis), "LL_DATA_ODO", &odometry(f64::NAN));
            assert!(!inspector.turn(T0 + Duration::from_millis(millis), 3 + n as u64), "{millis}");
        }
        assert!(inspector.turn(T0 + UPDATE_PERIOD, 9));
        let last = told(&inspector, "LL_DATA_ODO", 2).unwrap();
        assert_eq!((&last["value"]["path"], &last["at"]), (&Value::Null, &1.03.into()), "NaN is null");
        inspector.leave("LL_DATA_ODO");
        inspector.hear(T0 + UPDATE_PERIOD, "LL_DATA_ODO", &odometry(1.0));
        assert!(!inspector.turn(T0 + UPDATE_PERIOD * 9, 10) && inspector.due() == Instant::NEVER);
    }

    #[test]
    fn data_that_cannot_be_shown_has_a_reason() {
        let mut inspector = Inspector::default();
        let cases = [
            ("SOMETHING", vec![1, 2, 3], "none of the robot's types"),
            ("LL_DATA_ODO", vec![1, 2, 3], ""),
            ("LL_DATA_RAW_A", vec![0; SHOWN_MAX + 1], "too many to be shown"),
        ];
        for (turn, (channel, bytes, why)) in cases.into_iter().enumerate() {
            inspector.watch(channel);
            inspector.hear(T0, channel, &bytes);
            assert!(inspector.turn(T0 + UPDATE_PERIOD * turn as u32, turn as u64 + 1));
            let said = told(&inspector, channel, turn as u64).unwrap();
            assert!(said["value"].is_null() && said["error"].as_str().unwrap().contains(why), "{said}");
        }
    }

    #[test]
    fn channels_without_a_watcher_are_bounded() {
        let mut inspector = Inspector::default();
        for n in 0..10_000 {
            inspector.hear(T0, &format!("C{n}"), b"x");
        }
        inspector.watch("LL_DATA_ODO");
        inspector.hear(T0, "LL_DATA_ODO", &odometry(1.0));
        assert!(inspector.turn(T0, 1) && inspector.channels.len() == CHANNELS_MAX + 1);
        inspector.leave("LL_DATA_ODO");
        inspector.watch("NOT_HEARD");
        inspector.leave("NOT_HEARD");
        assert_eq!(inspector.channels.len(), CHANNELS_MAX);
    }
}
