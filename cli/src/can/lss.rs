//! `advee can lss`: nodes without node id are found and given one, and bit rates are changed (CiA 305).

use super::link::{Heard, Link};
use super::target::{Target, Where};
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, complain, print};
use base::{Duration, Instant};
use canopen::NmtState;
use canopen::lss::{Address, BitRate, Command, Event, Failure, Master, Mode, Refusal, Timing, UNCONFIGURED};
use canopen::wire::{Service, decode_heartbeat};
use clap::Subcommand;
use host::clock;
use serde_json::{Value, json};
use std::process::ExitCode;

#[derive(Subcommand)]
pub enum Lss {
    /// Find all nodes without node id
    Scan(Plain),
    /// Find the node without node id that has the lowest address
    Find(Plain),
    /// Read address and node id of a node
    Inquire(Chosen),
    /// Give a node its id: in use when it boots next, which one without node id does at once
    SetNodeId(SetNodeId),
    /// Give a node its bit rate: in use after activate or, when stored, after power-on
    SetBitrate(SetBitrate),
    /// Store node id and bit rate permanently
    Store(Chosen),
    /// Let all nodes change to the bit rate that they were given
    Activate(Activate),
}

#[derive(clap::Args)]
pub struct Plain {
    #[command(flatten)]
    place: Where,
    /// JSON lines
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub struct Chosen {
    #[command(flatten)]
    who: Who,
    #[command(flatten)]
    plain: Plain,
}

/// Which node is meant.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
pub struct Who {
    /// Node with this address: VENDOR:PRODUCT:REVISION:SERIAL in hexadecimal, as printed by scan
    #[arg(long, value_name = "ADDRESS", value_parser = address)]
    slave: Option<Address>,
    /// The one that find would find
    #[arg(long)]
    first: bool,
    /// The only node on the bus
    #[arg(long)]
    alone: bool,
}

#[derive(clap::Args)]
pub struct SetNodeId {
    /// 1 to 127, or none
    #[arg(value_parser = node_id)]
    id: u8,
    /// And store it
    #[arg(long)]
    store: bool,
    #[command(flatten)]
    chosen: Chosen,
}

#[derive(clap::Args)]
pub struct SetBitrate {
    /// kbit/s: 1000, 800, 500, 250, 125, 50, 20 or 10, or auto
    #[arg(value_parser = bit_rate)]
    rate: BitRate,
    /// And store it
    #[arg(long)]
    store: bool,
    #[command(flatten)]
    chosen: Chosen,
}

#[derive(clap::Args)]
pub struct Activate {
    /// Silence before and after the change, ms
    #[arg(value_name = "MS", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    delay: u16,
    #[command(flatten)]
    plain: Plain,
}

fn address(text: &str) -> Result<Address, String> {
    let word = |word: &str| u32::from_str_radix(word.strip_prefix("0x").unwrap_or(word), 16).ok();
    let words: Option<Vec<u32>> = text.split(':').map(word).collect();
    let words: Option<[u32; 4]> = words.and_then(|words| words.try_into().ok());
    words.map(Address::from_words).ok_or_else(|| "expected VENDOR:PRODUCT:REVISION:SERIAL in hexadecimal".into())
}

fn node_id(text: &str) -> Result<u8, String> {
    let id = if text == "none" { Some(UNCONFIGURED) } else { text.parse().ok().filter(|id| (1..=127).contains(id)) };
    id.ok_or_else(|| "expected 1 to 127, or none".into())
}

fn bit_rate(text: &str) -> Result<BitRate, String> {
    let rate = if text == "auto" { Some(BitRate::Auto) } else { text.parse().ok().and_then(BitRate::from_kbits) };
    rate.ok_or_else(|| "expected 1000, 800, 500, 250, 125, 50, 20, 10 or auto".into())
}

impl Who {
    fn command(&self) -> Command {
        match self.slave {
            Some(address) => Command::Select(address),
            None if self.first => Command::Find,
            None => Command::SwitchGlobal(Mode::Configuration),
        }
    }
}

const WAITING: Command = Command::SwitchGlobal(Mode::Waiting);
/// A node that got its first id boots within this time.
const BOOT: Duration = Duration::from_secs(2);

pub fn lss(common: &Common, command: &Lss) -> Outcome {
    let store = |store: &bool| store.then_some(Command::Store);
    let (plain, commands): (&Plain, Vec<Command>) = match command {
        Lss::Scan(plain) => (plain, vec![Command::FindAll]),
        Lss::Find(plain) => (plain, vec![Command::Find, Command::InquireNodeId, WAITING]),
        Lss::Inquire(Chosen { who, plain }) => {
            (plain, vec![who.command(), Command::InquireAddress, Command::InquireNodeId, WAITING])
        }
        Lss::Store(Chosen { who, plain }) => (plain, vec![who.command(), Command::Store, WAITING]),
        Lss::SetNodeId(set) => {
            let who = [set.chosen.who.command(), Command::InquireNodeId, Command::SetNodeId(set.id)];
            let commands = who.map(Some).into_iter().chain([store(&set.store)]);
            (&set.chosen.plain, commands.into_iter().flatten().chain([WAITING]).collect())
        }
        Lss::SetBitrate(set) => {
            let commands = [Some(set.chosen.who.command()), Some(Command::SetBitRate(set.rate)), store(&set.store)];
            (&set.chosen.plain, commands.into_iter().flatten().chain([WAITING]).collect())
        }
        Lss::Activate(activate) => {
            let activated = Command::Activate { delay_ms: activate.delay };
            (&activate.plain, vec![Command::SwitchGlobal(Mode::Configuration), activated])
        }
    };
    let target = plain.place.find(common)?;
    target.refuse_held("it is its bus's only master")?;
    let mut dialogue = Dialogue {
        link: Link::open(&target)?,
        master: Master::new(Timing::default()),
        found: 0,
        sets: matches!(command, Lss::SetNodeId(_)),
        old: None,
        booted: Vec::new(),
        progress: Progress::new("searching"),
        scanned: 0.0,
    };
    let mut failed = None;
    for command in commands {
        // On any failure all nodes return to the waiting state.
        if failed.is_some() && command != WAITING {
            continue;
        }
        // Which id a node had before is only for the hint.
        let asks = dialogue.sets && command == Command::InquireNodeId;
        if let Err(why) = dialogue.run(&target, plain.json, command)?
            && !asks
        {
            failed = failed.or(Some(why));
        }
    }
    if let Some(why) = failed {
        return Err(format!("{}: {why}", target.name).into());
    }
    match command {
        Lss::Scan(_) if !plain.json => {
            let s = if dialogue.found == 1 { "" } else { "s" };
            print(format!("{} node{s} without node id on {}", dialogue.found, target.name))?;
        }
        Lss::SetNodeId(set) if set.id != UNCONFIGURED => dialogue.boot(&target, plain.json, set.id)?,
        _ => {}
    }
    Ok(ExitCode::SUCCESS)
}

/// A master on the bus.
struct Dialogue {
    link: Link,
    master: Master,
    found: usize,
    /// A node id is set.
    sets: bool,
    /// The id that the node had before, if it had one; absent if not known.
    old: Option<Option<u8>>,
    /// Nodes that have booted since.
    booted: Vec<u8>,
    progress: Progress,
    /// How far the search was when it was last shown, 0 to 1.
    scanned: f64,
}

impl Dialogue {
    /// Runs a command to its end: why it failed, if it did.
    fn run(&mut self, target: &Target, as_json: bool, command: Command) -> Result<Result<(), String>, Failed> {
        if let Err(error) = self.master.start(clock::now(), command) {
            return Ok(Err(format!("{error:?}")));
        }
        loop {
            let now = clock::now();
            while let Some(frame) = self.receive(now)? {
                self.master.handle_rx(now, &frame);
            }
            self.master.handle_timeout(now);
            self.link.flush(now)?;
            while !self.link.is_full()
                && let Some(frame) = self.master.poll_tx()
            {
                self.link.send(now, frame)?;
            }
            self.show();
            while let Some(event) = self.master.poll_event() {
                match event {
                    Event::Done(done) => {
                        self.progress.clear();
                        if let Some((text, json)) = done_text(done) {
                            say(target, as_json, &text, json)?;
                        }
                        return Ok(Ok(()));
                    }
                    Event::Failed(command, failure) => {
                        self.progress.clear();
                        return Ok(Err(failure_text(command, failure)));
                    }
                    Event::Found(address) => {
                        self.found += 1;
                        self.progress.clear();
                        say(target, as_json, &address.to_string(), address_json(address))?;
                    }
                    Event::Address(address) => say(target, as_json, &address.to_string(), address_json(address))?,
                    Event::NodeId(id) if self.sets => self.old = Some(id),
                    Event::NodeId(id) => {
                        let text = id.map_or("no node id".into(), |id| format!("node id {id}"));
                        say(target, as_json, &text, json!({"node": id}))?;
                    }
                    Event::SwitchNow => complain(&"the nodes change their bit rate now: change the interface's, too"),
                    Event::Present(_) => {}
                }
            }
            if self.link.wait(self.master.poll_timeout().unwrap_or(now))? {
                return Err("interrupted; nodes may have been left in the configuration state".into());
            }
        }
    }

