//! A robot as it is looked at: what is heard goes into the model, and some times a second each part that is due is put
//! into words, once for all viewers. A viewer takes the newest of what it has not seen; what was newer meanwhile it
//! never hears of. Nobody looks: nothing is put into words.

use super::inspect::Inspector;
use super::parts::{Drive, ExtraState, Map, Sensors, System};
use axum::extract::ws::Utf8Bytes;
use base::{Duration, Instant, Ticker};
use diagnostics::{Config, Model};
use messages::{Channel, Message};
use serde::Serialize;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// The parts that are said again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Drive,
    Sensors,
    Map,
    System,
}

/// How often at most.
const PERIODS: [(Kind, Duration); 4] = [
    (Kind::Drive, Duration::from_millis(100)),
    (Kind::Sensors, Duration::from_millis(200)),
    (Kind::Map, Duration::from_millis(500)),
    (Kind::System, Duration::from_millis(1000)),
];
/// A map that does not change is said again after so long.
const MAP_AGAIN: Duration = Duration::from_secs(5);

/// The robot, and who looks at it.
pub struct ViewPublisher {
    inner: Mutex<Inner>,
    /// The number of the last turn in which something was said.
    turns: watch::Sender<u64>,
    /// Somebody has come.
    woken: Notify,
}

struct Inner {
    model: Model,
    inspector: Inspector,
    turn: u64,
    parts: [Part; PERIODS.len()],
    /// When plan and obstacles were made that were said last, and when that was.
    map: (Stamps, Instant),
}

/// Timestamps of plan and obstacles.
type Stamps = [Option<i64>; 2];

struct Part {
    kind: Kind,
    ticker: Ticker,
    /// Somebody has come who has none.
    wanted: bool,
    /// In which turn it was said, and what.
    said: (u64, Utf8Bytes),
}

/// What a viewer has seen: a viewer's own.
pub struct Place {
    turn: u64,
    watched: Vec<(String, u64)>,
}

impl ViewPublisher {
    /// One of which nothing is known yet.
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

    /// Something was said on the bus.
    pub fn hear(&self, at: Instant, channel: &str, data: &[u8]) {
        let inner = &mut *self.lock();
        inner.inspector.hear(at, channel, data);
        // What a wire carried is counted; there is much of it, and no view has it.
        let message = match Channel::from_name(channel) {
            None | Some(Channel::LlDataRaw) => None,
            Some(_) => Message::receive(channel, data).and_then(Result::ok),
        };
        inner.model.hear(at, channel, data.len(), message);
    }

