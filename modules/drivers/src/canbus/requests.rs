//! `LL_CMD_SDO`: engineers' access to the objects of any node while the robot is up.
//!
//! Of our drives only objects on a list can be written, and only while the robot stands: the error history, which is
//! harmless, and those that the configuration names. No configuration names an object that moves or supervises a drive,
//! or on which its stop depends ([`may_be_listed`]).

use base::Instant;
use canopen::master::{RequestError, Ticket};
use canopen::{Abort, Master, sdo};
use messages::lowlevel::{CmdSdo, DataSdo};
use module::Actions;

/// Maximum number of pending requests to the nodes of a bus; further ones are rejected. On a bus that is down they
/// wait.
const PENDING_MAX: usize = 32;
/// The same for a node that the stop depends on: its speed is read, and its output written, after them.
const PENDING_OF_OURS_MAX: usize = 4;

/// Length above which data is written by block transfer, if the node supports that, bytes.
const BLOCK_MIN: usize = 128;

/// A pending request.
struct Pending {
    /// Number of the bus.
    bus: usize,
    ticket: Ticket,
    request: CmdSdo,
}

/// All pending requests.
#[derive(Default)]
pub(super) struct Requests(Vec<Pending>);

/// Relation of the requested node to this driver.
#[derive(Clone, PartialEq, Eq)]
pub(super) enum NodeOwner {
    /// One of our drives; `standing` if the robot is known to stand; `writable` as in the configuration.
    Ours { standing: bool, writable: Vec<u16> },
    /// Any other node.
    Others,
}

impl Requests {
    /// Starts a request to a node on a bus with its master, or answers at once with the reason of rejection. `node` is
    /// absent if no bus has that number, or the bus has no CANopen nodes.
    pub(super) fn on_command(
        &mut self,
        now: Instant,
        request: &CmdSdo,
        owner: &NodeOwner,
        node: Option<(usize, u8, &mut Master)>,
        out: &mut Actions,
    ) {
        let begun = node.ok_or(Abort::NO_RESOURCE).and_then(|node| self.begin(now, request, owner, node));
        if let Err(abort) = begun {
            answer(now, request, Err(abort), out);
        }
    }

    fn begin(
        &mut self,
        now: Instant,
        request: &CmdSdo,
        owner: &NodeOwner,
        (bus, node, master): (usize, u8, &mut Master),
    ) -> Result<(), Abort> {
        let index = u16::try_from(request.index).map_err(|_| Abort::NO_OBJECT)?;
        let sub = u8::try_from(request.subindex).map_err(|_| Abort::NO_SUB_INDEX)?;
        let same = self.0.iter().filter(|pending| pending.request.node == request.node).count();
        let crowded = matches!(owner, NodeOwner::Ours { .. }) && same >= PENDING_OF_OURS_MAX;
        let of_bus = self.0.iter().filter(|pending| pending.bus == bus).count();
        if crowded || of_bus >= PENDING_MAX {
            return Err(Abort::OUT_OF_MEMORY);
        }
        let data = request.data.as_slice();
        let ticket = if request.write {
            may_write(index, sub, data, owner)?;
            let write = if data.len() > BLOCK_MIN { Master::sdo_write_block } else { Master::sdo_write };
            write(master, now, node, index, sub, data)
        } else {
            master.sdo_read(now, node, index, sub)
        };
        let ticket = ticket.map_err(|why| match why {
            RequestError::UnknownNode => Abort::LOCAL_CONTROL,
            RequestError::QueueFull => Abort::OUT_OF_MEMORY,
            RequestError::TooLong => Abort::TOO_LONG,
        })?;
        // The data is in the transfer and not needed again.
        self.0.push(Pending { bus, ticket, request: CmdSdo { data: Vec::new(), ..request.clone() } });
        Ok(())
    }

    /// A transfer ended; false if it is not one of these requests.
    pub(super) fn on_end(
        &mut self,
        now: Instant,
        ticket: Ticket,
        result: Result<&[u8], sdo::Error>,
        out: &mut Actions,
    ) -> bool {
        let Some(place) = self.0.iter().position(|pending| pending.ticket == ticket) else {
            return false;
        };
        let Pending { request, .. } = self.0.swap_remove(place);
        answer(now, &request, result.map_err(sdo::Error::code), out);
        true
    }
}

/// 0x1003:0, the error history: zero clears it.
const ERROR_HISTORY: u16 = 0x1003;

/// Checks that an object may be written by an engineer.
fn may_write(index: u16, sub: u8, data: &[u8], owner: &NodeOwner) -> Result<(), Abort> {
    let NodeOwner::Ours { standing, writable } = owner else { return Ok(()) };
    let clears = index == ERROR_HISTORY && sub == 0 && data == [0];
    match (clears || writable.contains(&index) && may_be_listed(index), standing) {
        (false, _) => Err(Abort::LOCAL_CONTROL),
        (true, false) => Err(Abort::DEVICE_STATE),
        (true, true) => Ok(()),
    }
}

/// True for an object that a configuration may add to the list: one of the device profile (0x6000 to 0x9FFF) that
/// neither moves nor supervises a drive, and on which no stop depends (CiA 402-2). Communication objects and the
/// manufacturer's objects do not qualify.
pub(super) fn may_be_listed(index: u16) -> bool {
    let own = matches!(
        index,
        // Reaction to a lost connection; controlword; stop reactions and modes.
        0x6007 | 0x6040 | 0x605A..=0x6061
        // Targets, torque and current limits, position range, polarity, speed and ramp limits, quick stop, profiles.
        | 0x6071..=0x6088
        // Gear and unit factors.
        | 0x6089..=0x6097
        // Homing.
        | 0x6098..=0x609A
        // Touch probe and interpolation, offsets of the cyclic modes, acceleration limits.
        | 0x60B0..=0x60C6
        // Digital outputs: a brake may be one. Targets of velocity, motor type.
        | 0x60FE | 0x60FF | 0x6402..=0x6410
    );
    (0x6000..=0x9FFF).contains(&index) && !own && !(0x6800..=0x9FFF).contains(&index)
}

fn answer(now: Instant, request: &CmdSdo, result: Result<&[u8], Abort>, out: &mut Actions) {
    out.publish(DataSdo {
        timestamp: out.timestamp(now),
        request: request.request,
        node: request.node,
        index: request.index,
        subindex: request.subindex,
        abort_code: result.err().map_or(0, |abort| i64::from(abort.0)),
        data: result.unwrap_or_default().to_vec(),
    });
}