    /// Shows how far the search for the next node is.
    fn show(&mut self) {
        let Some(share) = self.master.scan_share() else { return };
        if share < self.scanned {
            self.progress.restart();
        }
        self.scanned = share;
        let found = self.found;
        self.progress.show(share, |_| format!("{found} found"));
    }

    fn receive(&mut self, now: Instant) -> Result<Option<base::can::Frame>, Failed> {
        loop {
            match self.link.receive(now)? {
                Heard::Frame { frame, .. } => {
                    if let Some(Service::ErrorControl { node }) = Service::of(&frame)
                        && decode_heartbeat(frame.data()) == Some(NmtState::Initialising)
                    {
                        self.booted.push(node);
                    }
                    return Ok(Some(frame));
                }
                Heard::Note(note) => self.link.tell(&note),
                Heard::Notice(_) => {}
                Heard::Nothing => return Ok(None),
            }
        }
    }

    /// Reports that the node boots with the id that it was given, as one that had none does, or when it will.
    fn boot(&mut self, target: &Target, as_json: bool, id: u8) -> Result<(), Failed> {
        let until = clock::now() + BOOT;
        loop {
            let now = clock::now();
            while self.receive(now)?.is_some() {}
            // It may have booted before the last command was answered.
            if self.booted.contains(&id) {
                return say(target, as_json, &format!("node {id} has booted"), json!({"booted": id}));
            }
            if now >= until || self.link.wait(until)? {
                let next = "in use when the node boots next: advee can nmt reset-comm";
                let text = match self.old {
                    Some(Some(old)) => format!("{next} {old}"),
                    Some(None) => "in use: the node had no id; its boot-up was not received".into(),
                    None => format!("{next} NODE, with its old id"),
                };
                return say(target, as_json, &text, json!({"booted": null}));
            }
        }
    }
}

fn say(target: &Target, as_json: bool, text: &str, mut json: Value) -> Result<(), Failed> {
    if !as_json {
        return print(text);
    }
    json["bus"] = target.name.as_str().into();
    print(json)
}

fn address_json(address: Address) -> Value {
    let Address { vendor, product, revision, serial } = address;
    let text = address.to_string();
    json!({"address": text, "vendor": vendor, "product": product, "revision": revision, "serial": serial})
}

/// Line for a completed command, where it has a result.
fn done_text(command: Command) -> Option<(String, Value)> {
    Some(match command {
        Command::SetNodeId(UNCONFIGURED) => ("has no node id".into(), json!({"set_node_id": null})),
        Command::SetNodeId(id) => (format!("node id {id} is set"), json!({"set_node_id": id})),
        Command::SetBitRate(rate) => {
            let text = rate.kbits().map_or("automatic".into(), |kbits| format!("{kbits} kbit/s"));
            (format!("bit rate {text} is set"), json!({"set_kbits": rate.kbits()}))
        }
        Command::Store => ("stored".into(), json!({"stored": true})),
        Command::Activate { .. } => ("the bit rate is in use".into(), json!({"activated": true})),
        _ => return None,
    })
}

fn failure_text(command: Command, failure: Failure) -> String {
    let what = match command {
        Command::Find | Command::FindAll => "finding nodes without node id",
        Command::Select(_) => "selecting",
        Command::InquireAddress | Command::InquireNodeId => "inquiring",
        Command::SetNodeId(_) => "setting the node id",
        Command::SetBitRate(_) => "setting the bit rate",
        Command::Store => "storing",
        _ => "switching",
    };
    let why = match failure {
        Failure::NoAnswer => "nobody answers".into(),
        Failure::Contradiction => {
            "the answers contradict each other: frames are lost, or a node answers out of turn".into()
        }
        Failure::Refused(Refusal::NodeIdOutOfRange) => "refused: the node id is out of its range".into(),
        Failure::Refused(Refusal::BitRateNotSupported) => "refused: it does not have this bit rate".into(),
        Failure::Refused(Refusal::StoreNotSupported) => "refused: it cannot store".into(),
        Failure::Refused(Refusal::StorageAccess) => "refused: its memory failed".into(),
        Failure::Refused(Refusal::Specific(code)) => format!("refused: reason {code} of its own"),
        Failure::Refused(Refusal::Other(code)) => format!("refused: reason {code}, which the standard does not name"),
    };
    format!("{what}: {why}")
}
