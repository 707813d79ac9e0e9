//! Figures of an episode: distances, counts, worst-case times.

use super::operator;
use super::tally::{Contacts, Driven, Goals, Shares};
use crate::check::wire::{Drive, Listener, Wheel, on_bus};
use crate::check::{Limits, Times};
use crate::host::News;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use messages::Message;
use module::admission::Way;
use module::{ExitStatus, State};
use std::collections::BTreeMap;

/// Maximum duration of a silence that counts as an end of motion; the minimum is half a command's time to live.
const SILENCE_MAX: Duration = Duration::from_secs(1);
/// Time after the begin of calm at which all effects of the chaos have ended: controllers in bus-off have recovered.
const SETTLING_TIME: Duration = Duration::from_secs(10);
/// Time after a fault from which the next one counts as single.
const AFTERMATH: Duration = Duration::from_secs(1);

/// Figures of one episode, or of many.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Distance driven, m.
    pub distance: f64,
    /// Number of motions ended by a stop: by silence, PAUSE, a fault.
    pub stops: u64,
    /// Distance by whose commands the robot drove.
    pub shares: Shares,
    /// Number of contacts in which the robot moved.
    pub contacts: u64,
    /// All contacts, by who moved into whom.
    pub touched: Contacts,
    /// Goals of the operator.
    pub goals: Goals,
    /// Longest times.
    pub worst: Worst,
}

/// Longest times; `None` if the event did not occur.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Worst {
    /// From the last command to the stop on the bus, in calm.
    pub silence_to_stop: Option<Duration>,
    /// Times for which rules have a bound.
    pub rules: Times,
    /// From the hang or death of a module to its RUN, without any other fault meanwhile or just before.
    pub loss_to_run: Option<Duration>,
    /// From the begin of calm until the robot moved, without homing.
    pub calm_to_motion: Option<Duration>,
}

impl Figures {
    /// Adds another episode's.
    pub fn add(&mut self, other: &Self) {
        self.distance += other.distance;
        self.stops += other.stops;
        self.contacts += other.contacts;
        self.shares.add(&other.shares);
        self.touched.add(&other.touched);
        self.goals.add(&other.goals);
        let (own, other) = (&mut self.worst, &other.worst);
        own.silence_to_stop = own.silence_to_stop.max(other.silence_to_stop);
        own.rules.add(&other.rules);
        own.loss_to_run = own.loss_to_run.max(other.loss_to_run);
        own.calm_to_motion = own.calm_to_motion.max(other.calm_to_motion);
    }
}

/// Observer of a machine.
#[derive(Debug)]
pub(super) struct Meter {
    limits: Limits,
    /// Reads motor controllers that are no CANopen nodes.
    listener: Listener,
    /// Process of the driver of the drives.
    driver: Option<u32>,
    pub figures: Figures,
    /// Instant since which no fault is injected.
    pub calm: Option<Instant>,
    /// The set-point on the bus moves each wheel.
    moves: Vec<bool>,
    /// Time of the last command that moves it, unless one that stops it followed.
    commanded: Option<Instant>,
    /// Modules that are not in RUN because of a fault.
    down: BTreeMap<String, Down>,
    /// End of the last fault of anything but a process.
    ill: Instant,
    /// Processes that are served late.
    late: Vec<u32>,
    driven: Driven,
    /// Last number of contacts of the simulator.
    collisions: Option<i32>,
}

#[derive(Debug)]
struct Down {
    since: Instant,
    /// True if no other fault was active then or since.
    alone: bool,
}

impl Meter {
    pub fn new(limits: Limits) -> Self {
        Self {
            moves: vec![false; limits.wheels.len()],
            listener: Listener::new(&limits.wheels),
            driver: None,
            limits,
            figures: Figures::default(),
            calm: None,
            commanded: None,
            down: BTreeMap::new(),
            ill: Instant::ZERO,
            late: Vec::new(),
            driven: Driven::default(),
            collisions: None,
        }
    }

