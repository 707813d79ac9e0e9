//! The start-up of a VESC, its commands and its feedback.
//!
//! Steps: firmware; the timeout of the application's configuration; braked until it stands; zero current until the
//! values show that the timeout is not active; no commands, only questions for the values, until they show that it is;
//! braked until it is not.

use super::payload::{Answer, MOTOR_CONTROLLER, Request, Values};
use super::{Device, Link};
use crate::config::{PERIODS_MIN, Timing};
use crate::engine::{Progress, Protocol, Setpoint, Shared};
use crate::event::{LostReason, Reaction, Refusal, Step, text};
use base::{Duration, Instant};
use heapless::Vec;

/// Oldest firmware, major version, whose layouts are known.
const FIRMWARE_MIN: u8 = 6;
/// Time limit of a step that waits for an answer.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);
/// Interval of a request that is repeated until it is answered. An answer of 512 bytes takes 45 ms at 115200 bit/s.
const REPEAT: Duration = Duration::from_millis(150);
/// Time limit to stand, when the axis turned at the start.
const STANDSTILL_WITHIN: Duration = Duration::from_secs(5);
/// The device checks its timeout every 10 ms (`timeout.c`), and its answer takes time, too.
const REACTION_SLACK: Duration = Duration::from_millis(20);
/// Answers of one input; more are counted as rejected.
const ANSWERS: usize = 8;

/// What the start-up waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wait {
    /// Firmware.
    Firmware,
    /// The application's configuration.
    AppConf,
    /// Standstill.
    Standstill,
    /// The timeout is not active, at zero current.
    Armed,
    /// The timeout is active, without commands.
    Silence,
    /// The timeout is not active, while it is braked.
    Enabled { acted_after: Duration },
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    /// The requests of `wait` are repeated at `next`, and given up at `until`.
    Waiting {
        wait: Wait,
        next: Instant,
        until: Instant,
    },
    Ready,
}

/// Commands to one VESC.
#[derive(Debug)]
pub struct Commands<L> {
    device: Device,
    timing: Timing,
    link: L,
    phase: Phase,
    /// True if firmware and id are the expected ones.
    identified: bool,
    /// Timeout and brake current of the device.
    limit: Duration,
    brake_current_a: f64,
    /// When the last command was sent.
    commanded: Instant,
    /// Tachometer, and its steps since the first answer, without its wrap.
    tachometer: Option<i32>,
    steps: i64,
}

impl<L: Link> Commands<L> {
    pub(super) fn new(device: Device, timing: Timing, link: L) -> Self {
        Self {
            device,
            timing,
            link,
            phase: Phase::Off,
            identified: false,
            limit: Duration::ZERO,
            brake_current_a: 0.0,
            commanded: Instant::ZERO,
            tachometer: None,
            steps: 0,
        }
    }

    fn ask(&mut self, request: Request) {
        self.link.send(&request.bytes());
    }

    fn command(&mut self, now: Instant, request: Request) {
        self.commanded = now;
        self.ask(request);
    }

    fn enter(&mut self, now: Instant, wait: Wait) -> Progress {
        // A command that still waits would end the silence.
        self.link.clear();
        let until = match wait {
            Wait::Standstill => now + STANDSTILL_WITHIN,
            Wait::Silence => self.commanded + self.limit + self.timing.period * 2 + REACTION_SLACK,
            _ => now + ANSWER_WITHIN,
        };
        self.request(now, wait);
        self.phase = Phase::Waiting { wait, next: now + self.repeat(wait), until };
        Progress::Pending
    }

    fn repeat(&self, wait: Wait) -> Duration {
        match wait {
            Wait::Firmware | Wait::AppConf => REPEAT,
            _ => self.timing.period,
        }
    }

    /// What is sent at first and repeated while the start-up waits.
    fn request(&mut self, now: Instant, wait: Wait) {
        match wait {
            Wait::Firmware => return self.ask(Request::Firmware),
            Wait::AppConf => return self.ask(Request::AppConf),
            Wait::Standstill | Wait::Enabled { .. } => {
                self.command(now, Request::SetBrake(self.device.hold_current_a));
            }
            Wait::Armed => self.command(now, Request::SetCurrent(0.0)),
            Wait::Silence => {}
        }
        self.ask(Request::Values);
    }

