//! `advee completion SHELL`: what a shell completes, from the command line's own definition.

use super::{Failed, Outcome, command};
use clap_complete::{Shell, generate};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Completion {
    /// Which shell
    #[arg(value_parser = clap::builder::EnumValueParser::<Shell>::new())]
    shell: Shell,
}

const EXAMPLES: &str = "Examples:
  source <(advee completion bash)                              for this shell
  advee completion zsh > ~/.zfunc/_advee                       with ~/.zfunc in fpath
  advee completion fish > ~/.config/fish/completions/advee.fish";

pub fn completion(asked: &Completion) -> Outcome {
    let mut script = Vec::new();
    generate(asked.shell, &mut command(), "advee", &mut script);
    match std::io::stdout().write_all(&script) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failed::from(format!("stdout: {error}"))),
        _ => Ok(ExitCode::SUCCESS),
    }
}