    pub fn observe(&mut self, now: Instant, news: &News<'_>) {
        match *news {
            News::Can { bus, pid, frame } if pid != 0 => {
                if let Some(bus) = self.limits.bus(bus) {
                    self.on_frame(now, bus, &frame);
                }
            }
            News::Words { bus, pid, words } => {
                let telegrams = self.listener.on_words(bus, self.driver == Some(pid), words);
                telegrams.into_iter().for_each(|(id, data)| self.on_telegram(now, id, &data));
            }
            News::Started { module, pid } if *module == self.limits.driver => self.driver = Some(pid),
            News::Message { sender, message: Message::LlCmdMotion(command) } if sender.way == Way::Memory => {
                self.on_command(now, command.speed);
            }
            News::Message { sender, message: Message::LlCmdVelocity(command) } if sender.way == Way::Memory => {
                let still = [command.vx, command.vy, command.omega] == [0.0; 3];
                self.on_command(now, if still { 0.0 } else { 1.0 });
            }
            News::Message { sender, message } if sender.way == Way::Memory => self.on_message(message),
            News::Note { line, .. } => {
                if let Ok(contact) = line.parse() {
                    self.figures.touched.take(&contact);
                }
            }
            News::Fault { until, .. } => {
                self.ill = self.ill.max(now).max(until);
                self.down.values_mut().for_each(|down| down.alone = false);
            }
            News::Crawls { pid, late, .. } => self.on_late(now, pid, late),
            News::Hung { module, .. } => self.on_lost(now, module),
            News::Exited { module, pid, status } => {
                self.on_late(now, pid, Duration::ZERO);
                match status {
                    ExitStatus::Code(0) => drop(self.down.remove(module)),
                    _ => self.on_lost(now, module),
                }
            }
            News::Resumed { module, .. } => {
                self.ill = self.ill.max(now);
                self.down.remove(module);
            }
            News::State { module, state } => self.on_state(now, module, state),
            _ => {}
        }
    }

    fn on_lost(&mut self, now: Instant, module: &str) {
        for down in self.down.iter_mut().filter(|(name, _)| **name != *module).map(|(_, down)| down) {
            down.alone = false;
        }
        let alone = self.late.is_empty() && self.down.is_empty() && now > self.ill + AFTERMATH;
        self.down.entry(module.into()).or_insert(Down { since: now, alone });
    }

    fn on_late(&mut self, now: Instant, pid: u32, late: Duration) {
        let was = self.late.len();
        self.late.retain(|other| *other != pid);
        self.late.extend((!late.is_zero()).then_some(pid));
        if self.late.len() > was {
            self.down.values_mut().for_each(|down| down.alone = false);
        } else if self.late.len() < was {
            self.ill = self.ill.max(now);
        }
    }

    fn on_state(&mut self, now: Instant, module: &str, state: State) {
        if matches!(state, State::Run | State::Pause | State::Stop)
            && let Some(down) = self.down.remove(module)
        {
            if state == State::Run && down.alone {
                longest(&mut self.figures.worst.loss_to_run, now.since(down.since));
            }
            self.ill = self.ill.max(now);
        }
    }

    fn on_command(&mut self, now: Instant, speed: f64) {
        self.commanded = (speed != 0.0).then_some(now);
    }

    fn on_frame(&mut self, now: Instant, bus: u8, frame: &Frame) {
        if let Id::Standard(id) = frame.id() {
            self.on_telegram(now, on_bus(bus, id), frame.data());
        }
        let telegrams = self.listener.on_frame(bus, frame);
        telegrams.into_iter().for_each(|(id, data)| self.on_telegram(now, id, &data));
    }

    fn on_telegram(&mut self, now: Instant, id: u16, data: &[u8]) {
        let is_command = |wheel: &Wheel| id == wheel.drive.command.id;
        let Some(number) = self.limits.wheels.iter().position(is_command) else { return };
        let commanded = self.limits.wheels[number].drive.commanded(data);
        let moved = self.moves.contains(&true);
        self.moves[number] = commanded.is_some_and(Drive::moves);
        let stops = moved && !self.moves.contains(&true);
        if !stops {
            return;
        }
        if let Some(commanded) = self.commanded {
            self.figures.stops += 1;
            let silence = now.since(commanded);
            let calm = self.calm.is_some_and(|calm| now.since(calm) > SETTLING_TIME);
            if calm && self.limits.ttl / 2 < silence && silence < SILENCE_MAX {
                longest(&mut self.figures.worst.silence_to_stop, silence);
            }
        }
    }

    /// The robot moves in calm, for the first time.
    pub fn on_moved(&mut self, waited: Duration) {
        longest(&mut self.figures.worst.calm_to_motion, waited);
    }

    fn on_message(&mut self, message: &Message) {
        self.figures.distance += self.driven.observe(message, operator::SOURCE, operator::PLANNER);
        self.figures.shares = self.driven.shares;
        if let Message::SimDataTruth(truth) = message {
            let before = self.collisions.replace(truth.collisions).unwrap_or(truth.collisions);
            self.figures.contacts += u64::try_from(truth.collisions - before).unwrap_or(0);
        }
    }
}

fn longest(worst: &mut Option<Duration>, time: Duration) {
    *worst = (*worst).max(Some(time));
}
