//! `advee bench …`: what this machine does to the robot's time.

mod beats;
mod bus;
mod histogram;
mod jitter;
mod metronome;
mod rate;
mod report;
#[cfg(test)]
mod tests;

use super::{Common, Outcome, print};
use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Bench {
    #[command(subcommand)]
    what: Option<What>,
}

#[derive(Subcommand)]
enum What {
    /// Latency of this program's loop; evenness of a CAN bus and of the watchdog's heartbeats
    Jitter(jitter::Jitter),
    /// Number of frames a second a CAN bus carries between two interfaces, and whether one is lost
    Can(rate::Can),
}

/// Only for its list.
#[derive(Parser)]
struct Listed {
    #[command(subcommand)]
    _what: What,
}

pub fn bench(common: &Common, command: &Bench) -> Outcome {
    match &command.what {
        Some(What::Jitter(command)) => jitter::jitter(common, command),
        Some(What::Can(command)) => rate::can(common, command),
        None => {
            for what in Listed::command().get_subcommands() {
                print(format_args!("advee bench {:10} {}", what.get_name(), what.get_about().unwrap_or_default()))?;
            }
            Ok(ExitCode::SUCCESS)
        }
    }
}
