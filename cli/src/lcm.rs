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

use super::commands::commands;
use table::View;

commands! {
    |common, command|
    pub enum Lcm {
        /// Show the channels: types, rates, gaps, sizes, losses
        List(table::Table) => table::table(common, command, View::List),
        /// Print messages as they come, a line each
        Echo(echo::Echo) => echo::echo(common, command),
        /// Show how often messages come, and how regularly
        Hz(table::Table) => table::table(common, command, View::Hz),
        /// Show how many bytes messages take
        Bw(table::Table) => table::table(common, command, View::Bw),
        /// Publish a message
        #[command(after_help = publish::HELP)]
        Pub(publish::Pub) => publish::publish(common, command),
        /// Generate Rust from .lcm files
        Gen(generate::Gen) => generate::generate(command),
        /// Relay between programs that reach the bus by tcpq://
        Hub(hub::Hub) => hub::hub(command),
    }
}
