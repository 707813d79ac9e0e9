//! ODrives and VESCs on a CAN bus: controllers that are no nodes of CANopen.
//!
//! Both are asked for their version only, which moves nothing and feeds no time limit. An ODrive is asked if its
//! heartbeat was received; on a bus with CANopen nodes only if its estimates were, too, since the identifiers of
//! heartbeats are those of PDOs there. A VESC is asked if its status was received, or any id where no node of CANopen
//! answers.

use super::link::{Heard, Link};
use super::target::Target;
use crate::Failed;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use host::clock;
use motorctl::odrive::wire::{Command, Message, NODE_MAX, Received, Version};
use motorctl::vesc::Link as _;
use motorctl::vesc::can;
use motorctl::vesc::payload::{Answer, Request};
use std::collections::BTreeSet;
use std::ops::RangeInclusive;

/// Time in which heartbeats (100 ms by default) and status frames are received.
const LISTEN: Duration = Duration::from_millis(300);
/// Time limit of an answer of a controller that was received.
const ANSWER: Duration = Duration::from_millis(100);
/// Time limit of a VESC that may be there. One is asked at a time: fragments of an answer do not name their sender.
const ANSWER_MAYBE: Duration = Duration::from_millis(15);
/// Id by which VESCs answer.
const HOST_ID: u8 = 254;
/// Identifier of a VESC's status: CAN_PACKET_STATUS, `datatypes.h`.
const STATUS: u32 = 9;

/// A controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// Node id or VESC id.
    pub id: u8,
    /// What it states.
    pub kind: Kind,
}

/// Kind of a controller.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// An ODrive by CAN Simple.
    Odrive(Version),
    /// A VESC.
    Vesc {
        /// Major and minor version of the firmware.
        firmware: [u8; 2],
        /// Name of the hardware.
        hardware: String,
    },
}

/// Controllers whose cyclic frames were received.
#[derive(Debug, Default, PartialEq)]
struct Cyclic {
    heartbeats: BTreeSet<u8>,
    estimates: BTreeSet<u8>,
    vescs: BTreeSet<u8>,
}

impl Cyclic {
    fn take(&mut self, frame: &Frame) {
        match frame.id() {
            Id::Standard(id) => {
                let node = motorctl::odrive::wire::node_of(id);
                match Message::decode(node, frame) {
                    Received::Message(Message::Heartbeat { .. }) => _ = self.heartbeats.insert(node),
                    Received::Message(Message::Estimates { .. }) => _ = self.estimates.insert(node),
                    _ => {}
                }
            }
            Id::Extended(id) if id >> 8 == STATUS && frame.data().len() == 8 => _ = self.vescs.insert(id as u8),
            Id::Extended(_) => {}
        }
    }

    /// Nodes that may be ODrives. `alone`: no node of CANopen is on the bus.
    fn odrives(&self, alone: bool) -> Vec<u8> {
        // Node 0 is asked by the identifier of NMT, node 4 by that of SYNC.
        let may = |node: &&u8| alone || (self.estimates.contains(node) && ![0, 4].contains(*node));
        self.heartbeats.iter().filter(|node| **node <= NODE_MAX).filter(may).copied().collect()
    }
}

/// Finds the controllers with an id in `range`. `alone`: no node of CANopen is on the bus.
///
/// # Errors
/// The bus cannot be opened, or is lost; interrupted.
pub fn find(target: &Target, range: &RangeInclusive<u8>, alone: bool) -> Result<Vec<Controller>, Failed> {
    let mut link = Link::open(target)?;
    let mut received = Cyclic::default();
    listen(&mut link, LISTEN, &mut |frame| {
        received.take(frame);
        false
    })?;
    let mut found = Vec::new();
    for node in received.odrives(alone).into_iter().filter(|node| *node == 0 || range.contains(node)) {
        link.send(clock::now(), Command::GetVersion.frame(node))?;
        let mut version = None;
        listen(&mut link, ANSWER, &mut |frame| {
            if let Received::Message(Message::Version(stated)) = Message::decode(node, frame) {
                version = Some(stated);
            }
            version.is_some()
        })?;
        found.extend(version.map(|version| Controller { id: node, kind: Kind::Odrive(version) }));
        if link.is_full() {
            // Nobody acknowledges frames: nobody is there.
            return Ok(found);
        }
    }
    for id in range.clone().filter(|id| alone || received.vescs.contains(id)) {
        let limit = if received.vescs.contains(&id) { ANSWER } else { ANSWER_MAYBE };
        found.extend(vesc(&mut link, id, limit)?);
        if link.is_full() {
            break;
        }
    }
    Ok(found)
}

/// Asks a VESC for its firmware.
fn vesc(link: &mut Link, id: u8, limit: Duration) -> Result<Option<Controller>, Failed> {
    let mut way = can::Link::host(HOST_ID, id);
    way.send(&Request::Firmware.bytes());
    // A request is one frame.
    if let Some(frame) = way.poll_tx() {
        link.send(clock::now(), frame)?;
    }
    let mut found = None;
    listen(link, limit, &mut |frame| {
        way.receive(clock::now(), frame, &mut |payload| {
            if let Some(Answer::Firmware { version, hardware, .. }) = Answer::decode(payload) {
                let hardware = String::from_utf8_lossy(&hardware).into_owned();
                found = Some(Controller { id, kind: Kind::Vesc { firmware: version, hardware } });
            }
        });
        found.is_some()
    })?;
    Ok(found)
}

/// Receives for `within`, or until `take` has what it needs, and sends what waits for room.
fn listen(link: &mut Link, within: Duration, take: &mut dyn FnMut(&Frame) -> bool) -> Result<(), Failed> {
    let until: Instant = clock::now() + within;
    loop {
        let now = clock::now();
        if link.is_full() {
            link.flush(now)?;
        }
        let heard = link.receive(now)?;
        match heard {
            Heard::Frame { frame, .. } if take(&frame) => break,
            Heard::Nothing if now < until && link.wait(until)? => return Err("interrupted".into()),
            _ => {}
        }
        // A bus that is never silent ends it, too.
        if now >= until {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_odrive_has_a_heartbeat_and_beside_canopen_nodes_estimates_and_a_vesc_a_status() {
        let mut received = Cyclic::default();
        let mut take = |frame: Frame| received.take(&frame);
        for node in [0, 4, 9, 10] {
            take(Message::Heartbeat { errors: 0, state: 1 }.frame(node));
        }
        for node in [0, 4, 10, 11] {
            take(Message::Estimates { position: 0.0, velocity: 0.0 }.frame(node));
        }
        // Questions, and frames of another length.
        take(Command::GetVersion.frame(12));
        take(Frame::new(Id::Standard(13 << 5 | 1), &[0; 4]).unwrap());
        for (id, length) in [(STATUS << 8 | 23, 8), (STATUS << 8 | 24, 7), (STATUS << 16 | 25, 8), (26, 8)] {
            take(Frame::new(Id::Extended(id), &[0; 8][..length]).unwrap());
        }
        assert_eq!(received.odrives(true), [0, 4, 9, 10]);
        // The others would be asked by the identifiers of NMT and SYNC, or have the identifier of a PDO.
        assert_eq!(received.odrives(false), [10]);
        assert_eq!(received.vescs, BTreeSet::from([23]));
    }
}
