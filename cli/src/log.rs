//! `advee log …`: logs of runs, as files.

mod cat;
mod cells;
mod csv;
mod decode;
mod diff;
mod export;
mod feed;
mod import;
mod info;
mod keys;
mod mark;
mod play;
mod progress;
mod recover;
mod select;
mod source;

use super::{Common, Outcome};

#[derive(clap::Subcommand)]
pub enum Log {
    /// Show what a log has: times, channels, rates, attachments, marks, damage
    Info(info::Info),
    /// Print messages as JSON lines
    Cat(cat::Cat),
    /// Play a log onto the bus
    #[command(after_help = play::HELP)]
    Play(play::Play),
    /// Write CSV, an official LCM event log, or a part of a log
    Export(export::Export),
    /// Make a log of an official LCM event log
    Import(import::Import),
    /// Give a log that was cut off or damaged an index again
    Recover(recover::Recover),
    /// Compare two logs; exit code 1 when they differ
    Diff(diff::Diff),
    /// Put a mark into the log that is being written
    Mark(mark::Mark),
}

pub fn log(common: &Common, command: &Log) -> Outcome {
    match command {
        Log::Info(command) => info::info(command),
        Log::Cat(command) => cat::cat(command),
        Log::Play(command) => play::play(common, command),
        Log::Export(command) => export::export(command),
        Log::Import(command) => import::import(common, command),
        Log::Recover(command) => recover::recover(command),
        Log::Diff(command) => diff::diff(command),
        Log::Mark(command) => mark::mark(common, command),
    }
}
