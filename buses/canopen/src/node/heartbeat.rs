//! Heartbeat producer (0x1017) and consumers (0x1016).

use crate::{Dictionary, NmtState};
use alloc::vec::Vec;
use base::{Duration, Instant, Ticker};

#[derive(Default)]
pub(super) struct Producer(Option<Ticker>);

impl Producer {
    pub(super) fn stop(&mut self) {
        self.0 = None;
    }

    /// Every `millis` from now, 0: never. `at_once`: a write starts it at once (CiA 301, 0x1017).
    pub(super) fn configure(&mut self, millis: i64, now: Instant, at_once: bool) {
        let period = Duration::from_millis(millis.unsigned_abs());
        let first = if at_once { now } else { now + period };
        self.0 = (millis > 0).then(|| Ticker::new(first, period));
    }

    pub(super) fn due(&mut self, now: Instant) -> bool {
        self.0.as_mut().is_some_and(|ticker| ticker.due(now))
    }

    pub(super) fn next(&self) -> Option<Instant> {
        self.0.map(|ticker| ticker.next())
    }
}

struct Consumer {
    node: u8,
    limit: Duration,
    watch: Watch,
}

#[derive(Clone, Copy, PartialEq)]
enum Watch {
    /// No heartbeat yet: monitoring starts with the first.
    Unheard,
    Alive {
        until: Instant,
    },
    Lost,
}

#[derive(Default)]
pub(super) struct Consumers(Vec<Consumer>);

impl Consumers {
    pub(super) fn stop(&mut self) {
        self.0.clear();
    }

    /// From 0x1016; entries that did not change go on as they are.
    pub(super) fn configure(&mut self, dictionary: &Dictionary) {
        let mut fresh = Vec::new();
        for sub in 1..=127 {
            let Some(entry) = dictionary.get(0x1016, sub) else {
                break;
            };
            let (node, limit) = ((entry >> 16 & 0x7F) as u8, Duration::from_millis(entry as u64 & 0xFFFF));
            if node == 0 || limit.is_zero() {
                continue;
            }
            let same = self.0.iter().find(|consumer| consumer.node == node && consumer.limit == limit);
            fresh.push(Consumer { node, limit, watch: same.map_or(Watch::Unheard, |consumer| consumer.watch) });
        }
        self.0 = fresh;
    }

    /// A heartbeat of `node`; true when it had been lost. A boot-up message starts nothing.
    pub(super) fn heard(&mut self, now: Instant, node: u8, state: NmtState) -> bool {
        let Some(consumer) = self.0.iter_mut().find(|consumer| consumer.node == node) else {
            return false;
        };
        if state == NmtState::Initialising {
            return false;
        }
        let was = consumer.watch;
        consumer.watch = Watch::Alive { until: now + consumer.limit };
        was == Watch::Lost
    }

    /// A node whose heartbeat is missing.
    pub(super) fn take_lost(&mut self, now: Instant) -> Option<u8> {
        let late = |consumer: &&mut Consumer| matches!(consumer.watch, Watch::Alive { until } if until <= now);
        let consumer = self.0.iter_mut().find(late)?;
        consumer.watch = Watch::Lost;
        Some(consumer.node)
    }

    pub(super) fn next(&self) -> Option<Instant> {
        let until = |consumer: &Consumer| match consumer.watch {
            Watch::Alive { until } => Some(until),
            Watch::Unheard | Watch::Lost => None,
        };
        self.0.iter().filter_map(until).min()
    }
}