    fn expired(&self, now: Instant, wait: Wait, shared: &Shared<1>) -> Progress {
        let is_measured = !shared.feedback[0].velocity_radps.is_nan();
        let (step, refusal) = match wait {
            Wait::Firmware => (Step::Contact, Refusal::Silent),
            Wait::AppConf => (Step::TimeLimit, Refusal::Silent),
            Wait::Standstill if is_measured => (Step::Standstill, Refusal::Moving),
            Wait::Standstill => (Step::Standstill, Refusal::Silent),
            Wait::Armed => (Step::Silence, Refusal::NotEnabled),
            Wait::Silence => (Step::Silence, Refusal::NoReaction { after: now.since(self.commanded) }),
            Wait::Enabled { .. } => (Step::Enable, Refusal::NotEnabled),
        };
        Progress::Refused(step, refusal)
    }

    fn answered(&mut self, now: Instant, answer: Answer, shared: &mut Shared<1>) -> Progress {
        match (self.phase, answer) {
            (
                Phase::Waiting { wait: Wait::Firmware, .. },
                Answer::Firmware { version: [major, minor], hardware, kind },
            ) => {
                if kind != MOTOR_CONTROLLER || major < FIRMWARE_MIN {
                    let name = core::str::from_utf8(&hardware).unwrap_or("?");
                    let found = text(format_args!("firmware {major}.{minor:02}, kind {kind}, {name}"));
                    return Progress::Refused(Step::Identity, Refusal::Identity { found });
                }
                self.enter(now, Wait::AppConf)
            }
            (Phase::Waiting { wait: Wait::AppConf, .. }, Answer::AppConf { id, timeout_ms, brake_current_a }) => {
                self.configured(now, id, timeout_ms, brake_current_a)
            }
            (_, Answer::Values(values)) if values.id == self.device.id => self.values(now, &values, shared),
            (_, Answer::Values(_)) => {
                shared.reject();
                Progress::Pending
            }
            _ => Progress::Pending,
        }
    }

    fn configured(&mut self, now: Instant, id: u8, timeout_ms: u32, brake_current_a: f32) -> Progress {
        if id != self.device.id {
            let found = text(format_args!("id {id}"));
            return Progress::Refused(Step::Identity, Refusal::Identity { found });
        }
        self.identified = true;
        (self.limit, self.brake_current_a) = (Duration::from_millis(timeout_ms.into()), brake_current_a.into());
        // Zero disables the timeout; one that is too short would act between two commands.
        if self.limit < self.timing.period * PERIODS_MIN || self.limit > self.timing.time_limit {
            return Progress::Refused(Step::TimeLimit, Refusal::TimeLimit { found: self.limit });
        }
        self.enter(now, Wait::Standstill)
    }

    fn values(&mut self, now: Instant, values: &Values, shared: &mut Shared<1>) -> Progress {
        self.measure(now, values, shared);
        let errors = u32::from(values.fault);
        match self.phase {
            Phase::Off => Progress::Pending,
            Phase::Ready if errors != 0 => Progress::Lost(LostReason::Fault { errors }),
            Phase::Ready if values.killed => Progress::Lost(LostReason::Disabled),
            Phase::Ready if values.timed_out => Progress::Lost(LostReason::TimeLimitActed),
            Phase::Ready => Progress::Pending,
            Phase::Waiting { .. } if errors != 0 => Progress::Refused(Step::Enable, Refusal::Fault { errors }),
            Phase::Waiting { .. } if values.killed => Progress::Refused(Step::Enable, Refusal::NotEnabled),
            Phase::Waiting { wait, .. } => match wait {
                Wait::Standstill if shared.stands(0) => self.enter(now, Wait::Armed),
                Wait::Armed if !values.timed_out => self.enter(now, Wait::Silence),
                Wait::Silence if values.timed_out => {
                    let acted_after = now.since(self.commanded);
                    self.enter(now, Wait::Enabled { acted_after })
                }
                Wait::Enabled { acted_after } if !values.timed_out => {
                    self.phase = Phase::Ready;
                    Progress::Started(Some(acted_after), Reaction::Brakes { current_a: self.brake_current_a })
                }
                _ => Progress::Pending,
            },
        }
    }

