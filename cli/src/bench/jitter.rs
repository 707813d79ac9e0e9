//! `advee bench jitter`: three measurements, one at a time, explained in `docs/real-time.md`.

use super::metronome::{self, Plan};
use super::{beats, bus};
use crate::progress::Beside;
use crate::{Common, Failed, Outcome, seconds};
use base::Duration;
use host::ports::settings::CanInterface;
use host::sys;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Jitter {
    /// From one wake-up to the next, us
    #[arg(long, value_name = "US", default_value = "1000", value_parser = clap::value_parser!(u64).range(100..=10_000_000))]
    interval: u64,
    /// SCHED_FIFO priority, with locked memory, as `rt_priority` in modules.toml [default: the normal scheduler]
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: Option<u8>,
    /// Evenness of frames on a CAN bus, by the kernel's receive times: can0, udp:GROUP or slcan:DEVICE
    #[arg(long, value_name = "IFACE", value_parser = interface, conflicts_with_all = ["interval", "priority", "beats"])]
    can: Option<CanInterface>,
    /// Only frames of this identifier; may be repeated [default: SYNC and heartbeats]
    #[arg(long, value_name = "ID", value_parser = identifier, requires = "can")]
    id: Vec<u16>,
    /// Evenness of the heartbeats of the running robot's modules
    #[arg(long, conflicts_with = "interval")]
    beats: bool,
    /// Duration, s; without it until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Add the full histogram
    #[arg(long)]
    histogram: bool,
}

pub fn interface(text: &str) -> Result<CanInterface, String> {
    CanInterface::parse(text).ok_or_else(|| "expected can0, slcan:/DEVICE or udp:GROUP:PORT".into())
}

/// A short identifier, decimal or 0x….
fn identifier(text: &str) -> Result<u16, String> {
    let id = match text.strip_prefix("0x") {
        Some(hex) => u16::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    };
    id.filter(|id| *id <= 0x7FF).ok_or_else(|| "expected an identifier up to 0x7ff".into())
}

pub fn jitter(common: &Common, command: &Jitter) -> Outcome {
    let progress = Beside::new("measuring", command.time);
    let report = match &command.can {
        Some(interface) => bus::measure(common, interface, &command.id, command.time)?,
        None => {
            take_priority(command.priority)?;
            match command.beats {
                true => beats::measure(&common.run_dir(), command.time)?,
                false => {
                    let interval = Duration::from_micros(command.interval);
                    let plan = Plan { interval, priority: command.priority, time: command.time };
                    metronome::measure(plan)?
                }
            }
        }
    };
    drop(progress);
    report.print(command.json, command.histogram)?;
    Ok(ExitCode::SUCCESS)
}

fn take_priority(priority: Option<u8>) -> Result<(), Failed> {
    let Some(priority) = priority else { return Ok(()) };
    sys::set_fifo(priority, false).map_err(|error| {
        format!("SCHED_FIFO {priority} is refused: {error}; the limit is that of `ulimit -r`, see advee doctor").into()
    })
}
