//! `advee can nmt`: sends a command to one node or to all, and prints the resulting states.

use super::decode::{command_name, state_name};
use super::link::{Heard, Link};
use super::target::{Target, Where};
use crate::{Common, Failed, Outcome, print};
use base::Duration;
use canopen::wire::{self, Service, decode_heartbeat};
use canopen::{NmtCommand, NmtState};
use clap::ValueEnum;
use host::clock;
use serde_json::json;
use std::collections::BTreeMap;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Nmt {
    /// Command
    #[arg(value_enum)]
    command: Word,
    /// Node, by its id or the name of its axis, or all
    node: String,
    #[command(flatten)]
    place: Where,
    /// Print JSON lines: one for each node received
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Word {
    /// To operational: PDOs flow
    Start,
    /// To stopped: NMT and heartbeats only
    Stop,
    /// To pre-operational: no PDOs
    Preop,
    /// Everything to power-on values
    Reset,
    /// Communication parameters to power-on values
    ResetComm,
}

impl Word {
    /// The command, and the state that shows it; a node that resets shows its boot-up message.
    const fn meant(self) -> (NmtCommand, NmtState) {
        match self {
            Self::Start => (NmtCommand::Start, NmtState::Operational),
            Self::Stop => (NmtCommand::Stop, NmtState::Stopped),
            Self::Preop => (NmtCommand::EnterPreOperational, NmtState::PreOperational),
            Self::Reset => (NmtCommand::ResetNode, NmtState::Initialising),
            Self::ResetComm => (NmtCommand::ResetCommunication, NmtState::Initialising),
        }
    }
}

/// Nodes show what they did within this time: heartbeats come each second or faster.
const WITHIN: Duration = Duration::from_secs(2);

pub fn nmt(common: &Common, command: &Nmt) -> Outcome {
    let target = command.place.find(common)?;
    let node = match command.node.as_str() {
        "all" => None,
        node => Some(target.node(node)?),
    };
    target.refuse_held("it starts and stops these nodes, and a drive in motion is no place for two masters")?;
    let (nmt, wanted) = command.command.meant();
    let mut link = Link::open(&target)?;
    link.send(clock::now(), wire::nmt(nmt, node.unwrap_or(0)))?;
    let Seen { states: seen, booted } = listen(&mut link, &target, node, wanted)?;
    for (node, state) in &seen {
        let name = if *state == NmtState::Initialising { "has booted" } else { state_name(*state) };
        match command.json {
            true => print(json!({
                "bus": target.name, "node": node, "name": target.name_of(*node), "command": command_name(nmt),
                "state": state_name(*state), "done": *state == wanted,
            }))?,
            false => print(format!("{}: {name}", target.text(*node)))?,
        }
    }
    // A node that got another id (LSS) boots with it. Only a reset shows that.
    if let (Some(old), true, [new]) = (node, seen.is_empty(), &booted[..]) {
        match command.json {
            true => print(json!({
                "bus": target.name, "node": new, "name": target.name_of(*new), "command": command_name(nmt),
                "state": state_name(wanted), "done": true, "was": old,
            }))?,
            false => print(format!("{}: has booted; it was node {old} until now", target.text(*new)))?,
        }
        return Ok(ExitCode::SUCCESS);
    }
    let whom = node.map_or("nobody".into(), |node| target.text(node));
    if seen.is_empty() {
        let silent = if node.is_some() { format!("{whom} was not heard") } else { "nobody was heard".into() };
        let why = "no node there, or its heartbeat is off (0x1017 is 0), so that what it did cannot be seen";
        return Err(format!("{silent} within {} s: {why}", WITHIN.as_secs()).into());
    }
    let others: Vec<String> =
        seen.iter().filter(|(_, state)| **state != wanted).map(|(node, _)| target.text(*node)).collect();
    if others.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    Err(format!("{} did not obey within {} s", others.join(", "), WITHIN.as_secs()).into())
}

/// What was received.
#[derive(Default)]
struct Seen {
    /// Newest state of each addressed node.
    states: BTreeMap<u8, NmtState>,
    /// Nodes that were not addressed and have booted.
    booted: Vec<u8>,
}

/// Newest state of each node, when all addressed nodes have reached the wanted one, or time is over.
fn listen(link: &mut Link, target: &Target, node: Option<u8>, wanted: NmtState) -> Result<Seen, Failed> {
    let until = clock::now() + WITHIN;
    let mut seen = Seen::default();
    loop {
        let now = clock::now();
        link.flush(now)?;
        match link.receive(now)? {
            Heard::Frame { frame, .. } => {
                if let (Some(Service::ErrorControl { node: from }), Some(state)) =
                    (Service::of(&frame), decode_heartbeat(frame.data()))
                {
                    let addressed = node.is_none_or(|node| node == from);
                    // A boot-up stays recorded: pre-operational follows it.
                    if addressed && seen.states.get(&from) != Some(&wanted) {
                        seen.states.insert(from, state);
                    } else if !addressed && state == NmtState::Initialising && !seen.booted.contains(&from) {
                        seen.booted.push(from);
                    }
                }
            }
            Heard::Note(note) => link.tell(&note),
            Heard::Notice(_) => {}
            Heard::Nothing => {
                let of = |node: u8| seen.states.get(&node) == Some(&wanted);
                let all = match node {
                    Some(node) => of(node),
                    None => !target.known.is_empty() && target.known.iter().all(|known| of(known.id)),
                };
                if all || now >= until || link.wait(until)? {
                    return Ok(seen);
                }
            }
        }
    }
}