    fn measure(&mut self, now: Instant, values: &Values, shared: &mut Shared<1>) {
        let before = self.tachometer.replace(values.tachometer).unwrap_or(values.tachometer);
        self.steps += i64::from(values.tachometer.wrapping_sub(before));
        let turns_per_s = f64::from(values.erpm) / self.device.erpm_per_turn();
        shared.measured(now, 0, turns_per_s, self.steps as f64 / self.device.steps_per_turn());
        let feedback = &mut shared.feedback[0];
        feedback.current_a = f64::from(values.current_ca) / 100.0;
        feedback.supply_v = f64::from(values.supply_dv) / 10.0;
        feedback.temperature_c = f64::from(values.temperature_dc) / 10.0;
    }

    /// The command for a setpoint.
    fn drive(&self, setpoint: &Setpoint<1>, shared: &Shared<1>) -> Request {
        let turns_per_s = setpoint.velocity_radps[0] * shared.axes[0].turns_per_rad();
        let erpm = turns_per_s * self.device.erpm_per_turn();
        if setpoint.quick_stop {
            Request::SetBrake(self.device.quick_stop_current_a)
        } else if erpm == 0.0 || erpm.abs() < self.device.erpm_min {
            Request::SetBrake(self.device.hold_current_a)
        } else {
            // Saturates; the limits of an axis are far below.
            Request::SetRpm(libm::round(erpm) as i32)
        }
    }
}

impl<L: Link> Protocol<1> for Commands<L> {
    type Rx = L::Rx;
    type Tx = L::Tx;

    fn start(&mut self, now: Instant) {
        (self.tachometer, self.identified) = (None, false);
        self.enter(now, Wait::Firmware);
    }

    fn reset(&mut self) {
        self.phase = Phase::Off;
        self.link.clear();
    }

    fn withdraw(&mut self, _: Instant) {
        self.reset();
        if self.identified {
            self.ask(Request::SetCurrent(0.0));
        }
    }

    fn handle_rx(&mut self, now: Instant, rx: &L::Rx, shared: &mut Shared<1>) -> Progress {
        let mut answers: Vec<Answer, ANSWERS> = Vec::new();
        let mut unknown = 0;
        let damaged = self.link.receive(now, rx, &mut |payload| {
            let is_taken = Answer::decode(payload).is_some_and(|answer| answers.push(answer).is_ok());
            unknown += u32::from(!is_taken);
        });
        (0..damaged + unknown).for_each(|_| shared.reject());
        for answer in answers {
            let progress = self.answered(now, answer, shared);
            if progress != Progress::Pending {
                return progress;
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared<1>) -> Progress {
        match self.phase {
            Phase::Waiting { wait, until, .. } if until <= now => self.expired(now, wait, shared),
            Phase::Waiting { wait, next, until } if next <= now => {
                self.request(now, wait);
                self.phase = Phase::Waiting { wait, next: now + self.repeat(wait), until };
                Progress::Pending
            }
            _ => Progress::Pending,
        }
    }

    fn send(&mut self, now: Instant, setpoint: &Setpoint<1>, shared: &Shared<1>) {
        // Of a line that takes nothing, only the newest setpoint may wait.
        self.link.clear();
        let request = self.drive(setpoint, shared);
        self.command(now, request);
        self.ask(Request::Values);
    }

    fn halt(&mut self, now: Instant) {
        self.reset();
        self.command(now, Request::SetBrake(self.device.quick_stop_current_a));
    }

    fn disarm(&mut self, now: Instant) {
        self.reset();
        self.command(now, Request::SetCurrent(0.0));
    }

    fn poll_tx(&mut self, _: Instant) -> Option<L::Tx> {
        self.link.poll_tx()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::Waiting { next, until, .. } => Some(next.min(until)),
            Phase::Off | Phase::Ready => None,
        }
    }
}
