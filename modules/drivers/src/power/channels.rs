//! Orders for the channels: requested, sent, completed. The board itself staggers the switching of several channels.

use base::{Duration, Instant};
use rs485::boards::psc1::CHANNELS;

/// The board switches at most one channel a second; after this time it should have finished.
const SWITCH_TIMEOUT: Duration = Duration::from_secs(CHANNELS.len() as u64 + 3);
/// Off time of a channel that is restarted.
const RESTART_PAUSE: Duration = Duration::from_secs(2);

/// State of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// Switch the channel to `on`, and on again afterwards if `again`; once it was sent, its deadline.
    Set { on: bool, again: bool, accepted: Option<Instant> },
    /// Off, to be started at this time.
    Rests { until: Instant },
}

/// Result of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The channel has the ordered state.
    Done { channel: usize, on: bool },
    /// The board did not switch the channel.
    Stuck { channel: usize, on: bool },
    /// The channel is off, and nobody ordered it.
    Tripped { channel: usize },
    /// A channel that switched itself off is on again, or was ordered off.
    Restored { channel: usize, on: bool },
}

/// State of the channels.
#[derive(Debug, Default)]
pub(super) struct Channels {
    /// Channels that are on, as last reported.
    state: Option<u8>,
    orders: [Option<Order>; CHANNELS.len()],
    /// Channels that switched themselves off.
    tripped: u8,
}

impl Channels {
    pub fn state(&self) -> Option<u8> {
        self.state
    }

    /// Orders a channel on or off; `again`: off, and on again.
    pub fn order(&mut self, channel: usize, on: bool, again: bool) {
        if let Some(order) = self.orders.get_mut(channel) {
            *order = Some(Order::Set { on, again, accepted: None });
        }
    }

    /// Discards all orders.
    pub fn forget(&mut self) {
        self.orders = Default::default();
    }

    /// Channels to be sent to the board, and their states.
    pub fn outstanding(&self) -> Option<(u8, u8)> {
        let (mut mask, mut states) = (0, 0);
        for (channel, order) in self.orders.iter().enumerate() {
            if let Some(Order::Set { on, accepted: None, .. }) = order {
                mask |= 1 << channel;
                states |= u8::from(*on) << channel;
            }
        }
        (mask != 0).then_some((mask, states))
    }

    /// The board accepted these orders.
    pub fn accepted(&mut self, now: Instant, mask: u8, states: u8) {
        for (channel, order) in self.orders.iter_mut().enumerate() {
            if let Some(Order::Set { on, accepted: accepted @ None, .. }) = order
                && mask >> channel & 1 == 1
                && states >> channel & 1 == u8::from(*on)
            {
                *accepted = Some(now + SWITCH_TIMEOUT);
            }
        }
    }

    /// Processes the reported states of the channels; `ends`: all are about to be switched off.
    pub fn on_state(&mut self, now: Instant, state: u8, ends: bool) -> Vec<Outcome> {
        let before = self.state.replace(state);
        let mut outcomes = Vec::new();
        for (channel, order) in self.orders.iter_mut().enumerate() {
            let (is, bit) = (state >> channel & 1 == 1, 1 << channel);
            let was = before.is_some_and(|before| before & bit != 0);
            let ordered_off = matches!(order, Some(Order::Set { on: false, .. } | Order::Rests { .. }));
            if self.tripped & bit != 0 && (is || ordered_off) {
                self.tripped &= !bit;
                outcomes.push(Outcome::Restored { channel, on: is });
            } else if was && !is && !ordered_off && !ends {
                self.tripped |= bit;
                outcomes.push(Outcome::Tripped { channel });
            }
            if let Some(Order::Set { on, again, accepted: Some(until) }) = *order {
                if is == on {
                    outcomes.push(Outcome::Done { channel, on });
                    *order = again.then(|| Order::Rests { until: now + RESTART_PAUSE });
                } else if until <= now {
                    outcomes.push(Outcome::Stuck { channel, on });
                    *order = None;
                }
            }
        }
        outcomes
    }

    /// Starts channels whose off time has ended; true if there is something to send.
    pub fn on_timer(&mut self, now: Instant) -> bool {
        let mut rested = false;
        for order in &mut self.orders {
            if matches!(order, Some(Order::Rests { until }) if *until <= now) {
                *order = Some(Order::Set { on: true, again: false, accepted: None });
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
