//! What guards `advee up` itself: the service manager and the computer's own watchdog. Both are fed only while the
//! watchdog's pulse comes and says that all critical modules are healthy, so each link of the chain is proven by the
//! next.

use crate::Failed;
use base::Instant;
use host::hardware_watchdog::HardwareWatchdog;
use host::log::Log;
use host::notify::{HealthReport, Manager};
use robot::config;
use std::fs;
use std::os::unix::fs::FileTypeExt;

/// Those that guard us.
pub struct Guards {
    log: Log,
    manager: Option<Manager>,
    hardware: Hardware,
}

enum Hardware {
    None,
    /// To be armed when the robot is healthy for the first time: one that never is must not reset the computer for
    /// ever.
    Wanted(config::HardwareWatchdog),
    Armed(HardwareWatchdog),
}

impl Guards {
    /// As the environment and the configuration have them. A simulated robot does not reset the computer.
    pub fn new(log: Log, hardware: Option<config::HardwareWatchdog>, sim: bool) -> Result<Self, Failed> {
        let manager = Manager::open()?;
        let is_device = |path| fs::metadata(path).is_ok_and(|found| found.file_type().is_char_device());
        let hardware = match hardware {
            Some(wanted) if sim && is_device(&wanted.path) => {
                log.line(format_args!("hardware watchdog {}: not for a simulated robot", wanted.path.display()));
                Hardware::None
            }
            Some(wanted) => Hardware::Wanted(wanted),
            None => Hardware::None,
        };
        Ok(Self { log, manager, hardware })
    }

    /// How the robot is: they are fed when it is well.
    pub fn pulse(&mut self, now: Instant, pulse: &HealthReport) {
        if let Some(manager) = &mut self.manager {
            manager.pulse(now, pulse);
        }
        match &mut self.hardware {
            Hardware::Wanted(wanted) if pulse.healthy => {
                self.hardware = match HardwareWatchdog::open(&wanted.path, wanted.timeout_s) {
                    Ok((device, line)) => {
                        self.log.line(line);
                        Hardware::Armed(device)
                    }
                    Err(line) => {
                        self.log.line(line);
                        Hardware::None
                    }
                };
            }
            Hardware::Armed(device) if pulse.healthy => device.feed(now),
            _ => {}
        }
    }

    /// The end begins.
    pub fn stopping(&mut self) {
        if let Some(manager) = &mut self.manager {
            manager.stopping();
        }
    }

    /// All has ended: the computer stays on.
    pub fn disarm(self) {
        if let Hardware::Armed(device) = self.hardware {
            device.disarm();
        }
    }
}
