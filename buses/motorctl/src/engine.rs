//! The engine: the life of a motor controller, the same for every protocol.
//!
//! ```text
//!             first handle_timeout           started                  lost
//!     Off(new) ------------------> Starting ---------> Ready ----------------------+
//!                                   ^    | refused                                  |
//!                                   |    +--------------> Resting <-----------------+
//!                                   +--- after the rest ----+
//!     any --- disarm ---> Off --- restart ---> Starting
//! ```

use crate::config::{Axis, Config, Timing};
use crate::event::{CommandError, Event, Feedback, LostReason, Reaction, Refusal, ReleaseError, State, Step};
use crate::setpoint::Setpoints;
use base::{Duration, Instant, Queue, Ticker, earliest};

/// An axis slower than this stands, rad/s at the output.
pub const STANDSTILL_RADPS: f64 = 0.1;

/// Events that wait to be drained. A life of [`Timing::rest`] brings two at most.
const EVENTS: usize = 8;

/// What a protocol works with, beside its own state.
#[derive(Debug)]
pub struct Shared<const N: usize> {
    pub(crate) timing: Timing,
    pub(crate) axes: [Axis; N],
    pub(crate) feedback: [Feedback; N],
    pub(crate) rejected: u32,
}

impl<const N: usize> Shared<N> {
    /// Counts input that the protocol does not allow.
    pub(crate) fn reject(&mut self) {
        self.rejected = self.rejected.saturating_add(1);
    }

    /// Takes velocity and position of the motor, in turns/s and turns.
    pub(crate) fn measured(&mut self, now: Instant, axis: usize, turns_per_s: f64, turns: f64) {
        let ratio = self.axes[axis].turns_per_rad();
        let (velocity_radps, position_rad) = (turns_per_s / ratio, turns / ratio);
        self.feedback[axis] = Feedback { at: now, velocity_radps, position_rad, ..self.feedback[axis] };
    }

    pub(crate) fn stands(&self, axis: usize) -> bool {
        self.feedback[axis].velocity_radps.abs() < STANDSTILL_RADPS
    }

    /// When the oldest feedback is too old.
    fn expiry(&self) -> Instant {
        let oldest = self.feedback.iter().map(|feedback| feedback.at).min();
        oldest.map_or(Instant::NEVER, |at| at + self.timing.feedback_within)
    }
}

/// Effect of an input or a deadline on the start-up and on a device that is ready.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    /// None.
    Pending,
    /// The start-up has ended.
    Started(Option<Duration>, Reaction),
    /// The start-up has failed.
    Refused(Step, Refusal),
    /// The device, which was ready, is lost.
    Lost(LostReason),
}

/// Setpoints of one period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint<const N: usize> {
    /// rad/s at the output.
    pub velocity_radps: [f64; N],
    /// True while a quick stop is active.
    pub quick_stop: bool,
}

/// A protocol: what is sent, and what answers mean. Implemented in this crate only.
pub trait Protocol<const N: usize> {
    /// What arrives: a frame, or bytes.
    type Rx: ?Sized;
    /// What is sent: a frame, or bytes to be sent without a gap.
    type Tx;

    /// Begins the start-up.
    fn start(&mut self, now: Instant);
    /// Forgets what waits to be sent and to be answered.
    fn reset(&mut self);
    /// After [`Self::reset`], removes the torque of a device that is identified; a stranger is sent nothing.
    fn withdraw(&mut self, now: Instant);
    /// Takes input.
    fn handle_rx(&mut self, now: Instant, rx: &Self::Rx, shared: &mut Shared<N>) -> Progress;
    /// Serves deadlines.
    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared<N>) -> Progress;
    /// Sends the setpoints of a period, and asks for measurements.
    fn send(&mut self, now: Instant, setpoint: &Setpoint<N>, shared: &Shared<N>);
    /// After [`Self::reset`], sends zero velocity, the last command before silence.
    fn halt(&mut self, now: Instant);
    /// After [`Self::reset`], sends the command that removes the torque.
    fn disarm(&mut self, now: Instant);
    /// Next output.
    fn poll_tx(&mut self, now: Instant) -> Option<Self::Tx>;
    /// Next deadline.
    fn poll_timeout(&self) -> Option<Instant>;
}

