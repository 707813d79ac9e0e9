//! Decoding of the frames of a CANopen bus: pure, frame by frame, with the state of earlier frames. Used by `advee can
//! monitor`.

mod lss;
mod pdo;
mod sdo;
#[cfg(test)]
mod tests;

pub use sdo::{Channel, Step};

use super::book::Book;
use super::value::bytes;
use base::can::{BusState, Frame, Id, Notice};
use base::listed;
use canopen::NmtState;
use canopen::dictionary::DataType;
use canopen::wire::{self, Emergency, NmtCommand, Service, TimeOfDay};
use pdo::Maps;
use serde_json::{Value, json};
use std::collections::BTreeMap;

listed! {
    /// The service that a frame belongs to.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
    #[allow(missing_docs)] // the names are the description
    pub enum Kind {
        Nmt => "nmt",
        Sync => "sync",
        Time => "time",
        Emcy => "emcy",
        Pdo => "pdo",
        Sdo => "sdo",
        Heartbeat => "heartbeat",
        Lss => "lss",
        /// Frames outside CANopen.
        Other => "other",
        /// Notices of the controller.
        Notice => "notice",
    }
}

/// Style of a line on a terminal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// Plain.
    #[default]
    Plain,
    /// A master commands or asks.
    Command,
    /// Success, or an arrival.
    Good,
    /// Unchanged.
    Dim,
    /// Worth a look.
    Notable,
    /// Something is wrong.
    Bad,
}

/// A decoded frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Sender or addressee; `None` if it is all nodes or none.
    pub node: Option<u8>,
    /// The service, for people: `SDO →`, `TPDO4`.
    pub what: String,
    /// In words.
    pub says: String,
    /// JSON object.
    pub json: Value,
    /// Style.
    pub look: Look,
}

impl Told {
    fn new(node: Option<u8>, what: impl Into<String>, look: Look, says: impl Into<String>, json: Value) -> Self {
        Self { node, what: what.into(), says: says.into(), json, look }
    }

    /// A frame that breaks the rules of its service.
    fn malformed(node: Option<u8>, what: impl Into<String>, frame: &Frame) -> Self {
        let says = format!("malformed: {}", said(frame));
        Self::new(node, what, Look::Bad, says, json!({"malformed": true}))
    }
}

/// Follows one bus.
pub struct Decoder {
    book: Book,
    maps: Maps,
    sdo: BTreeMap<u8, Channel>,
    /// NMT state in each node's newest heartbeat.
    states: BTreeMap<u8, u8>,
}

impl Decoder {
    /// Makes a decoder for the nodes of the book.
    pub fn new(book: Book) -> Self {
        let maps = Maps::new(&book);
        Self { book, maps, sdo: BTreeMap::new(), states: BTreeMap::new() }
    }

    /// Decodes a frame.
    pub fn frame(&mut self, frame: &Frame) -> (Kind, Told) {
        // A PDO may have any identifier that is not restricted.
        if let Some(told) = self.maps.told(&self.book, frame) {
            return (Kind::Pdo, told);
        }
        let data = frame.data();
        match Service::of(frame) {
            Some(Service::Nmt) => (Kind::Nmt, self.nmt(frame)),
            Some(Service::Sync) => (Kind::Sync, sync(frame)),
            Some(Service::Time) => (Kind::Time, time(frame)),
            Some(Service::Emergency { node }) => (Kind::Emcy, emergency(node, frame)),
            Some(Service::Tpdo { node, number }) => (Kind::Pdo, pdo::unmapped(node, false, number, frame)),
            Some(Service::Rpdo { node, number }) => (Kind::Pdo, pdo::unmapped(node, true, number, frame)),
            Some(Service::SdoRequest { node }) => (Kind::Sdo, self.sdo(node, true, data)),
            Some(Service::SdoResponse { node }) => (Kind::Sdo, self.sdo(node, false, data)),
            Some(Service::ErrorControl { node }) => (Kind::Heartbeat, self.error_control(node, frame)),
            Some(Service::LssRequest) => (Kind::Lss, lss::request(data)),
            Some(Service::LssResponse) => (Kind::Lss, lss::response(data)),
            None => (Kind::Other, Told::new(None, "?", Look::Notable, said(frame), json!({}))),
        }
    }

    fn nmt(&mut self, frame: &Frame) -> Told {
        let Some((command, node)) = wire::decode_nmt(frame.data()) else {
            return Told::malformed(None, "NMT", frame);
        };
        let whom = if node == 0 { "all nodes" } else { "" };
        let says = format!("{} {whom}", command_name(command));
        let json = json!({"command": command_name(command), "to": node});
        Told::new(Some(node).filter(|node| *node != 0), "NMT →", Look::Command, says.trim_end(), json)
    }

    fn error_control(&mut self, node: u8, frame: &Frame) -> Told {
        if frame.is_remote() {
            return Told::new(
                Some(node),
                "guard →",
                Look::Command,
                "asks for the state",
                json!({"guarding": "request"}),
            );
        }
        let (state, byte) = match *frame.data() {
            [byte] => (NmtState::from_byte(byte), byte),
            _ => return Told::malformed(Some(node), "heartbeat", frame),
        };
        let Some(state) = state else {
            return Told::malformed(Some(node), "heartbeat", frame);
        };
        let before = self.states.insert(node, byte & 0x7F);
        if byte == 0 {
            // A reset restores the default mappings.
            self.maps.boot(&self.book, node);
            self.sdo.remove(&node);
            return Told::new(Some(node), "boot-up", Look::Good, "has booted", json!({"boot_up": true}));
        }
        let name = state_name(state);
        let (what, toggle) = if byte & 0x80 != 0 { ("guard ←", " (toggled)") } else { ("heartbeat", "") };
        let (look, was) = match before {
            Some(before) if before == byte & 0x7F => (Look::Dim, String::new()),
            None => (Look::Plain, String::new()),
            Some(before) => {
                let before = NmtState::from_byte(before).map_or("?", state_name);
                (Look::Notable, format!(", was {before}"))
            }
        };
        Told::new(Some(node), what, look, format!("{name}{toggle}{was}"), json!({"state": name}))
    }

