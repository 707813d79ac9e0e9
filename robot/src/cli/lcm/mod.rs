//! `advee lcm …`: looks at the bus.

mod echo;

use super::{Common, Outcome};

#[derive(clap::Subcommand)]
pub enum Lcm {
    /// Print messages as they come, a line each
    Echo(echo::Echo),
}

pub fn lcm(common: &Common, command: &Lcm) -> Outcome {
    match command {
        Lcm::Echo(command) => echo::echo(common, command),
    }
}
