//! What an episode shows: how far, how often, how long at worst.

use crate::check::Limits;
use crate::host::News;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use messages::{Message, lowlevel, simulation};
use module::{ExitStatus, State};
use std::collections::BTreeMap;

/// A silence that ends motion is longer than half a command's life and shorter than this.
const SILENCE_MAX: Duration = Duration::from_secs(1);
/// A body that is slower by this has begun to stop, m/s.
const SLOWER: f64 = 0.02;

/// Figures of one episode, or of many.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Way, m.
    pub distance: f64,
    /// How often a motion was ended by a stop: by silence, PAUSE, a fault.
    pub stops: u64,
    /// How often the body touched something.
    pub contacts: u64,
    /// Goals that were reached.
    pub goals: u64,
    /// The longest of each.
    pub worst: Worst,
}

/// The longest times; none where it did not happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Worst {
    /// From the last command to the stop on the bus, in calm.
    pub silence_to_stop: Option<Duration>,
    /// From the press of a bumper or the stop button to the stop on the bus.
    pub pause_to_stop: Option<Duration>,
    /// From the hang or death of the watchdog or a critical module to the stop on the bus, or to the body getting slower.
    pub loss_to_stop: Option<Duration>,
    /// From the hang or death of a module to its RUN.
    pub fault_to_run: Option<Duration>,
}

impl Figures {
    /// Adds another episode's.
    pub fn add(&mut self, other: &Self) {
        self.distance += other.distance;
        self.stops += other.stops;
        self.contacts += other.contacts;
        self.goals += other.goals;
        let (own, other) = (&mut self.worst, &other.worst);
        own.silence_to_stop = own.silence_to_stop.max(other.silence_to_stop);
        own.pause_to_stop = own.pause_to_stop.max(other.pause_to_stop);
        own.loss_to_stop = own.loss_to_stop.max(other.loss_to_stop);
        own.fault_to_run = own.fault_to_run.max(other.fault_to_run);
    }
}

/// Takes what a machine tells its observers.
#[derive(Debug)]
pub(super) struct Meter {
    limits: Limits,
    pub figures: Figures,
    /// Nothing is broken on purpose.
    pub calm: bool,
    /// The set-point on the bus moves the robot.
    moves: bool,
    /// When the last command was sent that moves it, if none that stands came after it.
    commanded: Option<Instant>,
    paused: Option<Instant>,
    lost: Option<Loss>,
    /// Modules that are not in RUN by a fault, since when.
    down: BTreeMap<String, Instant>,
    truth: Option<simulation::DataTruth>,
}

#[derive(Debug)]
struct Loss {
    at: Instant,
    pid: u32,
    speed: f64,
}

impl Meter {
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            figures: Figures::default(),
            calm: false,
            moves: false,
            commanded: None,
            paused: None,
            lost: None,
            down: BTreeMap::new(),
            truth: None,
        }
    }

    pub fn observe(&mut self, now: Instant, news: &News<'_>) {
        match *news {
            News::Can { bus, frame } if bus == self.limits.bus => self.on_frame(now, &frame),
            News::Message { message: Message::LlCmdMotion(command), .. } => self.on_command(now, command),
            News::Message { message: Message::SimDataTruth(truth), .. } => self.on_truth(now, truth),
            News::Fault { fault: "stop_button" | "bumper", .. } if self.moves => {
                self.paused.get_or_insert(now);
            }
            News::Hung { module, pid } => self.on_lost(now, module, pid),
            News::Resumed { module, pid } => {
                self.down.remove(module);
                self.lost.take_if(|loss| loss.pid == pid);
            }
            News::Exited { module, pid, status } if status != ExitStatus::Code(0) => self.on_lost(now, module, pid),
            News::Exited { module, .. } => {
                self.down.remove(module);
            }
            News::State { module, state } => self.on_state(now, module, state),
            _ => {}
        }
    }

    fn on_lost(&mut self, now: Instant, module: &str, pid: u32) {
        self.down.entry(module.into()).or_insert(now);
        let limits = &self.limits;
        let critical =
            module == limits.watchdog || module == limits.driver || limits.critical.iter().any(|m| m == module);
        if critical && self.moves && self.lost.is_none() {
            let speed = self.truth.as_ref().map_or(0.0, |truth| truth.speed.abs());
            self.lost = Some(Loss { at: now, pid, speed });
        }
    }

    fn on_state(&mut self, now: Instant, module: &str, state: State) {
        if matches!(state, State::Run | State::Pause | State::Stop)
            && let Some(since) = self.down.remove(module)
            && state == State::Run
        {
            longest(&mut self.figures.worst.fault_to_run, now.since(since));
        }
    }

    fn on_command(&mut self, now: Instant, command: &lowlevel::CmdMotion) {
        self.commanded = (command.speed != 0.0).then_some(now);
    }

    fn on_frame(&mut self, now: Instant, frame: &Frame) {
        if frame.id() != Id::Standard(0x500 + u16::from(self.limits.propulsion)) {
            return;
        }
        let data = frame.data();
        let moves = data.len() >= 6 && data[0] & 0x0F == 0x0F && data[2..6] != [0; 4];
        let stops = std::mem::replace(&mut self.moves, moves) && !moves;
        if !stops {
            return;
        }
        let worst = &mut self.figures.worst;
        if let Some(commanded) = self.commanded {
            self.figures.stops += 1;
            let silence = now.since(commanded);
            if self.calm && self.limits.ttl / 2 < silence && silence < SILENCE_MAX {
                longest(&mut worst.silence_to_stop, silence);
            }
        }
        if let Some(paused) = self.paused.take() {
            longest(&mut worst.pause_to_stop, now.since(paused));
        }
        if let Some(loss) = self.lost.take() {
            longest(&mut worst.loss_to_stop, now.since(loss.at));
        }
    }

    fn on_truth(&mut self, now: Instant, truth: &simulation::DataTruth) {
        if let Some(before) = &self.truth {
            self.figures.distance += libm::hypot(truth.x - before.x, truth.y - before.y);
            self.figures.contacts += u64::try_from(truth.collisions - before.collisions).unwrap_or(0);
        }
        if let Some(loss) = self.lost.take_if(|loss| truth.speed.abs() < loss.speed - SLOWER) {
            longest(&mut self.figures.worst.loss_to_stop, now.since(loss.at));
        }
        self.truth = Some(truth.clone());
    }
}

fn longest(worst: &mut Option<Duration>, time: Duration) {
    *worst = (*worst).max(Some(time));
}
