//! Layer setting services (CiA 305), both directions.

use super::{Look, Told};
use crate::can::value::bytes;
use canopen::lss::wire::{Bound, Confirm, FastScan, Request, Response};
use canopen::lss::{BitRate, Mode, Part, UNCONFIGURED};
use serde_json::json;

/// From the master.
pub fn request(data: &[u8]) -> Told {
    let Some(request) = Request::decode(data) else {
        return told(Look::Notable, true, format!("unknown: {}", bytes(data)));
    };
    let says = match request {
        Request::SwitchGlobal(Mode::Waiting) => "all to waiting".into(),
        Request::SwitchGlobal(Mode::Configuration) => "all to configuration".into(),
        Request::Select { part, number } => format!("select {} 0x{number:08X}", name(part)),
        Request::SetNodeId(UNCONFIGURED) => "set no node id".into(),
        Request::SetNodeId(id) => format!("set node id {id}"),
        Request::SetBitTiming { table: 0, index } => match BitRate::from_index(index).map(BitRate::kbits) {
            Some(Some(kbits)) => format!("set bit rate {kbits} kbit/s"),
            Some(None) => "set bit rate automatic".into(),
            None => format!("set bit rate of entry {index}"),
        },
        Request::SetBitTiming { table, index } => format!("set bit rate of table {table}, entry {index}"),
        Request::Activate { delay_ms } => format!("activate bit rate after {delay_ms} ms"),
        Request::Store => "store".into(),
        Request::Inquire(part) => format!("inquire {}", name(part)),
        Request::InquireNodeId => "inquire node id".into(),
        Request::Identify { bound, number } => format!("identify {} 0x{number:08X}", bound_name(bound)),
        Request::IdentifyNonConfigured => "who has no node id?".into(),
        Request::FastScan(FastScan { bit_check: FastScan::RESET, .. }) => "fastscan: who has no node id?".into(),
        Request::FastScan(FastScan { number, bit_check, sub, next }) => {
            let part = |at: u8| Part::ALL.get(usize::from(at)).map_or("?", |part| name(*part));
            let then = if next == sub { String::new() } else { format!(", then {}", part(next)) };
            format!("fastscan: {} 0x{number:08X} down to bit {bit_check}?{then}", part(sub))
        }
    };
    told(Look::Command, true, says)
}

/// From a slave.
pub fn response(data: &[u8]) -> Told {
    let Some(response) = Response::decode(data) else {
        return told(Look::Notable, false, format!("unknown: {}", bytes(data)));
    };
    let confirmed = |what: &str, Confirm { error, specific }| match error {
        0 => (Look::Good, format!("{what}: done")),
        0xFF => (Look::Bad, format!("{what}: refused, error {specific} of its own")),
        error => (Look::Bad, format!("{what}: refused, error {error}")),
    };
    let (look, says) = match response {
        Response::Selected => (Look::Good, "is selected".into()),
        Response::NodeIdSet(confirm) => confirmed("node id", confirm),
        Response::BitTimingSet(confirm) => confirmed("bit rate", confirm),
        Response::Stored(confirm) => confirmed("store", confirm),
        Response::Inquired { part, number } => (Look::Good, format!("{} 0x{number:08X}", name(part))),
        Response::NodeId(UNCONFIGURED) => (Look::Good, "no node id".into()),
        Response::NodeId(id) => (Look::Good, format!("node id {id}")),
        Response::Identified => (Look::Good, "yes".into()),
        Response::NonConfigured => (Look::Good, "here, without node id".into()),
    };
    told(look, false, says)
}

fn name(part: Part) -> &'static str {
    match part {
        Part::Vendor => "vendor",
        Part::Product => "product",
        Part::Revision => "revision",
        Part::Serial => "serial",
    }
}

fn bound_name(bound: Bound) -> &'static str {
    match bound {
        Bound::Vendor => "vendor",
        Bound::Product => "product",
        Bound::RevisionLow => "revision from",
        Bound::RevisionHigh => "revision to",
        Bound::SerialLow => "serial from",
        Bound::SerialHigh => "serial to",
    }
}

fn told(look: Look, is_request: bool, says: String) -> Told {
    let json = json!({"request": is_request, "says": says});
    Told::new(None, if is_request { "LSS →" } else { "LSS ←" }, look, says, json)
}