    /// Says what is due; when the next turn is wanted.
    pub fn turn(&self, now: Instant, beside: ExtraState<'_>) -> Instant {
        if self.viewers() == 0 {
            return Instant::NEVER;
        }
        let inner = &mut *self.lock();
        let turn = inner.turn + 1;
        let mut any = false;
        let Inner { model, parts, map, .. } = inner;
        for part in parts {
            if part.is_due(model, map, now) {
                part.said = (turn, text(part.kind, model, now, beside).into());
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

    /// How many look.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.turns.receiver_count()
    }

    /// Waits until somebody has come.
    pub async fn woken(&self) {
        self.woken.notified().await;
    }

    /// Somebody comes: what tells it that there is something to [take](Self::news), and what it has seen: nothing. It
    /// is there until the former is dropped, and [leaves](Self::leave) before.
    pub fn join(&self) -> (watch::Receiver<u64>, Place) {
        let turns = self.turns.subscribe();
        let mut inner = self.lock();
        inner.parts.iter_mut().for_each(|part| part.wanted = true);
        self.woken.notify_one();
        (turns, Place { turn: inner.turn, watched: Vec::new() })
    }

    /// The newest of what a viewer has not seen.
    pub fn news(&self, place: &mut Place) -> Vec<Utf8Bytes> {
        let inner = self.lock();
        let seen = std::mem::replace(&mut place.turn, inner.turn);
        let parts = inner.parts.iter().map(|part| &part.said).filter(|(turn, _)| *turn > seen);
        let mut news: Vec<Utf8Bytes> = parts.map(|(_, text)| text.clone()).collect();
        for (channel, seen) in &mut place.watched {
            let told = inner.inspector.told(channel, *seen);
            *seen = inner.turn;
            news.extend(told);
        }
        news
    }

    /// A viewer watches these channels from now on, and no others.
    pub fn watch(&self, place: &mut Place, channels: Vec<String>) {
        let mut inner = self.lock();
        let turn = inner.turn;
        channels.iter().for_each(|channel| inner.inspector.watch(channel));
        let watched = channels.into_iter().map(|channel| (channel, turn)).collect();
        for (channel, _) in std::mem::replace(&mut place.watched, watched) {
            inner.inspector.leave(&channel);
        }
        self.woken.notify_one();
    }

    /// A viewer goes.
    pub fn leave(&self, mut place: Place) {
        self.watch(&mut place, Vec::new());
    }

    /// Forgets what was heard, not who looks.
    pub fn forget(&self, config: Config) {
        self.lock().model = Model::new(config);
    }

    /// Looks at the model, for a moment.
    pub fn look<T>(&self, look: impl FnOnce(&Model) -> T) -> T {
        look(&self.lock().model)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Part {
    /// True if it is to be said now; it counts as said then. `map`: when plan and obstacles were made that were said
    /// last, and when that was.
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
        Kind::Drive => json(&Drive::of(model, now, beside)),
        Kind::Sensors => json(&Sensors::of(model, now)),
        Kind::Map => json(&Map::of(model, now)),
        Kind::System => json(&System::of(model, now, beside)),
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

    fn parts(show: &ViewPublisher, place: &mut Place) -> Vec<String> {
        let part = |text: Utf8Bytes| serde_json::from_str::<Value>(&text).unwrap()["part"].as_str().unwrap().to_owned();
        show.news(place).into_iter().map(part).collect()
    }

    #[test]
    fn a_new_viewer_gets_all_parts_and_then_each_when_due() {
        let show = ViewPublisher::new(Config::default());
        assert_eq!(show.turn(T0, ExtraState::default()), Instant::NEVER, "no viewer");
        let (turns, mut place) = show.join();
        assert_eq!(show.turn(T0, ExtraState::default()), at(100));
        assert!(turns.has_changed().unwrap());
        assert_eq!(parts(&show, &mut place), ["drive", "sensors", "map", "system"]);
        assert!(parts(&show, &mut place).is_empty(), "each once");
        show.turn(at(50), ExtraState::default());
        assert!(parts(&show, &mut place).is_empty(), "nothing is due");
        let mut heard = Vec::new();
        for turn in 1..=10 {
            show.turn(at(100 * turn), ExtraState::default());
            heard.extend(parts(&show, &mut place));
        }
        let count = |name: &str| heard.iter().filter(|part| *part == name).count();
        assert_eq!(["drive", "sensors", "map", "system"].map(count), [10, 5, 0, 1]);
        // Who comes later gets what is true then, not what was said before.
        let (_turns, mut late) = show.join();
        assert!(parts(&show, &mut late).is_empty());
        show.turn(at(1010), ExtraState::default());
        assert_eq!(parts(&show, &mut late).len(), 4);
        drop(turns);
        assert_eq!(show.viewers(), 1);
    }

    #[test]
    fn a_slow_viewer_gets_the_newest_parts_and_a_changed_map() {
        let show = ViewPublisher::new(Config::default());
        let (_turns, mut place) = show.join();
        for turn in 0..100 {
            let plan = DataPlan { timestamp: (turn / 50) as i64, x: vec![f64::NAN], y: vec![1.0] };
            say(&show, at(100 * turn), plan);
            show.turn(at(100 * turn), ExtraState::default());
        }
        let news = show.news(&mut place);
        assert_eq!(news.len(), 4, "the newest of each");
        let map: Value = serde_json::from_str(&news[2]).unwrap();
        assert_eq!((&map["plan"]["value"]["timestamp"], &map["plan"]["value"]["x"][0]), (&1.into(), &Value::Null));
        let mut maps = 0;
        for turn in 100..220 {
            say(&show, at(100 * turn), DataObstacles { timestamp: (turn / 60) as i64, ..DataObstacles::default() });
            show.turn(at(100 * turn), ExtraState::default());
            maps += parts(&show, &mut place).iter().filter(|part| *part == "map").count();
        }
        // Obstacles of turns 100, 120 and 180, and what is said again after 5 s.
        assert!((4..=5).contains(&maps), "{maps}");
    }

    #[test]
    fn watches_end_with_their_viewer() {
        let show = ViewPublisher::new(Config::default());
        let (_turns, mut place) = show.join();
        show.watch(&mut place, vec!["STRANGE".into()]);
        show.turn(T0, ExtraState::default());
        show.news(&mut place);
        show.hear(at(10), "STRANGE", b"x");
        assert_eq!(show.turn(at(50), ExtraState::default()), at(100));
        assert_eq!(parts(&show, &mut place), ["message"]);
        show.leave(place);
        show.hear(at(110), "STRANGE", b"x");
        let (_other, mut place) = show.join();
        show.turn(at(150), ExtraState::default());
        assert_eq!(parts(&show, &mut place).len(), 4);
    }
}