#[derive(Debug)]
enum Life {
    New,
    Off,
    Starting,
    Resting { until: Instant },
    Ready { period: Ticker },
}

/// A motor controller with `N` axes. Reads no clock and owns no port: feed it input and time, and after any call drain
/// [`Engine::poll_tx`], then [`Engine::poll_event`], then arm one timer for [`Engine::poll_timeout`].
#[derive(Debug)]
pub struct Engine<P, const N: usize> {
    protocol: P,
    shared: Shared<N>,
    setpoints: Setpoints<N>,
    second_way: bool,
    life: Life,
    events: Queue<Event, EVENTS>,
    /// The refusal reported last.
    reported: Option<(Step, Refusal)>,
}

impl<P: Protocol<N>, const N: usize> Engine<P, N> {
    pub(crate) fn with(protocol: P, config: &Config<N>) -> Self {
        Self {
            protocol,
            shared: Shared { timing: config.timing, axes: config.axes, feedback: [Feedback::UNKNOWN; N], rejected: 0 },
            setpoints: Setpoints::new(config.axes),
            second_way: config.second_way,
            life: Life::New,
            events: Queue::new(),
            reported: None,
        }
    }

    /// Progress.
    #[must_use]
    pub fn state(&self) -> State {
        match self.life {
            Life::New | Life::Off => State::Off,
            Life::Starting => State::Starting,
            Life::Resting { .. } => State::Resting,
            Life::Ready { .. } => State::Ready,
        }
    }

    /// Sets the target velocities, rad/s at the output. They are in force for [`Timing::command_within`] and are
    /// approached by the ramp of each axis.
    ///
    /// # Errors
    /// The command was not taken; what was in force stays so.
    pub fn command(&mut self, now: Instant, velocity_radps: [f64; N]) -> Result<(), CommandError> {
        if !matches!(self.life, Life::Ready { .. }) {
            return Err(CommandError::NotReady);
        }
        self.setpoints.command(now + self.shared.timing.command_within, velocity_radps)
    }

    /// Stops all axes by their ramps.
    pub fn stop(&mut self) {
        self.setpoints.stop();
    }

    /// Stops all axes as fast as the device can, and refuses commands until [`Self::release`]. One that begins is sent
    /// by the next [`Self::handle_timeout`], which is due at once. Torque stays on: see [`Self::disarm`].
    pub fn quick_stop(&mut self) {
        if let Life::Ready { period } = &mut self.life
            && !self.setpoints.is_quick_stop()
        {
            *period = Ticker::new(Instant::ZERO, period.period());
        }
        self.setpoints.quick_stop();
    }

    /// True while a quick stop is active.
    #[must_use]
    pub fn is_quick_stop(&self) -> bool {
        self.setpoints.is_quick_stop()
    }

    /// Ends a quick stop.
    ///
    /// # Errors
    /// It stays active: an axis was not measured at standstill.
    pub fn release(&mut self, now: Instant) -> Result<(), ReleaseError> {
        if self.shared.expiry() <= now || !(0..N).all(|axis| self.shared.stands(axis)) {
            return Err(ReleaseError::Moving);
        }
        self.setpoints.release();
        Ok(())
    }

    /// Removes the torque of all axes, which then roll, and stays off until [`Self::restart`].
    pub fn disarm(&mut self, now: Instant) {
        self.protocol.disarm(now);
        self.setpoints.zero();
        self.life = Life::Off;
    }

