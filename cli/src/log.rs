//! `advee log …`: logs of runs, as files.

mod ahead;
mod cat;
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
mod recording;
mod recover;
mod select;
mod source;
mod texts;

use super::commands::commands;

commands! {
    |common, command|
    pub enum Log {
        /// Show what a log has: times, channels, rates, attachments, marks, damage
        Info(info::Info) => info::info(command),
        /// Print messages as JSON lines, or texts and reports as lines for people
        Cat(cat::Cat) => cat::cat(command),
        /// Play a log onto the bus
        #[command(after_help = play::HELP)]
        Play(play::Play) => play::play(common, command),
        /// Write CSV, an official LCM event log, or a part of a log
        Export(export::Export) => export::export(command),
        /// Make a log of an official LCM event log
        Import(import::Import) => import::import(common, command),
        /// Give a log that was cut off or damaged an index again
        Recover(recover::Recover) => recover::recover(command),
        /// Compare two logs; exit code 1 when they differ
        Diff(diff::Diff) => diff::diff(command),
        /// Put a mark into the log that is being written
        Mark(mark::Mark) => mark::mark(common, command),
        /// Begin a run, with the seconds before the command
        Start(recording::Start) => recording::start(common, command),
        /// End the run
        Stop(recording::Stop) => recording::stop(common, command),
    }
}
