//! `advee run MODULE`: one module in the foreground; what the watchdog executes.

use super::{Common, Outcome};
use host::log::Log;
use host::log_repair;
use host::panics;
use host::ports::PortConfig;
use host::processes;
use module::State;
use robot::place::RobotLocation;
use robot::topology;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Run {
    /// Which module
    pub(super) module: String,
    /// State after INIT: RUN, PAUSE or STOP
    #[arg(long, value_name = "STATE", default_value = "RUN", value_parser = first_state)]
    state: State,
    /// The simulated robot
    #[arg(long)]
    sim: bool,
    /// The simulated world: a file, also a map in YAML, or a name in conf/worlds
    #[arg(long, value_name = "FILE", requires = "sim")]
    world: Option<PathBuf>,
}

fn first_state(text: &str) -> Result<State, String> {
    let state = State::from_name(text).filter(|state| matches!(state, State::Run | State::Pause | State::Stop));
    state.ok_or_else(|| "expected RUN, PAUSE or STOP".into())
}

impl Run {
    /// The robot that the module is of.
    pub fn place(&self, common: &Common) -> RobotLocation {
        RobotLocation { world: self.world.clone(), ..common.place(self.sim) }
    }
}

pub fn run(common: &Common, command: &Run) -> Outcome {
    panics::end_process(&command.module);
    // In a running robot the watchdog publishes the notices, once for all modules.
    if command.module != watchdog::NAME && std::env::var_os(processes::VARIABLE).is_none() {
        common.load(command.sim)?;
    }
    let (shell, host) = topology::module(&command.place(common), &command.module, command.state)?;
    for port in &host.ports {
        if let PortConfig::Store { folder } = port {
            log_repair::start(folder.clone(), Log::new(&command.module));
        }
    }
    Ok(ExitCode::from(host::run(shell, host)?))
}
