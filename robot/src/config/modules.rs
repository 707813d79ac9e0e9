//! `modules.toml`: the modules that the watchdog starts, in this order, and how each is treated.

use base::Level;
use drivers::canbus;
use host::limits::Limits;
use settings::{Blank, Choice, Section, Table, settings};
use std::path::PathBuf;
use watchdog::ModuleConfig;

/// The module that only a simulated robot has.
pub const SIMULATOR: &str = "simulator";

/// Levels of texts and reports.
pub(super) const LEVELS: Choice<Level> =
    Choice(&[("debug", Level::Debug), ("info", Level::Info), ("warning", Level::Warning), ("error", Level::Error)]);

settings! {
    /// `modules.toml`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Modules {
        /// Device of the computer's own watchdog, which resets it when a critical module is down for too long
        /// (docs/supervision.md).
        hardware_watchdog: Option<PathBuf> = None, Blank;
        /// It resets when it was not served for this long.
        hardware_watchdog_timeout_s was hardware_watchdog_timeout: u32 = 10, 2..=3600;
        /// Modules in the order in which they are started.
        modules: Vec<ModuleEntry> = [];
    }
    check Modules::check;
}

settings! {
    /// `[[modules]]`: a module.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ModuleEntry {
        guard: ModuleConfig = flat;
        /// Executable to start instead of `advee run NAME`.
        command: Option<String> = None, Blank;
        /// Arguments of `command`, or further ones of `advee run NAME`.
        args: Vec<String> = Vec::<String>::new();
        limits: Limits = flat;
        /// Lowest level of its texts and reports that are printed. Absent: `robot.print_from`.
        print_from: Option<Level> = optional, LEVELS;
        /// Lowest level of its texts and reports that are published on `CM_EVENT_TEXT` and `CM_EVENT_ERROR`. Absent:
        /// `robot.send_from`.
        send_from: Option<Level> = optional, LEVELS;
    }
}

/// The computer's own watchdog, which resets it when the robot's critical modules are not healthy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HardwareWatchdog {
    /// Its device.
    pub path: PathBuf,
    /// It resets when it was not fed for this long, 2..=3600 s.
    pub timeout_s: u32,
}

/// Takes a module off a list; no other waits for it then.
pub(super) fn leave_out(modules: &mut Vec<ModuleEntry>, name: &str) {
    modules.retain(|module| module.name() != name);
    modules.iter_mut().for_each(|module| module.guard.depends.retain(|other| other != name));
}

impl ModuleEntry {
    /// Its name on the bus.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.guard.name
    }
}

impl Modules {
    fn check(&self, table: &Table<'_>) {
        let names: Vec<&str> = self.modules.iter().map(ModuleEntry::name).collect();
        table.unique("modules", "name", &names, "one that no other module has");
        for (n, module) in self.modules.iter().enumerate() {
            // Listed before: so there can be no circle.
            if module.guard.depends.iter().any(|name| !names[..n].contains(&name.as_str())) {
                let expected = format!("modules listed before {}", module.name());
                table.item("modules", n).iter().for_each(|item| item.refuse("depends", &expected));
            }
        }
    }

    /// Takes a module off the list; no other waits for it then.
    pub(super) fn leave_out(&mut self, name: &str) {
        leave_out(&mut self.modules, name);
    }

    /// Adds a module that no other waits for as the last one, unless it is listed already.
    pub(super) fn add(&mut self, name: &str) {
        if self.modules.iter().any(|entry| entry.name() == name) {
            return;
        }
        let simulator = self.modules.iter().find(|entry| entry.name() == SIMULATOR);
        let depends = simulator.map(|entry| entry.name().into()).into_iter().collect();
        let guard = ModuleConfig { name: name.into(), depends, ..ModuleConfig::usual() };
        let (limits, print_from, send_from) = (Limits::usual(), None, None);
        self.modules.push(ModuleEntry { guard, command: None, args: Vec::new(), limits, print_from, send_from });
    }

    /// Adds the bridge as [`Modules::add`] does; where one of its connections is critical, so is the bridge.
    pub(super) fn add_bridge(&mut self, critical: bool) {
        self.add(bridge::NAME);
        let entry = self.modules.iter_mut().find(|entry| entry.name() == bridge::NAME);
        entry.into_iter().for_each(|entry| entry.guard.critical |= critical);
    }

    /// Adds the module `guard` before `driver_canbus`, with the same settings, unless it is listed already.
    pub(super) fn add_guard(&mut self) {
        let place = |name: &str| self.modules.iter().position(|entry| entry.name() == name);
        let (None, Some(n)) = (place(guard::NAME), place(canbus::NAME)) else {
            return;
        };
        let driver = self.modules[n].clone();
        let guard = ModuleConfig { name: guard::NAME.into(), critical: true, ..driver.guard };
        self.modules.insert(n, ModuleEntry { guard, command: None, args: Vec::new(), ..driver });
    }
}
