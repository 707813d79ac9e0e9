//! `advee bridge key`: keys for connections to the other computers of the robot.

use super::commands::commands;
use super::{Outcome, print};
use ::bridge::key_file;
use std::path::PathBuf;
use std::process::ExitCode;

commands! {
    |_common, command|
    pub enum Bridge {
        /// Write a new random key to a file that only its owner may read
        Key(Key) => key(command),
    }
}

#[derive(clap::Args)]
pub struct Key {
    /// File to make; copy it to the other computer, and name it there and here as key_file
    file: PathBuf,
}

fn key(command: &Key) -> Outcome {
    key_file::create(&command.file)?;
    print(format_args!("{}: a new key, mode 0600", command.file.display()))?;
    Ok(ExitCode::SUCCESS)
}
