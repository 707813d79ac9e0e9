//! `advee web`: the web server by itself, in the foreground; `advee up` has it as a module.

use super::{Common, Failed, Outcome};
use crate::topology;
use crate::{live, web as server};
use module::State;
use std::net::{SocketAddr, TcpListener};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Web {
    /// Where it listens [default: web.listen of robot.toml, 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR")]
    http: Option<SocketAddr>,
}

pub fn web(common: &Common, command: &Web) -> Outcome {
    let mut common = common.clone();
    common.sets.extend(command.http.map(listen));
    let (place, robot) = common.robot()?;
    let at = robot.web.listen;
    // As a module it would wait until the address is free.
    TcpListener::bind(at).map_err(|error| Failed {
        code: module::exit::RESOURCE,
        why: format!("{at}: {error}; is the robot's own web server there? --http takes another address"),
    })?;
    let (shell, host) = topology::module(&place, server::NAME, State::Run)?;
    Ok(ExitCode::from(live::run(shell, host)?))
}

/// The override that makes the server listen there.
pub fn listen(at: SocketAddr) -> String {
    format!("web.listen={:?}", at.to_string())
}
