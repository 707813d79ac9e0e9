//! View of a robot: received messages update the model, and several times a second each due part is encoded, once for
//! all viewers. A viewer takes the newest version of each part that it has not seen; versions in between are skipped.
//! Without viewers nothing is encoded.

use super::inspect::Inspector;
use super::parts::{DrivePart, ExtraState, MapPart, SensorsPart, SystemPart};
use axum::extract::ws::Utf8Bytes;
use base::{Duration, Instant, Ticker};
use diagnostics::{Config, Model};
use messages::{Channel, Message};
use serde::Serialize;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// Parts that are updated repeatedly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Drive,
    Sensors,
    Map,
    System,
}

/// Minimum interval of the updates of each part.
const PERIODS: [(Kind, Duration); 4] = [
    (Kind::Drive, Duration::from_millis(100)),
    (Kind::Sensors, Duration::from_millis(200)),
    (Kind::Map, Duration::from_millis(500)),
    (Kind::System, Duration::from_millis(1000)),
];
/// Interval after which an unchanged map is sent again.
const MAP_AGAIN: Duration = Duration::from_secs(5);

/// The model and its viewers.
pub struct ViewPublisher {
    inner: Mutex<Inner>,
    /// Number of the last turn with an update.
    turns: watch::Sender<u64>,
    /// A viewer has joined.
    woken: Notify,
}

struct Inner {
    model: Model,
    inspector: Inspector,
    turn: u64,
    parts: [Part; PERIODS.len()],
    /// Timestamps of the plan and obstacles sent last, and the time of that.
    map: (Stamps, Instant),
}

/// Timestamps of plan and obstacles.
type Stamps = [Option<i64>; 2];

struct Part {
    kind: Kind,
    ticker: Ticker,
    /// Requested by a new viewer.
    wanted: bool,
    /// Last update and its turn.
    said: (u64, Utf8Bytes),
}

/// Progress of one viewer.
pub struct ViewerProgress {
    turn: u64,
    watched: Vec<(String, u64)>,
}

