//! The output of a CANopen node, accessed by SDO, so that each order is acknowledged.

use base::{Duration, Instant};
use canopen::Master;
use canopen::master::{Target, Ticket};
use canopen::{NmtCommand, NmtState};
use settings::{Table, settings};

/// Time after which a transfer that waits behind others is given up.
const PATIENCE: Duration = Duration::from_millis(600);

settings! {
    /// `[stop.output]`: digital output of a CANopen node, on the bus of the drives, that feeds the motors: it holds a
    /// relay, or the safe-torque-off input of the propulsion drive. The object belongs to it as a whole.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct OutputConfig {
        /// CANopen node: none of the drives, nor the master.
        node: u8 = required, 1..=127;
        /// Index of the object: 0x6200 of an output module (CiA 401), or the maker's.
        index: u16 = required, 0x2000..=0x9FFF;
        /// Its sub-index.
        subindex: u8 = 1, 0..=254;
        /// Its size: 8, 16 or 32.
        bits: u8 = 8, 8..=32;
        /// Value with which the motors are fed.
        on: u32 = 1, 0..=u32::MAX;
        /// Value that cuts their feed.
        cut: u32 = 0, 0..=u32::MAX;
    }
    check OutputConfig::check;
}

impl OutputConfig {
    fn check(&self, table: &Table<'_>) {
        if ![8, 16, 32].contains(&self.bits) {
            table.refuse("bits", "8, 16 or 32");
        }
        for (key, value) in [("on", self.on), ("cut", self.cut)] {
            if u64::from(value) >> self.bits != 0 {
                table.refuse(key, "a value that fits the object");
            }
        }
        if self.on == self.cut {
            let key = if table.has("cut") { "cut" } else { "on" };
            table.refuse(key, "two values that differ");
        }
    }

    /// Bytes of a value on the wire.
    fn bytes(&self, value: u32) -> Vec<u8> {
        value.to_le_bytes()[..usize::from(self.bits / 8)].to_vec()
    }

    /// Value of these bytes; `None` if the object has another size.
    fn value(&self, bytes: &[u8]) -> Option<u32> {
        let mut value = [0; 4];
        value.get_mut(..bytes.len())?.copy_from_slice(bytes);
        (bytes.len() == usize::from(self.bits / 8)).then(|| u32::from_le_bytes(value))
    }
}

/// Transfer whose end is awaited until an instant.
#[derive(Debug)]
struct Pending {
    ticket: Ticket,
    written: Option<u32>,
    until: Instant,
}

/// Access to the output.
#[derive(Debug)]
pub(in super::super) struct NodeOutput {
    pub config: OutputConfig,
    pending: Option<Pending>,
}

impl NodeOutput {
    pub fn new(config: OutputConfig) -> Self {
        Self { config, pending: None }
    }

    /// A read that is under way is not waited for.
    pub fn drop_read(&mut self) {
        self.pending.take_if(|pending| pending.written.is_none());
    }

    /// Gives up a transfer that takes too long; true if another one can begin.
    pub fn expire(&mut self, now: Instant) -> bool {
        self.pending.take_if(|pending| pending.until <= now);
        self.pending.is_none()
    }

    /// Writes the value, or reads it.
    pub fn request(&mut self, now: Instant, order: Option<u32>, master: &mut Master) {
        let OutputConfig { node, index, subindex, .. } = self.config;
        // After its power-up a node that the master does not manage waits for the start command.
        if master.config(node).is_none() && master.nmt_state(node) == Some(NmtState::PreOperational) {
            master.nmt(Target::Node(node), NmtCommand::Start);
        }
        let ticket = match order {
            Some(value) => master.sdo_write(now, node, index, subindex, self.config.bytes(value).as_slice()),
            None => master.sdo_read(now, node, index, subindex),
        };
        let until = now + PATIENCE;
        self.pending = ticket.ok().map(|ticket| Pending { ticket, written: order, until });
    }

    /// A transfer has ended: with the data that was read, or without data if it was a write; `None`: it failed. `None`
    /// if it is not one of these, else the value that the output has now, if it is known.
    pub fn on_sdo(&mut self, ticket: Ticket, result: Option<&[u8]>) -> Option<Option<u32>> {
        let Pending { written, .. } = self.pending.take_if(|pending| pending.ticket == ticket)?;
        Some(result.and_then(|data| written.or_else(|| self.config.value(data))))
    }

    /// Time at which the pending transfer is given up.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.pending.as_ref().map(|pending| pending.until)
    }
}
