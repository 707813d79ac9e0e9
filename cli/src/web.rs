//! `advee web`: the web server by itself, in the foreground; `advee up` has it as a module. `advee web code`: what
//! pairs a device with the servers of this run folder.

use super::{Common, Failed, Outcome, print, qr};
use ::web as server;
use ::web::center::session_store::{self, ShownCodes};
use host::panics;
use module::State;
use robot::topology;
use std::io::IsTerminal;
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
    /// The link of this role as a QR code [default: operator, in a terminal and where other devices reach the server]
    #[arg(long, value_name = "ROLE", value_parser = ["operator", "engineer"], conflicts_with = "json")]
    qr: Option<String>,
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
        code: module::exit::ADDRESS_IN_USE,
        why: format!("{at}: {error}; is the robot's own web server there? --http takes another address"),
    })?;
    panics::end_process(server::NAME);
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
        for line in picture(&server, code.qr.as_deref(), std::io::stdout().is_terminal()) {
            print(line)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Lines that end the answer: what a phone's camera reads. A link with a loopback address leads a phone nowhere.
fn picture(server: &ShownCodes, asked: Option<&str>, terminal: bool) -> Vec<String> {
    let Some(role) = asked.or((terminal && server.is_reachable()).then_some("operator")) else {
        return Vec::new();
    };
    let code = if role == "engineer" { &server.engineer } else { &server.operator };
    let mut lines = vec![format!("\nthe {role}'s link for a phone:")];
    lines.extend(qr::lines(&server.link(code), terminal));
    lines
}

/// The override that makes the server listen there.
pub fn listen(at: SocketAddr) -> String {
    format!("web.listen={:?}", at.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_shows_the_operators_link_where_a_phone_reaches_it_and_else_what_was_asked_for() {
        let server = |address: &str| ShownCodes {
            address: address.into(),
            operator: "12345678".into(),
            engineer: "87654321".into(),
            valid_s: 600,
        };
        let robot = server("192.168.1.7:8080");
        let said = |server: &ShownCodes, asked, terminal| picture(server, asked, terminal).first().cloned();
        assert_eq!(said(&robot, None, true).as_deref(), Some("\nthe operator's link for a phone:"));
        assert_eq!(said(&robot, None, false), None, "a file or a pipe");
        for here in ["127.0.0.1:8080", "[::1]:8080", "0.0.0.0:8080"] {
            assert_eq!(said(&server(here), None, true), None, "{here}");
        }
        assert!(server("robot.local:8080").is_reachable());
        assert_eq!(picture(&robot, None, true)[1..], qr::lines(&robot.link("12345678"), true));
        assert_eq!(picture(&robot, Some("engineer"), false)[1..], qr::lines(&robot.link("87654321"), false));
    }
}
