//! Files of the kernel: `class/thermal` (Documentation/ABI/testing/sysfs-class-thermal), `class/hwmon`
//! (Documentation/hwmon/sysfs-interface.rst), `thermal_throttle` of x86, `get_throttled` of the Raspberry Pi. Their
//! drivers may be anything: any content is an answer.

use base::thermal::{State, Throttle};
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Folder of thermal zones, below `/sys`.
pub(super) const ZONES: &str = "class/thermal";
/// Folder of hardware monitors.
const MONITORS: &str = "class/hwmon";
/// Folder of the processors.
const PROCESSORS: &str = "devices/system/cpu";
/// Folder of the firmware of a Raspberry Pi.
pub(super) const FIRMWARE: &str = "devices/platform/soc/soc:firmware";
/// Its file: bits as a hexadecimal number.
pub(super) const GET_THROTTLED: &str = "get_throttled";
/// Bits of it that apply now: voltage; frequency capped, throttled, soft limit of temperature.
const UNDER_VOLTAGE: u32 = 1 << 0;
const SLOWED: u32 = 1 << 1 | 1 << 2 | 1 << 3;
/// Maximum size of a file, bytes.
const FILE_MAX: u64 = 256;
/// Maximum number of entries of a folder.
const ENTRIES_MAX: usize = 512;
/// Plausible temperatures, thousandths of a degree.
const RANGE: std::ops::RangeInclusive<i32> = -60_000..=200_000;

/// Reads temperatures again and again.
pub struct Reader {
    folder: PathBuf,
    /// Events of throttling of all x86 packages, as counted at the last reading.
    events: Option<u64>,
}

impl Reader {
    /// `folder`: `/sys`, or another one with its layout.
    #[must_use]
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, events: None }
    }

    /// How often x86 processors slowed down since the start of the computer, as of the last reading; `None`: not
    /// counted.
    #[must_use]
    pub fn events(&self) -> Option<u64> {
        self.events
    }

    /// Reads everything.
    pub fn read(&mut self) -> State {
        let mut state = State::default();
        for zone in entries(&self.folder.join(ZONES), "thermal_zone") {
            if let (Some(name), Some(value)) = (text(&zone.join("type")), number(&zone.join("temp"))) {
                add(&mut state, &name, value);
            }
        }
        for monitor in entries(&self.folder.join(MONITORS), "hwmon") {
            let Some(name) = text(&monitor.join("name")) else { continue };
            for input in entries(&monitor, "temp") {
                let file = input.file_name().and_then(|file| file.to_str()).unwrap_or_default().to_owned();
                let Some(sensor) = file.strip_suffix("_input") else { continue };
                let label = text(&monitor.join(format!("{sensor}_label"))).unwrap_or_else(|| sensor.into());
                if let Some(value) = number(&input) {
                    add(&mut state, &format!("{name}/{label}"), value);
                }
            }
        }
        state.throttle = self.throttle();
        state
    }

    fn throttle(&mut self) -> Option<Throttle> {
        if let Some(bits) = text(&self.folder.join(FIRMWARE).join(GET_THROTTLED)) {
            let bits = u32::from_str_radix(bits.trim_start_matches("0x"), 16).ok()?;
            return Some(Throttle { slowed: bits & SLOWED != 0, under_voltage: bits & UNDER_VOLTAGE != 0 });
        }
        let processors = entries(&self.folder.join(PROCESSORS), "cpu");
        let counts = processors
            .iter()
            .filter_map(|cpu| text(&cpu.join("thermal_throttle/package_throttle_count"))?.parse::<u64>().ok());
        // All processors of a package have the same count.
        let events = counts.max()?;
        let before = self.events.replace(events);
        // What happened before the first reading is not known to last.
        Some(Throttle { slowed: before.is_some_and(|before| events > before), under_voltage: false })
    }
}

/// Adds a temperature; the second one of a name is called `NAME.2`.
fn add(state: &mut State, name: &str, value: i32) {
    let mut again = 1;
    let mut unique = name.to_owned();
    while state.get(&unique).is_some() && again < 100 {
        again += 1;
        unique = format!("{name}.{again}");
    }
    state.push(&unique, value);
}

/// Entries of a folder whose name begins so, by their numbers; empty if there is no such folder.
fn entries(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten().take(ENTRIES_MAX).filter_map(|entry| {
        let name = entry.file_name().to_str()?.to_owned();
        let rest = name.strip_prefix(prefix)?;
        let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
        Some((digits.parse::<u32>().ok()?, name))
    });
    let mut found: Vec<(u32, String)> = found.collect();
    found.sort();
    found.into_iter().map(|(_, name)| folder.join(name)).collect()
}

/// A short file as one line; `None` if it cannot be read, or is empty.
fn text(path: &Path) -> Option<String> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(FILE_MAX).read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8(bytes).ok()?;
    let text = text.trim();
    (!text.is_empty() && !text.contains(char::is_control)).then(|| text.to_owned())
}

fn number(path: &Path) -> Option<i32> {
    text(path)?.parse().ok().filter(|value| RANGE.contains(value))
}
