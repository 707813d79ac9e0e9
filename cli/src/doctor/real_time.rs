//! Further conditions for a module to get its processor in time: kernel, throttling, sleep states, interrupts, and
//! buffering of bytes and frames. docs/real-time.md has the settings with their reasons.
//!
//! Where a module has an `rt_priority` a finding is a warning, else a remark.

use super::finding::Finding;
use host::ports::settings::CanInterface;
use robot::config::{Robot, Rs485Bus};
use std::fs;
use std::path::{Path, PathBuf};

/// A warning where real time is wanted; else a note.
fn told(wanted: Option<u8>, check: &str, what: String, why: &str, cure: String) -> Finding {
    match wanted {
        Some(_) => Finding::warning(check, what).why(why).cure(cure),
        None => Finding::ok(check, what),
    }
}

/// True if the kernel can be interrupted nearly everywhere (`CONFIG_PREEMPT_RT`).
pub fn kernel(wanted: Option<u8>, release: &str, preempt_rt: bool, architecture: &str) -> Finding {
    const CHECK: &str = "kernel";
    if preempt_rt {
        return Finding::ok(CHECK, format!("{release}, PREEMPT_RT"));
    }
    // As Debian names it.
    let package = match architecture {
        "x86_64" => "linux-image-rt-amd64",
        "aarch64" => "linux-image-rt-arm64",
        "arm" => "linux-image-rt-armmp",
        _ => "linux-image-rt",
    };
    let why = "What the kernel does for others may keep a module waiting for milliseconds, whatever its priority.";
    let cure = format!("sudo apt-get install {package} && sudo reboot");
    told(wanted, CHECK, format!("{release}, not PREEMPT_RT"), why, cure)
}

/// Part of each period that real-time threads may run, µs; a negative value: all of it. `None`: not reported by this
/// kernel.
pub fn throttling(wanted: Option<u8>, runtime_us: Option<i64>, period_us: i64) -> Finding {
    const CHECK: &str = "throttling";
    /// Less of it than this, in hundredths, is not Linux's own setting.
    const USUAL: i64 = 95;
    match runtime_us {
        None => Finding::ok(CHECK, "this kernel does not say"),
        Some(..0) => Finding::ok(CHECK, "none: a module that spins in real time is the watchdog's to end"),
        Some(runtime) if runtime * 100 >= period_us * USUAL => {
            Finding::ok(CHECK, format!("real-time threads rest after {runtime} of each {period_us} us"))
        }
        Some(runtime) => told(
            wanted,
            CHECK,
            format!("real-time threads may run {runtime} of each {period_us} us"),
            "After that they stand still for the rest of the period, however urgent they are.",
            "sudo sysctl kernel.sched_rt_runtime_us=950000 kernel.sched_rt_period_us=1000000".into(),
        ),
    }
}

/// Exit latency of the deepest sleep state, µs; `None` without sleep states.
pub fn sleep(wanted: Option<u8>, deepest_us: Option<u64>) -> Finding {
    const CHECK: &str = "sleep";
    /// Order of magnitude of a wake-up.
    const LONG: u64 = 100;
    match deepest_us {
        None => Finding::ok(CHECK, "processors do not sleep in steps here"),
        Some(us @ ..=LONG) => Finding::ok(CHECK, format!("processors wake up within {us} us")),
        Some(us) => told(
            wanted,
            CHECK,
            format!("processors may sleep so deep that waking takes {us} us"),
            "It comes on top of every wake-up of a robot that stands idle.",
            format!("sudo cpupower idle-set -D {LONG}   # from the linux-cpupower package; until the next start"),
        ),
    }
}

/// The time, ms, for which an FTDI adapter collects bytes before it hands them on; none for other adapters.
pub fn latency_timer(wanted: Option<u8>, bus: &Rs485Bus, device: &str, timer_ms: Option<u64>) -> Option<Finding> {
    let check = format!("rs485.{}", bus.name);
    Some(match timer_ms? {
        ms @ ..=1 => Finding::ok(check, format!("{device} hands bytes on after {ms} ms")),
        ms if bus.line.low_latency => {
            Finding::ok(check, format!("{device} collects bytes for {ms} ms until its module opens it (low_latency)"))
        }
        ms => told(
            wanted,
            &check,
            format!("{device} collects bytes for {ms} ms"),
            "Each answer of a board comes later by up to that: at 38400 Bd longer than the answer itself.",
            format!(
                "echo 1 | sudo tee /sys/bus/usb-serial/devices/{device}/latency_timer   # or low_latency = true in [{check}]"
            ),
        ),
    })
}

/// Number of frames that may wait in the queue of a CAN interface before one of ours.
pub fn transmit_queue(
    wanted: Option<u8>,
    bus: &str,
    interface: &str,
    frames: Option<u64>,
    bitrate: u32,
) -> Option<Finding> {
    /// Frames of eight bytes with all their stuff bits take no more.
    const FRAME_BITS: u64 = 135;
    /// Same limit as in the port's own warning.
    const LONG: u64 = 100;
    let check = format!("can.{bus}");
    Some(match frames? {
        frames @ ..=LONG => Finding::ok(check, format!("{frames} frames fit into the queue of {interface}")),
        frames => {
            let ms = frames * FRAME_BITS * 1000 / u64::from(bitrate.max(1));
            told(
                wanted,
                &check,
                format!("{frames} frames may wait in the queue of {interface}: {ms} ms"),
                "A quick stop leaves behind what any other program has put there.",
                format!("sudo ip link set {interface} txqueuelen 10"),
            )
        }
    })
}

