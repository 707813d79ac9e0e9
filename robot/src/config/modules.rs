//! `modules.toml`: the modules that the watchdog starts, in this order, and how each is treated.

use base::Level;
use settings::Table;
use std::path::PathBuf;

/// One `[[modules]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ModuleEntry {
    /// Its name on the bus.
    pub name: String,
    /// Its executable; none: `advee run NAME`.
    pub command: Option<String>,
    /// Arguments of `command`, or further ones of `advee run NAME`.
    pub args: Vec<String>,
    /// Modules that must have come up before.
    pub depends: Vec<String>,
    /// Silence of its beat that counts as a hang, 0.02..=60 s; default 0.2.
    pub beat_timeout_s: f64,
    /// `SCHED_FIFO` priority, 1..=98; none: the normal scheduler.
    pub rt_priority: Option<u8>,
    /// Processors it may use; empty: all.
    pub cpus: Vec<u16>,
    /// -20..=19; default 0.
    pub nice: i8,
    /// Bytes, from 1 MiB; none: no limit.
    pub memory_max: Option<u64>,
    /// Cores, 0.01..=64; none: no limit.
    pub cpu_max: Option<f64>,
    /// Whether it is started again when it ends unasked; default true.
    pub restart: bool,
    /// Whether the robot must not move without it; default false.
    pub critical: bool,
    /// Lowest level of its texts and reports that are printed; none: `robot.print_from`.
    pub print_from: Option<Level>,
    /// Lowest level of its texts and reports that are sent; none: `robot.send_from`.
    pub send_from: Option<Level>,
}

/// The computer's own watchdog, which resets it when the robot's critical modules are not healthy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HardwareWatchdog {
    /// Its device.
    pub path: PathBuf,
    /// It resets when it was not fed for this long, 2..=3600 s; default 10.
    pub timeout_s: u32,
}

/// The module that only a simulated robot has.
pub const SIMULATOR: &str = "simulator";

/// Reads the list; `sim` tells whether the simulator is part of it.
pub(super) fn read(mut root: Table<'_>, sim: bool) -> (Vec<ModuleEntry>, Option<HardwareWatchdog>) {
    let path = root.text("hardware_watchdog", Some(""));
    let timeout_s = root.integer("hardware_watchdog_timeout", Some(10), 2..=3600);
    let hardware_watchdog = (!path.is_empty()).then(|| HardwareWatchdog { path: path.into(), timeout_s });
    let items: Vec<_> = root.tables("modules");
    let mut modules: Vec<ModuleEntry> = Vec::new();
    for mut item in items {
        let mut module = ModuleEntry::read(&mut item);
        if modules.iter().any(|other| other.name == module.name) {
            item.refuse("name", "one that no other module has");
        }
        // Listed before: so there can be no circle.
        let unknown = |name: &String| !modules.iter().any(|other| other.name == *name);
        if module.depends.iter().any(unknown) {
            item.refuse("depends", format_args!("modules listed before {}", module.name));
        }
        item.end();
        if !sim {
            module.depends.retain(|name| name != SIMULATOR);
        }
        modules.push(module);
    }
    root.end();
    modules.retain(|module| sim || module.name != SIMULATOR);
    (modules, hardware_watchdog)
}

impl ModuleEntry {
    fn read(table: &mut Table<'_>) -> Self {
        let none_if_zero = |value: f64| (value > 0.0).then_some(value);
        let name = table.text("name", None);
        if !name.is_empty() && !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') {
            table.refuse("name", "letters, digits, _ and -");
        }
        Self {
            name,
            command: Some(table.text("command", Some(""))).filter(|command| !command.is_empty()),
            args: table.texts("args"),
            depends: table.texts("depends"),
            beat_timeout_s: table.number("beat_timeout", Some(0.2), 0.02..=60.0),
            rt_priority: Some(table.integer("rt_priority", Some(0), 0..=98)).filter(|priority| *priority > 0),
            cpus: table.integers("cpus", 0..=1023),
            nice: table.integer("nice", Some(0), -20..=19),
            memory_max: none_if_zero(table.number("memory_max", Some(0.0), 0.0..=1e15)).map(|bytes| bytes as u64),
            cpu_max: none_if_zero(table.number("cpu_max", Some(0.0), 0.0..=64.0)),
            restart: table.choice("restart", Some(true), &[("always", true), ("never", false)]),
            critical: table.boolean("critical", false),
            print_from: level(table, "print_from"),
            send_from: level(table, "send_from"),
        }
    }
}

/// Reads a level by name; none if the key is absent.
pub(super) fn level(table: &mut Table<'_>, key: &'static str) -> Option<Level> {
    let levels = [
        ("debug", Some(Level::Debug)),
        ("info", Some(Level::Info)),
        ("warning", Some(Level::Warning)),
        ("error", Some(Level::Error)),
    ];
    table.choice(key, Some(None), &levels)
}
