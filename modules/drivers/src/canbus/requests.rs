//! `LL_CMD_SDO`: engineers' access to the objects of any node while the robot is up.
//!
//! Objects that move or supervise a drive belong to this driver and cannot be written; the other objects of our drives
//! can be written only while the robot stands.

use base::Instant;
use canopen::master::{RequestError, Ticket};
use canopen::{Abort, Master, sdo};
use messages::lowlevel::{CmdSdo, DataSdo};
use module::Actions;

/// Maximum number of pending requests; further ones are rejected.
const PENDING_MAX: usize = 32;

/// Length above which data is written by block transfer, if the node supports that, bytes.
const BLOCK_MIN: usize = 128;

/// A pending request.
struct Pending {
    ticket: Ticket,
    request: CmdSdo,
}

/// All pending requests.
#[derive(Default)]
pub(super) struct Requests(Vec<Pending>);

/// Relation of the requested node to this driver.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeOwner {
    /// One of our drives; `standing` if the robot is known to stand.
    Ours { standing: bool },
    /// Any other node.
    Others,
}

impl Requests {
    /// Starts a request, or answers at once with the reason of rejection.
    pub(super) fn on_command(
        &mut self,
        now: Instant,
        request: &CmdSdo,
        owner_of: NodeOwner,
        master: &mut Master,
        out: &mut Actions,
    ) {
        if let Err(abort) = self.begin(now, request, owner_of, master) {
            answer(now, request, Err(abort), out);
        }
    }

    fn begin(&mut self, now: Instant, request: &CmdSdo, owner_of: NodeOwner, master: &mut Master) -> Result<(), Abort> {
        let node = u8::try_from(request.node).ok().filter(|node| (1..=127).contains(node)).ok_or(Abort::NO_RESOURCE)?;
        let index = u16::try_from(request.index).map_err(|_| Abort::NO_OBJECT)?;
        let sub = u8::try_from(request.subindex).map_err(|_| Abort::NO_SUB_INDEX)?;
        if self.0.len() >= PENDING_MAX {
            return Err(Abort::OUT_OF_MEMORY);
        }
        let data = request.data.as_slice();
        let ticket = if request.write {
            may_write(index, owner_of)?;
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
        self.0.push(Pending { ticket, request: CmdSdo { data: Vec::new(), ..request.clone() } });
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

/// Checks that an object may be written by an engineer.
fn may_write(index: u16, owner_of: NodeOwner) -> Result<(), Abort> {
    match (owner_of, index) {
        (NodeOwner::Others, _) => Ok(()),
        // Identifiers, error control, PDOs; controlword, mode, halt and quick stop reactions, set-points, homing.
        (NodeOwner::Ours { .. }, 0x1005..=0x1007 | 0x100C | 0x100D | 0x1010..=0x1019 | 0x1029 | 0x1400..=0x1BFF)
        | (NodeOwner::Ours { .. }, 0x6007 | 0x6040 | 0x605A..=0x6060 | 0x6071 | 0x607A | 0x607C | 0x6098 | 0x60FF) => {
            Err(Abort::LOCAL_CONTROL)
        }
        (NodeOwner::Ours { standing: false }, _) => Err(Abort::DEVICE_STATE),
        (NodeOwner::Ours { standing: true }, _) => Ok(()),
    }
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
