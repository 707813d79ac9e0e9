//! Orders for the channels: what is asked for, what was told, what has come of it. The board itself keeps the order in
//! which several start or stop, and the time between them.

use base::{Duration, Instant};
use rs485::boards::psc1::CHANNELS;

/// The board switches one channel a second at most; then it has had time enough.
const PATIENCE: Duration = Duration::from_secs(CHANNELS.len() as u64 + 3);
/// A channel that is restarted rests this long.
const REST: Duration = Duration::from_secs(2);

/// What becomes of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// It shall be so, and be on again afterwards; once told, until when it may take.
    Set { on: bool, again: bool, told: Option<Instant> },
    /// It is off, and is started then.
    Rests { until: Instant },
}

/// What came of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The channel is as it was ordered.
    Done { channel: usize, on: bool },
    /// The board did not switch it.
    Stuck { channel: usize, on: bool },
}

/// The channels.
#[derive(Debug, Default)]
pub(super) struct Channels {
    /// Which are on, as the board said last.
    state: Option<u8>,
    orders: [Option<Order>; CHANNELS.len()],
}

impl Channels {
    pub fn state(&self) -> Option<u8> {
        self.state
    }

    /// Orders a channel on or off; `again`: off, and on again.
    pub fn order(&mut self, channel: usize, on: bool, again: bool) {
        if let Some(order) = self.orders.get_mut(channel) {
            *order = Some(Order::Set { on, again, told: None });
        }
    }

    /// Forgets all orders.
    pub fn forget(&mut self) {
        self.orders = Default::default();
    }

    /// What the board is to be told: the channels, and their states.
    pub fn telling(&self) -> Option<(u8, u8)> {
        let (mut mask, mut states) = (0, 0);
        for (channel, order) in self.orders.iter().enumerate() {
            if let Some(Order::Set { on, told: None, .. }) = order {
                mask |= 1 << channel;
                states |= u8::from(*on) << channel;
            }
        }
        (mask != 0).then_some((mask, states))
    }

    /// The board was told this, and means to.
    pub fn told(&mut self, now: Instant, mask: u8, states: u8) {
        for (channel, order) in self.orders.iter_mut().enumerate() {
            if let Some(Order::Set { on, told: told @ None, .. }) = order
                && mask >> channel & 1 == 1
                && states >> channel & 1 == u8::from(*on)
            {
                *told = Some(now + PATIENCE);
            }
        }
    }

    /// The board says which channels are on.
    pub fn on_state(&mut self, now: Instant, state: u8) -> Vec<Outcome> {
        self.state = Some(state);
        let mut outcomes = Vec::new();
        for (channel, order) in self.orders.iter_mut().enumerate() {
            let is = state >> channel & 1 == 1;
            if let Some(Order::Set { on, again, told: Some(until) }) = *order {
                if is == on {
                    outcomes.push(Outcome::Done { channel, on });
                    *order = again.then(|| Order::Rests { until: now + REST });
                } else if until <= now {
                    outcomes.push(Outcome::Stuck { channel, on });
                    *order = None;
                }
            }
        }
        outcomes
    }

    /// Lets those start again that have rested; true when there is something to tell.
    pub fn on_timer(&mut self, now: Instant) -> bool {
        let mut rested = false;
        for order in &mut self.orders {
            if matches!(order, Some(Order::Rests { until }) if *until <= now) {
                *order = Some(Order::Set { on: true, again: false, told: None });
                rested = true;
            }
        }
        rested
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let rests = |order: &Option<Order>| if let Some(Order::Rests { until }) = order { Some(*until) } else { None };
        self.orders.iter().filter_map(rests).min()
    }
}