impl ViewPublisher {
    /// Creates the view of a robot without any data.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let part = |(kind, period)| Part {
            kind,
            ticker: Ticker::new(Instant::ZERO, period),
            wanted: false,
            said: (0, Utf8Bytes::from_static("")),
        };
        let inner = Inner {
            model: Model::new(config),
            inspector: Inspector::default(),
            turn: 0,
            parts: PERIODS.map(part),
            map: ([None; 2], Instant::ZERO),
        };
        Self { inner: Mutex::new(inner), turns: watch::Sender::new(0), woken: Notify::new() }
    }

    /// Processes a message on the bus.
    pub fn hear(&self, at: Instant, channel: &str, data: &[u8]) {
        let inner = &mut *self.lock();
        inner.inspector.hear(at, channel, data);
        // Raw frames are only counted: there are many, and no view shows them.
        let message = match Channel::from_name(channel) {
            None | Some(Channel::LlDataRaw) => None,
            Some(_) => Message::receive(channel, data).and_then(Result::ok),
        };
        inner.model.receive(at, channel, data.len(), message);
    }

    /// Encodes due parts with the state at the instant `at` of the model's clock; returns the deadline of the next
    /// turn.
    pub fn turn(&self, now: Instant, at: Instant, beside: ExtraState<'_>) -> Instant {
        if self.viewers() == 0 {
            return Instant::NEVER;
        }
        let inner = &mut *self.lock();
        let turn = inner.turn + 1;
        let mut any = false;
        let Inner { model, parts, map, .. } = inner;
        for part in parts {
            if part.is_due(model, map, now) {
                part.said = (turn, text(part.kind, model, model.at(at), beside).into());
                any = true;
            }
        }
        any |= inner.inspector.turn(now, turn);
        let due = inner.parts.iter().map(|part| part.ticker.next()).fold(inner.inspector.due(), Instant::min);
        if any {
            inner.turn = turn;
            self.turns.send_replace(turn);
        }
        due
    }

    /// Number of viewers.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.turns.receiver_count()
    }

    /// Waits until a viewer joins.
    pub async fn woken(&self) {
        self.woken.notified().await;
    }

    /// Adds a viewer; returns its notification of [updates](Self::news) and its progress. It counts until the former is
    /// dropped, and must [leave](Self::leave) before.
    pub fn join(&self) -> (watch::Receiver<u64>, ViewerProgress) {
        let turns = self.turns.subscribe();
        let mut inner = self.lock();
        inner.parts.iter_mut().for_each(|part| part.wanted = true);
        self.woken.notify_one();
        (turns, ViewerProgress { turn: inner.turn, watched: Vec::new() })
    }

    /// Newest updates that a viewer has not seen.
    pub fn news(&self, progress: &mut ViewerProgress) -> Vec<Utf8Bytes> {
        let inner = self.lock();
        let seen = std::mem::replace(&mut progress.turn, inner.turn);
        let parts = inner.parts.iter().map(|part| &part.said).filter(|(turn, _)| *turn > seen);
        let mut news: Vec<Utf8Bytes> = parts.map(|(_, text)| text.clone()).collect();
        for (channel, seen) in &mut progress.watched {
            let told = inner.inspector.told(channel, *seen);
            *seen = inner.turn;
            news.extend(told);
        }
        news
    }

    /// Replaces the list of channels that a viewer watches.
    pub fn watch(&self, progress: &mut ViewerProgress, channels: Vec<String>) {
        let mut inner = self.lock();
        let turn = inner.turn;
        channels.iter().for_each(|channel| inner.inspector.watch(channel));
        let watched = channels.into_iter().map(|channel| (channel, turn)).collect();
        for (channel, _) in std::mem::replace(&mut progress.watched, watched) {
            inner.inspector.leave(&channel);
        }
        self.woken.notify_one();
    }

    /// Removes a viewer.
    pub fn leave(&self, mut progress: ViewerProgress) {
        self.watch(&mut progress, Vec::new());
    }

    /// Discards the model and the latest messages, but not the viewers.
    pub fn forget(&self, config: Config) {
        let mut inner = self.lock();
        inner.model = Model::new(config);
        inner.inspector.forget_recent();
    }

    /// Reads the model under its lock.
    pub fn look<T>(&self, look: impl FnOnce(&Model) -> T) -> T {
        look(&self.lock().model)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Part {
    /// True if it is due, and marks it as sent. `map`: timestamps of the plan and obstacles sent last, and the time of
    /// that.
    fn is_due(&mut self, model: &Model, map: &mut (Stamps, Instant), now: Instant) -> bool {
        let (due, wanted) = (self.ticker.due(now), std::mem::take(&mut self.wanted));
        if self.kind != Kind::Map {
            return due || wanted;
        }
        let (said, at) = *map;
        let stamps =
            [model.plan.get().map(|plan| plan.timestamp), model.obstacles.get().map(|obstacles| obstacles.timestamp)];
        let news = wanted || due && (stamps != said || now.since(at) >= MAP_AGAIN);
        if news {
            *map = (stamps, now);
        }
        news
    }
}

fn text(kind: Kind, model: &Model, now: Instant, beside: ExtraState<'_>) -> String {
    fn json(part: &impl Serialize) -> String {
        serde_json::to_string(part).unwrap_or_default()
    }
    match kind {
        Kind::Drive => json(&DrivePart::of(model, now, beside)),
        Kind::Sensors => json(&SensorsPart::of(model, now)),
        Kind::Map => json(&MapPart::of(model, now)),
        Kind::System => json(&SystemPart::of(model, now, beside)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::middlelevel::{DataObstacles, DataPlan};
    use serde_json::Value;

    const T0: Instant = Instant::from_millis(100_000);

    fn at(millis: u64) -> Instant {
        T0 + Duration::from_millis(millis)
    }

    fn say(show: &ViewPublisher, now: Instant, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).unwrap();
        show.hear(now, &message.channel_name(), &bytes);
    }

    fn pass(show: &ViewPublisher, now: Instant) -> Instant {
        show.turn(now, now, ExtraState::default())
    }

    fn parts(show: &ViewPublisher, progress: &mut ViewerProgress) -> Vec<String> {
        let part = |text: Utf8Bytes| serde_json::from_str::<Value>(&text).unwrap()["part"].as_str().unwrap().to_owned();
        show.news(progress).into_iter().map(part).collect()
    }

    #[test]
    fn a_new_viewer_gets_all_parts_and_then_each_when_due() {
        let show = ViewPublisher::new(Config::default());
        assert_eq!(pass(&show, T0), Instant::NEVER, "no viewer");
        let (turns, mut progress) = show.join();
        assert_eq!(pass(&show, T0), at(100));
        assert!(turns.has_changed().unwrap());
        assert_eq!(parts(&show, &mut progress), ["drive", "sensors", "map", "system"]);
        assert!(parts(&show, &mut progress).is_empty(), "each once");
        pass(&show, at(50));
        assert!(parts(&show, &mut progress).is_empty(), "nothing is due");
        let mut heard = Vec::new();
        for turn in 1..=10 {
            pass(&show, at(100 * turn));
            heard.extend(parts(&show, &mut progress));
        }
        let count = |name: &str| heard.iter().filter(|part| *part == name).count();
        assert_eq!(["drive", "sensors", "map", "system"].map(count), [10, 5, 0, 1]);
        // A late viewer gets the current state, not the earlier one.
        let (_turns, mut late) = show.join();
        assert!(parts(&show, &mut late).is_empty());
        pass(&show, at(1010));
        assert_eq!(parts(&show, &mut late).len(), 4);
        drop(turns);
        assert_eq!(show.viewers(), 1);
    }

    #[test]
    fn a_slow_viewer_gets_the_newest_parts_and_a_changed_map() {
        let show = ViewPublisher::new(Config::default());
        let (_turns, mut progress) = show.join();
        for turn in 0..100 {
            let plan = DataPlan { timestamp: (turn / 50) as i64, x: vec![f64::NAN], y: vec![1.0] };
            say(&show, at(100 * turn), plan);
            pass(&show, at(100 * turn));
        }
        let news = show.news(&mut progress);
        assert_eq!(news.len(), 4, "the newest of each");
        let map: Value = serde_json::from_str(&news[2]).unwrap();
        assert_eq!((&map["plan"]["value"]["timestamp"], &map["plan"]["value"]["x"][0]), (&1.into(), &Value::Null));
        let mut maps = 0;
        for turn in 100..220 {
            say(&show, at(100 * turn), DataObstacles { timestamp: (turn / 60) as i64, ..DataObstacles::default() });
            pass(&show, at(100 * turn));
            maps += parts(&show, &mut progress).iter().filter(|part| *part == "map").count();
        }
        // Obstacles of turns 100, 120 and 180, and the repetition after 5 s.
        assert!((4..=5).contains(&maps), "{maps}");
    }

    #[test]
    fn watches_end_with_their_viewer() {
        let show = ViewPublisher::new(Config::default());
        let (_turns, mut progress) = show.join();
        show.watch(&mut progress, vec!["STRANGE".into()]);
        pass(&show, T0);
        show.news(&mut progress);
        show.hear(at(10), "STRANGE", b"x");
        assert_eq!(pass(&show, at(50)), at(100));
        assert_eq!(parts(&show, &mut progress), ["message"]);
        show.leave(progress);
        show.hear(at(110), "STRANGE", b"x");
        let (_other, mut progress) = show.join();
        pass(&show, at(150));
        assert_eq!(parts(&show, &mut progress).len(), 4);
    }
}