    fn sdo(&mut self, node: u8, is_request: bool, data: &[u8]) -> Told {
        let step = self.sdo.entry(node).or_default().step(is_request, data);
        if let Step::Done { index, sub, data: Some(data), .. } = &step {
            self.maps.learn(node, *index, *sub, data);
        }
        step.told(&self.book, node, is_request)
    }
}

/// Decodes a notice of the controller.
pub fn notice(notice: &Notice) -> Told {
    let (look, says, json) = match notice {
        Notice::Health(health) => {
            let (look, name) = match health.state {
                BusState::Active => (Look::Good, "error-active"),
                BusState::Warning => (Look::Notable, "error-active, at the warning level"),
                BusState::Passive => (Look::Bad, "error-passive"),
                BusState::Off => (Look::Bad, "bus-off"),
            };
            let (transmit, receive) = (health.transmit_errors, health.receive_errors);
            let says = format!("controller is {name} (transmit errors {transmit}, receive errors {receive})");
            (look, says, json!({"state": name, "transmit_errors": transmit, "receive_errors": receive}))
        }
        Notice::NoAcknowledge => {
            let says = "nobody acknowledges: alone on the bus, or cut off from it, or another bit rate";
            (Look::Bad, says.into(), json!({"no_acknowledge": true}))
        }
        Notice::Errors(count) => (Look::Bad, format!("{count} frames had an error"), json!({"errors": count})),
        Notice::Lost(count) => (Look::Bad, format!("{count} received frames are lost"), json!({"lost": count})),
    };
    Told::new(None, "controller", look, says, json)
}

/// Line for a problem outside of frames.
pub fn note(text: &str) -> Told {
    Told::new(None, "note", Look::Bad, text, json!({"note": text}))
}

fn sync(frame: &Frame) -> Told {
    match wire::decode_sync(frame.data()) {
        Some(None) => Told::new(None, "SYNC", Look::Dim, "", json!({})),
        Some(Some(counter)) => Told::new(None, "SYNC", Look::Dim, counter.to_string(), json!({"counter": counter})),
        None => Told::malformed(None, "SYNC", frame),
    }
}

fn time(frame: &Frame) -> Told {
    let Some(TimeOfDay { millis, days }) = TimeOfDay::decode(frame.data()) else {
        return Told::malformed(None, "TIME", frame);
    };
    let text = DataType::TimeOfDay.show(frame.data());
    Told::new(None, "TIME", Look::Plain, text, json!({"millis": millis, "days": days}))
}

fn emergency(node: u8, frame: &Frame) -> Told {
    let Some(emergency) = Emergency::decode(frame.data()) else {
        return Told::malformed(Some(node), "EMCY", frame);
    };
    let Emergency { code, register, info } = emergency;
    let (look, class) = if code == 0 { (Look::Good, "no error any more") } else { (Look::Bad, emergency.class()) };
    let stands = register_bits(register);
    let stands = if stands.is_empty() { String::new() } else { format!(" ({})", stands.join(", ")) };
    let more = if info == [0; 5] { String::new() } else { format!(", info {}", bytes(&info)) };
    let says = format!("0x{code:04X} {class}, register 0x{register:02X}{stands}{more}");
    Told::new(Some(node), "EMCY", look, says, json!({"code": code, "class": class, "register": register, "info": info}))
}

/// The names of the bits of the error register 0x1001 that are set.
fn register_bits(register: u8) -> Vec<&'static str> {
    const BITS: [&str; 8] =
        ["generic", "current", "voltage", "temperature", "communication", "profile", "reserved", "manufacturer"];
    (0..8).filter(|bit| register >> bit & 1 == 1).map(|bit| BITS[bit]).collect()
}

/// An NMT command in the words of the standard.
pub const fn command_name(command: NmtCommand) -> &'static str {
    match command {
        NmtCommand::Start => "start",
        NmtCommand::Stop => "stop",
        NmtCommand::EnterPreOperational => "enter pre-operational",
        NmtCommand::ResetNode => "reset node",
        NmtCommand::ResetCommunication => "reset communication",
    }
}

/// An NMT state in the words of the standard.
pub const fn state_name(state: NmtState) -> &'static str {
    match state {
        NmtState::Initialising => "initialising",
        NmtState::Stopped => "stopped",
        NmtState::Operational => "operational",
        NmtState::PreOperational => "pre-operational",
    }
}

/// An identifier as it is written: three digits, or eight.
pub fn id_text(id: Id) -> String {
    match id {
        Id::Standard(id) => format!("{id:03X}"),
        Id::Extended(id) => format!("{id:08X}"),
    }
}

fn said(frame: &Frame) -> String {
    if frame.is_remote() { format!("remote frame, {} bytes asked for", frame.dlc()) } else { bytes(frame.data()) }
}