    /// Begins the start-up again, in any state. Setpoints end at once, and the command time limit of the device acts
    /// unless the start-up comes first: an axis that turns is to be stopped before.
    pub fn restart(&mut self, now: Instant) {
        self.protocol.reset();
        self.setpoints.zero();
        self.shared.feedback = [Feedback::UNKNOWN; N];
        self.protocol.start(now);
        self.life = Life::Starting;
    }

    /// Measurements of an axis; none for an axis that the device does not have, and before the first measurement.
    #[must_use]
    pub fn feedback(&self, axis: usize) -> Option<&Feedback> {
        self.shared.feedback.get(axis).filter(|feedback| !feedback.velocity_radps.is_nan())
    }

    /// Inputs that the protocol does not allow: wrong length, checksum, number, or nobody's answer.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.shared.rejected
    }

    /// Takes a frame, or bytes, that arrived at `now`.
    pub fn handle_rx(&mut self, now: Instant, rx: &P::Rx) {
        let progress = self.protocol.handle_rx(now, rx, &mut self.shared);
        self.apply(now, progress);
    }

    /// Serves deadlines; late and needless calls do no harm. The first call starts the engine.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self.life {
            Life::New => self.restart(now),
            Life::Resting { until } if until <= now => self.restart(now),
            _ => {}
        }
        if matches!(self.life, Life::Starting | Life::Ready { .. }) {
            let progress = self.protocol.handle_timeout(now, &mut self.shared);
            self.apply(now, progress);
        }
        self.serve_period(now);
    }

    fn serve_period(&mut self, now: Instant) {
        let Life::Ready { period } = &mut self.life else { return };
        if self.shared.expiry() <= now {
            self.apply(now, Progress::Lost(LostReason::Silent));
        } else if period.due(now) {
            let velocity_radps = self.setpoints.tick(now, &self.shared.timing);
            let setpoint = Setpoint { velocity_radps, quick_stop: self.setpoints.is_quick_stop() };
            self.protocol.send(now, &setpoint, &self.shared);
        }
    }

    /// Next output. Frames are to be sent in order, bytes without a gap.
    pub fn poll_tx(&mut self, now: Instant) -> Option<P::Tx> {
        self.protocol.poll_tx(now)
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match &self.life {
            Life::New => Some(Instant::ZERO),
            Life::Off => None,
            Life::Starting => self.protocol.poll_timeout(),
            Life::Resting { until } => Some(*until),
            Life::Ready { period } => {
                earliest([self.protocol.poll_timeout(), Some(period.next()), Some(self.shared.expiry())])
            }
        }
    }

    fn apply(&mut self, now: Instant, progress: Progress) {
        match (&self.life, progress) {
            (Life::Starting, Progress::Started(None, _)) if !self.second_way => {
                self.refuse(now, Step::Silence, Refusal::NotProvable);
            }
            (Life::Starting, Progress::Started(acted_after, reaction)) => {
                self.setpoints.zero();
                self.reported = None;
                let period = self.shared.timing.period;
                self.life = Life::Ready { period: Ticker::new(now + period, period) };
                self.events.push(Event::Ready { acted_after, reaction });
            }
            (Life::Starting, Progress::Refused(step, reason)) => self.refuse(now, step, reason),
            (Life::Ready { .. }, Progress::Lost(reason)) => {
                // One last command, zero, and then silence, in which the command time limit of the device acts.
                self.protocol.halt(now);
                self.rest(now);
                self.events.push(Event::Lost { reason });
            }
            _ => {}
        }
    }

    fn refuse(&mut self, now: Instant, step: Step, reason: Refusal) {
        self.protocol.withdraw(now);
        self.rest(now);
        let cause = Some((step, reason.clone()));
        if self.reported != cause {
            self.reported = cause;
            self.events.push(Event::Refused { step, reason });
        }
    }

    fn rest(&mut self, now: Instant) {
        self.setpoints.zero();
        self.life = Life::Resting { until: now + self.shared.timing.rest };
    }
}
