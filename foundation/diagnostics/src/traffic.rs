//! Traffic by channel: rate and bandwidth.

use base::{Duration, Instant};
use messages::Channel;
use serde::Serialize;
use std::collections::BTreeMap;

/// Maximum number of channels in the table.
const CHANNELS_MAX: usize = 1000;
/// Number of whole seconds over which rates are averaged.
const SECONDS: usize = 5;
const SECOND: Duration = Duration::from_secs(1);

/// Channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelRow {
    /// Name.
    pub channel: String,
    /// Type of its messages; empty for a channel that is not one of the robot's.
    pub r#type: &'static str,
    /// Number of messages since the model was created.
    pub count: u64,
    /// Messages per second.
    pub rate: f64,
    /// Bytes per second.
    pub bandwidth: f64,
    /// Size of the last message, bytes.
    pub bytes: usize,
    /// Age of the last message, s.
    pub age: f64,
}

#[derive(Clone, Debug, Default)]
struct Count {
    messages: u64,
    bytes: usize,
    last: Instant,
    /// Messages and bytes of the current second and the previous ones.
    seconds: [(u64, u64); SECONDS + 1],
    /// Beginning of the current second.
    began: Instant,
    first: Instant,
}

impl Count {
    fn turn(&mut self, now: Instant) {
        let mut turned = 0;
        while now.since(self.began) >= SECOND && turned <= SECONDS {
            self.seconds.rotate_right(1);
            self.seconds[0] = (0, 0);
            self.began += SECOND;
            turned += 1;
        }
        if now.since(self.began) >= SECOND {
            self.began = now;
        }
    }

    fn rates(&self, now: Instant) -> (f64, f64) {
        let sum = self.seconds.iter().fold((0, 0), |sum, second| (sum.0 + second.0, sum.1 + second.1));
        let covered = SECOND * SECONDS as u32 + now.since(self.began);
        let seconds = covered.min(now.since(self.first)).as_secs_f64().max(SECOND.as_secs_f64());
        (sum.0 as f64 / seconds, sum.1 as f64 / seconds)
    }
}

/// All channels.
#[derive(Clone, Debug, Default)]
pub struct Traffic {
    channels: BTreeMap<String, Count>,
    others: u64,
}

impl Traffic {
    /// Counts a message of `bytes` bytes.
    pub fn count(&mut self, at: Instant, channel: &str, bytes: usize) {
        if !self.channels.contains_key(channel) {
            if self.channels.len() == CHANNELS_MAX {
                self.others += 1;
                return;
            }
            self.channels.insert(channel.into(), Count { first: at, began: at, ..Count::default() });
        }
        let Some(count) = self.channels.get_mut(channel) else { return };
        count.turn(at);
        (count.messages, count.bytes, count.last) = (count.messages + 1, bytes, at);
        count.seconds[0].0 += 1;
        count.seconds[0].1 += bytes as u64;
    }

    /// Channels in order of their names.
    #[must_use]
    pub fn rows(&self, now: Instant) -> Vec<ChannelRow> {
        let row = |(name, count): (&String, &Count)| {
            let mut count = count.clone();
            count.turn(now);
            let (rate, bandwidth) = count.rates(now);
            ChannelRow {
                channel: name.clone(),
                r#type: Channel::from_name(name).map_or("", Channel::type_name),
                count: count.messages,
                rate,
                bandwidth,
                bytes: count.bytes,
                age: now.since(count.last).as_secs_f64(),
            }
        };
        self.channels.iter().map(row).collect()
    }

    /// Number of messages on channels beyond the table.
    #[must_use]
    pub fn others(&self) -> u64 {
        self.others
    }

    /// Reception of the last message.
    #[must_use]
    pub fn last(&self) -> Option<Instant> {
        self.channels.values().map(|count| count.last).max()
    }
}
