//! Which senders the modules accept, by the robot's own processes and the transport of a message (docs/design.md,
//! section 11): commands from those that `[bus] commands` names, reports that all is well only from the watchdog and
//! the power controller, that a lidar's fields are free or an input is closed only from its driver, the measured motion
//! only from the driver, the estimate only from the estimator, and the bounds only from the guard.
//!
//! The witness is the host, which knows each sender; `module::admission`, which the modules use, is not asked.

use super::Limits;
use messages::{Message, common, middlelevel};
use module::State;
use module::admission::{Commands, Sender, Way};

/// Processes that may report that all is well, how the robot moves and may move, or where it is: those of the watchdog,
/// the power controller, the driver, the guard and the estimator, including ended ones, since their last messages may
/// still be on their way.
#[derive(Debug, Default)]
pub(super) struct Believed {
    watchdogs: Vec<u32>,
    controllers: Vec<u32>,
    drivers: Vec<u32>,
    guards: Vec<u32>,
    estimators: Vec<u32>,
    /// Of modules that report sources of PAUSE, with their names.
    stops: Vec<(u32, Box<str>)>,
}

impl Believed {
    pub fn on_started(&mut self, module: &str, pid: u32, limits: &Limits) {
        if module == limits.watchdog {
            self.watchdogs.push(pid);
        } else if limits.power.as_deref() == Some(module) {
            self.controllers.push(pid);
        } else if module == limits.driver {
            self.drivers.push(pid);
        } else if limits.guard.as_ref().is_some_and(|guard| guard.module == module) {
            self.guards.push(pid);
        } else if limits.estimator.as_deref() == Some(module) {
            self.estimators.push(pid);
        } else if limits.stops.iter().any(|stop| stop.module == module) {
            self.stops.push((pid, module.into()));
        }
    }

    /// True if this sender is a process of the module that reports this source of PAUSE.
    pub fn reports_the_source(&self, sender: Sender, source: &str, limits: &Limits) -> bool {
        let is_its = |module: &str| self.stops.iter().any(|(pid, own)| sender.pid() == Some(*pid) && **own == *module);
        limits.stops.iter().any(|stop| stop.source == source && is_its(&stop.module))
    }

    /// True if this sender reports the state of the PAUSE line, and not for itself.
    pub fn reports_the_line(&self, sender: Sender, limits: &Limits) -> bool {
        limits.power.is_none() || is_one_of(sender, &self.controllers)
    }

    /// True if this sender may command.
    pub fn may_command(&self, sender: Sender, limits: &Limits) -> bool {
        match limits.commands {
            Commands::Memory => sender.way == Way::Memory,
            Commands::Host => sender.way != Way::Network,
            Commands::Network => true,
        }
    }

    /// True if a module may accept this message from this sender. What a sender releases of its own is not judged here.
    pub fn believes(&self, sender: Sender, said: &Message, limits: &Limits) -> bool {
        let may_command = self.may_command(sender, limits);
        match said {
            Message::CmDataProcesses(_) => is_one_of(sender, &self.watchdogs),
            Message::LlEventStop(stop) if stop.engaged => true,
            Message::LlEventStop(stop) if limits.stops.iter().any(|known| known.source == stop.source) => {
                self.reports_the_source(sender, &stop.source, limits)
            }
            Message::LlEventStop(_) if limits.power.is_some() => self.reports_the_line(sender, limits),
            Message::LlDataMotion(_) | Message::LlDataVelocity(_) | Message::LlDataNodeIo(_) => {
                is_one_of(sender, &self.drivers)
            }
            Message::LlDataGuard(_) if limits.guard.is_some() => is_one_of(sender, &self.guards),
            Message::LlDataPower(_) if limits.power.is_some() => is_one_of(sender, &self.controllers),
            Message::MlDataEstimate(_) if limits.estimator.is_some() => is_one_of(sender, &self.estimators),
            Message::LlEventStop(_)
            | Message::LlDataPower(_)
            | Message::MlDataEstimate(_)
            | Message::LlDataActiveBeacons(_) => may_command,
            Message::CmCmdState(common::CmdState { state, .. }) if *state != State::Run as i8 => true,
            Message::MlCmdGoal(goal) if goal.waypoints.is_empty() => true,
            Message::MlCmdMode(command) if command.mode == middlelevel::CmdMode::MANUAL => true,
            other if other.channel().name().contains("_CMD_") => may_command,
            _ => true,
        }
    }
}

fn is_one_of(sender: Sender, processes: &[u32]) -> bool {
    sender.pid().is_some_and(|pid| processes.contains(&pid))
}
