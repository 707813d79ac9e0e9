//! A CAN controller: its send queue, and fault confinement by two error counters (ISO 11898-1, 12).

use crate::host::owner::Owner;
use base::can::{BusState, Frame, Health, Notice};
use base::{Duration, Instant};
use std::collections::VecDeque;
use std::rc::Rc;

/// Capacity of a port's queue, frames; further ones are dropped. One SDO block fits.
const QUEUE: usize = 128;
/// Maximum age of frames if none has left for that long, as in the live ports.
const QUEUE_AGE: Duration = Duration::from_millis(50);
/// First and maximum delay of a restart after bus-off; it doubles each time.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));
/// Error counter value above which the controller is error-passive.
const PASSIVE: u16 = 127;
/// Transmit error counter value above which the controller is bus-off.
const OFF: u16 = 255;

/// A frame and its time of queueing; one that was on the wire stays in the controller and does not age.
#[derive(Clone, Copy, Debug)]
pub(super) struct Queued {
    pub frame: Frame,
    pub since: Instant,
    pub tried: bool,
}

/// A controller. Like an interface it stays on its wire when the process that used it ends; the next process of that
/// module finds it in that state.
#[derive(Debug)]
pub(super) struct Controller {
    pub owner: Owner,
    pub module: Rc<str>,
    /// It represents several nodes, which acknowledge each other's frames.
    pub many: bool,
    queue: VecDeque<Queued>,
    transmit_errors: u16,
    receive_errors: u16,
    /// Time at which its last frame left.
    left: Instant,
    /// End of the suspension of an error-passive transmitter.
    pub suspended: Instant,
    /// Until this time it is alone on its part of the cable.
    pub cut: Instant,
    /// Time of recovery from bus-off.
    pub back: Option<Instant>,
    back_off: Duration,
    since: Instant,
    told: Health,
    errors: u32,
    unheard: bool,
}

impl Controller {
    pub fn new(owner: Owner, module: Rc<str>, many: bool) -> Self {
        Self {
            owner,
            module,
            many,
            queue: VecDeque::new(),
            transmit_errors: 0,
            receive_errors: 0,
            left: Instant::ZERO,
            suspended: Instant::ZERO,
            cut: Instant::ZERO,
            back: None,
            back_off: BACK_OFF.0,
            since: Instant::ZERO,
            told: Health::default(),
            errors: 0,
            unheard: false,
        }
    }

    /// Queues a frame; false if the queue is full or the controller is bus-off.
    pub fn push(&mut self, now: Instant, frame: Frame) -> bool {
        let room = self.back.is_none() && self.queue.len() < QUEUE;
        if room {
            self.queue.push_back(Queued { frame, since: now, tried: false });
        }
        room
    }

    /// Drops frames that are too old; returns their number.
    pub fn forget(&mut self, now: Instant) -> u64 {
        let before = self.queue.len();
        // The oldest are in front, except one that was being sent.
        let old = |queued: &Queued| now.since(queued.since) > QUEUE_AGE;
        if now.since(self.left) > QUEUE_AGE && self.queue.iter().take(2).any(old) {
            self.queue.retain(|queued| queued.tried || !old(queued));
        }
        (before - self.queue.len()) as u64
    }

    pub fn head(&self) -> Option<&Frame> {
        self.queue.front().map(|queued| &queued.frame)
    }

    pub fn pop(&mut self) -> Option<Queued> {
        self.queue.pop_front()
    }

    /// The frame was not sent and is retransmitted.
    pub fn again(&mut self, queued: Queued) {
        if self.back.is_none() {
            self.queue.push_front(Queued { tried: true, ..queued });
        }
    }

    pub fn waits(&self) -> bool {
        !self.queue.is_empty()
    }

    pub fn is_passive(&self) -> bool {
        self.transmit_errors > PASSIVE || self.receive_errors > PASSIVE
    }

    /// A frame was received without error.
    pub fn received(&mut self) {
        self.receive_errors = self.receive_errors.saturating_sub(1).min(PASSIVE);
    }

    /// A frame was sent without error.
    pub fn sent(&mut self, now: Instant) {
        self.left = now;
        self.transmit_errors = self.transmit_errors.saturating_sub(1);
    }

    /// An error was detected in a frame of another node.
    pub fn receive_error(&mut self) {
        self.receive_errors = (self.receive_errors + 1).min(255);
        self.errors = self.errors.saturating_add(1);
    }

    /// An error was detected in the frame that it sends.
    pub fn transmit_error(&mut self) {
        self.transmit_errors += 8;
        self.errors = self.errors.saturating_add(1);
    }

    /// Its frame was not acknowledged. An error-passive node does not count that: alone on its bus it does not go
    /// bus-off (12.1.4.2, exception 1 of rule c).
    pub fn no_acknowledge(&mut self) {
        if !self.is_passive() {
            self.transmit_errors += 8;
        }
        self.unheard = true;
    }

    pub fn is_over(&self) -> bool {
        self.transmit_errors > OFF
    }

    /// Goes bus-off: pending frames are dropped; returns their number. It takes part again after its port has restarted
    /// it and the bus was idle for `recovery`.
    pub fn go_off(&mut self, now: Instant, recovery: Duration) -> u64 {
        if now.since(self.since) > BACK_OFF.1 {
            self.back_off = BACK_OFF.0;
        }
        self.back = Some(now + self.back_off + recovery);
        self.back_off = (self.back_off * 2).min(BACK_OFF.1);
        let dropped = self.queue.len() as u64;
        self.queue.clear();
        dropped
    }

    /// Recovers from bus-off.
    pub fn come_back(&mut self, now: Instant) {
        (self.back, self.since) = (None, now);
        (self.transmit_errors, self.receive_errors) = (0, 0);
    }

    pub fn health(&self) -> Health {
        let shown = |errors: u16| errors.min(255) as u8;
        let (transmit_errors, receive_errors) = (shown(self.transmit_errors), shown(self.receive_errors));
        let state = match self.back {
            Some(_) => BusState::Off,
            None => BusState::of(transmit_errors, receive_errors),
        };
        Health { state, transmit_errors, receive_errors }
    }

    /// State, if it changed since the last report.
    pub fn poll_state(&mut self) -> Option<Notice> {
        (self.health().state != self.told.state).then(|| self.tell_health())
    }

    /// True if a notice other than a change of state is pending.
    pub fn has_news(&self) -> bool {
        self.errors > 0 || self.unheard || self.health() != self.told
    }

    pub fn poll_news(&mut self) -> Option<Notice> {
        if self.health() != self.told {
            return Some(self.tell_health());
        }
        if std::mem::take(&mut self.unheard) {
            return Some(Notice::NoAcknowledge);
        }
        let errors = std::mem::take(&mut self.errors);
        (errors > 0).then_some(Notice::Errors(errors))
    }

    fn tell_health(&mut self) -> Notice {
        self.told = self.health();
        Notice::Health(self.told)
    }
}