/// The thread that serves the interrupt of a bus, on a kernel that has such.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interrupt {
    /// `can.main`.
    pub bus: String,
    /// `irq/17-can0`.
    pub thread: String,
    /// Process id.
    pub pid: u32,
    /// Its `SCHED_FIFO` priority; 0: the normal scheduler.
    pub priority: u8,
}

/// True if what brings a module its input is served before the module.
pub fn interrupt(wanted: Option<u8>, interrupt: &Interrupt) -> Finding {
    let Interrupt { bus, thread, pid, priority } = interrupt;
    let what = format!("{thread} has priority {priority}");
    match wanted {
        Some(wanted) if *priority <= wanted => Finding::warning(bus, format!("{what}, modules up to {wanted}"))
            .why("A module that computes keeps the input of this bus waiting, its own and that of others.")
            .cure(format!("sudo chrt -f -p {} {pid}   # until the next start", wanted.saturating_add(1).min(99))),
        _ => Finding::ok(bus, what),
    }
}

/// All checks of this machine.
pub fn check(wanted: Option<u8>, robot: Option<&Robot>) -> Vec<Finding> {
    let read = |path: &str| fs::read_to_string(path).ok();
    let number = |path: &str| read(path)?.trim().parse::<i64>().ok();
    let release = read("/proc/sys/kernel/osrelease").unwrap_or_default();
    let preempt_rt = number("/sys/kernel/realtime") == Some(1);
    let period = number("/proc/sys/kernel/sched_rt_period_us").unwrap_or(1_000_000);
    let mut findings = vec![
        kernel(wanted, release.trim(), preempt_rt, std::env::consts::ARCH),
        throttling(wanted, number("/proc/sys/kernel/sched_rt_runtime_us"), period),
        sleep(wanted, gather_sleep(Path::new("/sys/devices/system/cpu"))),
    ];
    let Some(robot) = robot else { return findings };
    let threads = gather_threads(Path::new("/proc"));
    let served = |bus: String, device: &Path| {
        let number = gather_interrupt(device)?;
        let of_it = |(_, name, _): &&(u32, String, u8)| name.starts_with(&format!("irq/{number}-"));
        let (pid, thread, priority) = threads.iter().find(of_it)?.clone();
        Some(interrupt(wanted, &Interrupt { bus, thread, pid, priority }))
    };
    for bus in &robot.can {
        let CanInterface::Socket(name) = &bus.port.interface else { continue };
        let class = PathBuf::from(format!("/sys/class/net/{name}"));
        let queue = fs::read_to_string(class.join("tx_queue_len")).ok().and_then(|text| text.trim().parse().ok());
        findings.extend(transmit_queue(wanted, &bus.name, name, queue, bus.driver.bitrate));
        findings.extend(served(format!("can.{}", bus.name), &class.join("device")));
    }
    for bus in robot.rs485.iter().filter(|bus| bus.line.port.is_absolute()) {
        let path = fs::canonicalize(&bus.line.port).unwrap_or_default();
        let Some(device) = path.file_name().and_then(|name| name.to_str()) else { continue };
        let timer = read(&format!("/sys/bus/usb-serial/devices/{device}/latency_timer"));
        let timer = timer.and_then(|text| text.trim().parse().ok());
        findings.extend(latency_timer(wanted, bus, device, timer));
        let class = PathBuf::from(format!("/sys/class/tty/{device}/device"));
        findings.extend(served(format!("rs485.{}", bus.name), &class));
    }
    findings
}

/// The longest time to wake up from any state of sleep that is not disabled, µs.
pub fn gather_sleep(cpus: &Path) -> Option<u64> {
    let states = |cpu: fs::DirEntry| fs::read_dir(cpu.path().join("cpuidle")).into_iter().flatten().flatten();
    let latency = |state: fs::DirEntry| {
        let number = |file: &str| fs::read_to_string(state.path().join(file)).ok()?.trim().parse::<u64>().ok();
        (number("disable") != Some(1)).then(|| number("latency")).flatten()
    };
    fs::read_dir(cpus).into_iter().flatten().flatten().flat_map(states).filter_map(latency).max()
}

/// Threads of interrupts: process id, name, real-time priority.
pub fn gather_threads(proc: &Path) -> Vec<(u32, String, u8)> {
    let thread = |entry: fs::DirEntry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
        // pid (name) state …; the 40th field is the priority (proc(5)). A name may have spaces and brackets.
        let (head, fields) = stat.rsplit_once(") ")?;
        let name = head.split_once('(')?.1;
        let priority = fields.split(' ').nth(40 - 3)?.parse().ok()?;
        name.starts_with("irq/").then(|| (pid, name.to_string(), priority))
    };
    fs::read_dir(proc).into_iter().flatten().flatten().filter_map(thread).collect()
}

/// The number of the interrupt that a device, or the nearest above it, has.
pub fn gather_interrupt(device: &Path) -> Option<u32> {
    let device = fs::canonicalize(device).ok()?;
    let number = |folder: &Path| fs::read_to_string(folder.join("irq")).ok()?.trim().parse().ok();
    device.ancestors().find_map(|folder| number(folder).filter(|number| *number > 0))
}
