//! `advee web`: the web server by itself, in the foreground; `advee up` has it as a module. `advee web code`: what
//! pairs a device with the servers of this run folder.

use super::{Common, Failed, Outcome, print};
use ::web as server;
use ::web::center::session_store;
use module::State;
use robot::topology;
use std::net::{SocketAddr, TcpListener};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Web {
    /// Where it listens [default: web.listen of robot.toml, 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR")]
    http: Option<SocketAddr>,
    #[command(subcommand)]
    asked: Option<Asked>,
}

#[derive(clap::Subcommand)]
enum Asked {
    /// Make codes that pair a phone or another browser with the robot that runs here, for ten minutes
    Code(Code),
}

#[derive(clap::Args)]
struct Code {
    /// A JSON object for each server
    #[arg(long)]
    json: bool,
}

pub fn web(common: &Common, command: &Web) -> Outcome {
    if let Some(Asked::Code(code)) = &command.asked {
        return show(common, code);
    }
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
    Ok(ExitCode::from(host::run(shell, host)?))
}

fn show(common: &Common, code: &Code) -> Outcome {
    let shown = session_store::ask(&common.run_dir())?;
    if shown.is_empty() {
        let folder = common.run_dir();
        return Err(format!("no web server of {} makes codes for you; is advee up?", folder.display()).into());
    }
    for server in shown {
        if code.json {
            print(serde_json::to_string(&server).map_err(|error| error.to_string())?)?;
            continue;
        }
        let (operator, engineer) = (session_store::spaced(&server.operator), session_store::spaced(&server.engineer));
        print(format_args!("operator  {operator}   {}", server.link(&server.operator)))?;
        print(format_args!("engineer  {engineer}   {}", server.link(&server.engineer)))?;
        print(format_args!("each pairs one device within {} minutes", server.valid_s.div_ceil(60)))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The override that makes the server listen there.
pub fn listen(at: SocketAddr) -> String {
    format!("web.listen={:?}", at.to_string())
}
