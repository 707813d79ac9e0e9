//! `advee lcm …`: looks at the bus.

mod ear;
mod echo;
mod generate;
mod hub;
mod publish;
pub(crate) mod show;
mod stats;
pub(super) mod table;
pub(super) mod types;

use super::{Common, Outcome};
use table::View;

#[derive(clap::Subcommand)]
pub enum Lcm {
    /// Show the channels: types, rates, gaps, sizes, losses
    List(table::Table),
    /// Print messages as they come, a line each
    Echo(echo::Echo),
    /// Show how often messages come, and how regularly
    Hz(table::Table),
    /// Show how many bytes messages take
    Bw(table::Table),
    /// Publish a message
    #[command(after_help = publish::HELP)]
    Pub(publish::Pub),
    /// Generate Rust from .lcm files
    Gen(generate::Gen),
    /// Relay between programs that reach the bus by tcpq://
    Hub(hub::Hub),
}

pub fn lcm(common: &Common, command: &Lcm) -> Outcome {
    match command {
        Lcm::List(command) => table::table(common, command, View::List),
        Lcm::Echo(command) => echo::echo(common, command),
        Lcm::Hz(command) => table::table(common, command, View::Hz),
        Lcm::Bw(command) => table::table(common, command, View::Bw),
        Lcm::Pub(command) => publish::publish(common, command),
        Lcm::Gen(command) => generate::generate(command),
        Lcm::Hub(command) => hub::hub(command),
    }
}
