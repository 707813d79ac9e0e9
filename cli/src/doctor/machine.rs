//! The machine: real-time limits, clock, processors, disk. Checks over given facts, and the code that gathers them.

use super::finding::{Finding, bytes};
use base::thermal::{Reading, State, Throttle};
use host::ports::thermal_read::Reader;
use host::sys::{self, ClockState};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Demands of `modules.toml`, and limits of this user.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealTime {
    /// The highest `rt_priority` of any module.
    pub wanted: Option<u8>,
    /// `RLIMIT_RTPRIO`.
    pub priority: u64,
    /// `RLIMIT_MEMLOCK`, bytes; the largest number: no limit.
    pub locked: u64,
    /// CAP_SYS_NICE and CAP_IPC_LOCK, which lift the limits.
    pub may_nice: bool,
    pub may_lock: bool,
}

impl RealTime {
    pub fn gather(wanted: Option<u8>, capable: impl Fn(u32) -> bool) -> Self {
        const CAP_IPC_LOCK: u32 = 14;
        const CAP_SYS_NICE: u32 = 23;
        #[allow(clippy::unnecessary_cast, reason = "machines of 32 bits have narrower ones")]
        let limit = |resource| match getrlimit(resource) {
            Ok((RLIM_INFINITY, _)) => u64::MAX,
            Ok((soft, _)) => soft as u64,
            Err(_) => 0,
        };
        Self {
            wanted,
            priority: limit(Resource::RLIMIT_RTPRIO),
            locked: limit(Resource::RLIMIT_MEMLOCK),
            may_nice: capable(CAP_SYS_NICE),
            may_lock: capable(CAP_IPC_LOCK),
        }
    }
}

/// Memory that a module in real time locks at most: more than all of them take together.
const LOCKED: u64 = 64 << 20;

pub fn real_time(facts: &RealTime, user: &str) -> Finding {
    const CHECK: &str = "real time";
    let Some(wanted) = facts.wanted else {
        return Finding::ok(CHECK, "no module asks for it (rt_priority in modules.toml)");
    };
    let limits = |line: &str| format!("echo '{user} - {line}' | sudo tee -a /etc/security/limits.d/60-advee.conf");
    if !facts.may_nice && facts.priority < wanted.into() {
        return Finding::fail(CHECK, format!("rt_priority {wanted} is asked for, {user} may {}", facts.priority))
            .why("A module that does not get its processor in time stops the robot. Log in anew after the cure.")
            .cure(limits(&format!("rtprio {wanted}")));
    }
    if !facts.may_lock && facts.locked < LOCKED {
        return Finding::warning(CHECK, format!("{user} may lock {} of memory", bytes(facts.locked)))
            .why("Memory that is swapped out costs a module its deadline. Log in anew after the cure.")
            .cure(limits("memlock unlimited"));
    }
    let locked = if facts.may_lock || facts.locked == u64::MAX { "all".into() } else { bytes(facts.locked) };
    Finding::ok(CHECK, format!("priority {wanted} and {locked} of the memory may be had"))
}

/// State of the kernel's clock.
pub fn clock(state: &Result<ClockState, String>, year: i64) -> Finding {
    const CHECK: &str = "clock";
    /// Before it this program did not exist.
    const BORN: i64 = 2025;
    let sync = "sudo timedatectl set-ntp true";
    match state {
        _ if year < BORN => Finding::warning(CHECK, format!("it is the year {year}"))
            .why("Logs and run folders get wrong dates. Deadlines do not use this clock.")
            .cure(sync),
        Err(error) => Finding::warning(CHECK, format!("cannot be asked: {error}"))
            .why("Whether timestamps agree with those of other computers is not known.")
            .cure("timedatectl"),
        Ok(ClockState { synchronized: false, .. }) => Finding::warning(CHECK, "is not synchronised")
            .why("Timestamps do not agree with other computers', and may jump at the next start. Deadlines are safe.")
            .cure(sync),
        Ok(ClockState { error_us, .. }) => {
            Finding::ok(CHECK, format!("is synchronised to {:.0} ms", *error_us as f64 / 1e3))
        }
    }
}

