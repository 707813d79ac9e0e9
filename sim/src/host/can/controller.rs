//! A CAN controller: what waits to be sent, and fault confinement by its two error counters (ISO 11898-1, 12).

use crate::host::owner::Owner;
use base::can::{BusState, Frame, Health, Notice};
use base::{Duration, Instant};
use std::collections::VecDeque;
use std::rc::Rc;

/// Frames that a port queues; further ones are dropped. One SDO block fits.
const QUEUE: usize = 128;
/// Once nothing has left for so long, what has waited that long is dropped, as in the live ports.
const QUEUE_AGE: Duration = Duration::from_millis(50);
/// A port restarts its controller after bus-off so late, twice as late each time, and no later than the second.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));
/// Above this a counter makes error-passive.
const PASSIVE: u16 = 127;
/// Above this the transmit counter makes bus-off.
const OFF: u16 = 255;

/// A frame and since when it waits; one that was on the wire is the controller's, and does not grow old.
#[derive(Clone, Copy, Debug)]
pub(super) struct Queued {
    pub frame: Frame,
    pub since: Instant,
    pub tried: bool,
}

/// A controller. It stays on its wire when the process that used it ends, as an interface does; the next process of
/// that module finds it as it is.
#[derive(Debug)]
pub(super) struct Controller {
    pub owner: Owner,
    pub module: Rc<str>,
    /// It stands for several nodes, which acknowledge each other's frames.
    pub many: bool,
    queue: VecDeque<Queued>,
    transmit_errors: u16,
    receive_errors: u16,
    /// Time when its last frame left.
    left: Instant,
    /// A passive transmitter lets others begin first.
    pub suspended: Instant,
    /// Until then it is alone at its end of a cable.
    pub cut: Instant,
    /// Time when it takes part again after bus-off.
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

    /// Takes a frame to send; false when there is no room, or the controller is off the bus.
    pub fn push(&mut self, now: Instant, frame: Frame) -> bool {
        let room = self.back.is_none() && self.queue.len() < QUEUE;
        if room {
            self.queue.push_back(Queued { frame, since: now, tried: false });
        }
        room
    }

    /// Drops what has grown old; how many that were.
    pub fn forget(&mut self, now: Instant) -> u64 {
        let before = self.queue.len();
        // The oldest are in front, but for one that was tried.
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

    /// The frame was not sent: it is sent again.
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

    /// A frame was received well.
    pub fn received(&mut self) {
        self.receive_errors = self.receive_errors.saturating_sub(1).min(PASSIVE);
    }

    /// A frame was sent well.
    pub fn sent(&mut self, now: Instant) {
        self.left = now;
        self.transmit_errors = self.transmit_errors.saturating_sub(1);
    }

    /// An error was seen in a frame of another.
    pub fn receive_error(&mut self) {
        self.receive_errors = (self.receive_errors + 1).min(255);
        self.errors = self.errors.saturating_add(1);
    }

    /// An error was seen in the frame that it sends.
    pub fn transmit_error(&mut self) {
        self.transmit_errors += 8;
        self.errors = self.errors.saturating_add(1);
    }

    /// Nobody acknowledged its frame. A passive one does not count that: alone on its bus it does not go off
    /// (12.1.4.2, exception 1 of rule c).
    pub fn no_acknowledge(&mut self) {
        if !self.is_passive() {
            self.transmit_errors += 8;
        }
        self.unheard = true;
    }

    pub fn is_over(&self) -> bool {
        self.transmit_errors > OFF
    }

    /// Leaves the bus: what waits is dropped; how many frames that were. It takes part again when its port has
    /// restarted it and it has seen the bus idle for `recovery`.
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

    /// Takes part again.
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

    /// State, when it has changed since it was told.
    pub fn poll_state(&mut self) -> Option<Notice> {
        (self.health().state != self.told.state).then(|| self.tell_health())
    }

    /// True if something is to be told that may wait.
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