/// Frequency governors of the processors: the set of all in use, empty without frequency scaling.
pub fn governors(governors: &BTreeSet<String>) -> Finding {
    const CHECK: &str = "processors";
    // `powersave` of intel_pstate scales late; the others stay at the lowest frequency or ramp up over many samples.
    let slow = governors.iter().find(|name| ["powersave", "conservative", "ondemand"].contains(&name.as_str()));
    match (slow, governors.is_empty()) {
        (_, true) => Finding::ok(CHECK, "of a fixed frequency"),
        (Some(slow), _) => Finding::warning(CHECK, format!("governor {slow}"))
            .why("A processor that has slept is slow when a command comes: milliseconds in a loop of 10 ms.")
            .cure("echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"),
        (None, _) => {
            let names: Vec<&str> = governors.iter().map(String::as_str).collect();
            Finding::ok(CHECK, format!("governor {}", names.join(", ")))
        }
    }
}

pub fn gather_governors() -> BTreeSet<String> {
    let cpus = fs::read_dir("/sys/devices/system/cpu").into_iter().flatten().flatten();
    let read = |cpu: fs::DirEntry| fs::read_to_string(cpu.path().join("cpufreq/scaling_governor")).ok();
    cpus.filter_map(read).map(|name| name.trim().to_string()).collect()
}

/// Temperatures of the computer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Heat {
    pub state: State,
    /// How often its processors slowed down since its start, where that is counted.
    pub events: Option<u64>,
}

impl Heat {
    pub fn gather() -> Self {
        let mut reader = Reader::new("/sys".into());
        Self { state: reader.read(), events: reader.events() }
    }
}

/// Temperatures of the computer by the names that `[host]` has for them, and whether it slows itself down.
pub fn temperatures(heat: &Heat) -> Finding {
    const CHECK: &str = "temperatures";
    let Heat { state, events } = heat;
    let Throttle { slowed, under_voltage } = state.throttle.unwrap_or_default();
    let one = |reading: &Reading| format!("{} {:.0} °C", reading.zone, f64::from(reading.millidegrees) / 1e3);
    let mut all: Vec<String> = state.readings().iter().map(one).collect();
    all.extend(events.filter(|events| *events > 0).map(|events| format!("slowed down {events} times since the start")));
    let all = if all.is_empty() { "the kernel shows none".into() } else { all.join(", ") };
    let late = "A computer that slows itself down is late: modules may miss their deadlines, and the robot stops.";
    match (slowed, under_voltage) {
        (_, true) => Finding::warning(CHECK, format!("the supply voltage of the computer is too low; {all}"))
            .why(late)
            .cure("vcgencmd get_throttled"),
        (true, false) => Finding::warning(CHECK, format!("the computer slows itself down; {all}"))
            .why(late)
            .cure("grep . /sys/class/thermal/thermal_zone*/temp"),
        (false, false) => Finding::ok(CHECK, all),
    }
}

/// A folder that is to be written to, or made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder {
    pub path: PathBuf,
    pub writable: bool,
    /// Bytes.
    pub free: u64,
}

impl Folder {
    /// The folder, or the nearest one above that is there.
    pub fn gather(path: &Path) -> Self {
        use nix::sys::statvfs::statvfs;
        use nix::unistd::{AccessFlags, access};
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let there = path.ancestors().find(|there| there.exists()).unwrap_or(Path::new("/"));
        let writable = access(there, AccessFlags::W_OK | AccessFlags::X_OK).is_ok();
        let free =
            statvfs(there).map_or(0, |stat| (stat.blocks_available() as u128 * stat.fragment_size() as u128) as u64);
        Self { path, writable, free }
    }
}

pub fn run_folder(folder: &Folder, user: &str) -> Finding {
    const CHECK: &str = "run folder";
    /// Locks, links and pseudo-terminals are nothing; a module's core file or log is something.
    const NEEDED: u64 = 10 << 20;
    const WANTED: u64 = 200 << 20;
    let path = folder.path.display();
    if !folder.writable {
        return Finding::fail(CHECK, format!("{path} cannot be written to by {user}"))
            .why("A robot holds its run folder and keeps there what its modules share.")
            .cure(format!("sudo install -d -o {user} {path}"));
    }
    let left = |level: fn(&str, String) -> Finding| {
        level(CHECK, format!("{path} has {} left", bytes(folder.free)))
            .why("Recording stops, and a module that cannot write what it must ends.")
            .cure(format!("df -h {path}; sudo du -xh / 2>/dev/null | sort -h | tail"))
    };
    match folder.free {
        ..NEEDED => left(|check, what| Finding::fail(check, what)),
        NEEDED..WANTED => left(|check, what| Finding::warning(check, what)),
        _ => Finding::ok(CHECK, format!("{path}, {} free", bytes(folder.free))),
    }
}

/// The state of the kernel's clock.
pub fn gather_clock() -> Result<ClockState, String> {
    sys::clock_state().map_err(|error| error.to_string())
}
