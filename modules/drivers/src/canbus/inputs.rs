//! Digital inputs of drives that stop the robot (`[stop]`), read by SDO: not every drive maps them into a PDO, and one
//! that does sends changes only, so that silence would prove nothing.
//!
//! Timing    each drive with such inputs is asked in [`PERIOD`] while it is booted; none while another master is on
//!           the bus, since a request would end its transfer, and nothing moves then
//! Silence   a value counts for `pause::FIELDS_TIMEOUT` from the request that it answers. A drive that is lost, does
//!           not answer, or refuses the object is not known, and that is PAUSE

use super::axis::Axis;
use super::config::Stop;
use super::devices;
use super::net::NodeAt;
use super::pause::{InputName, PauseLine};
use crate::io::Canopen;
use base::{Duration, Instant};
use canopen::Master;
use canopen::master::Ticket;

/// Period of reading.
const PERIOD: Duration = Duration::from_millis(100);
/// Digital inputs of a drive (CiA 402).
const INPUTS: u16 = 0x60FD;

/// Inputs of one drive.
#[derive(Debug)]
struct OfDrive {
    node: NodeAt,
    /// Place among the inputs of the configuration, and bit.
    bits: Vec<(usize, u8)>,
    due: Instant,
    /// Current request, and when it was made.
    asked: Option<(Ticket, Instant)>,
}

/// Inputs of all drives.
#[derive(Debug)]
pub(super) struct DriveInputs(Vec<OfDrive>);

/// All inputs that stop the robot, by their names; `devices` are read by this driver, other signals by `driver_io`.
pub(super) fn names(stop: &Stop, devices: &[Canopen]) -> Vec<InputName> {
    let own = |signal: &String| devices::has_signal(devices, signal);
    let name =
        |input: &super::StopInput| InputName { name: input.source(), own: input.signal.as_ref().is_none_or(own) };
    stop.inputs.iter().map(name).collect()
}

impl DriveInputs {
    /// `drives`: axis and node of each drive of CANopen.
    pub(super) fn new(stop: &Stop, drives: impl Iterator<Item = (Axis, NodeAt)>) -> Self {
        let of_drive = |(axis, node)| {
            let inputs = stop.inputs.iter().enumerate();
            let inputs = inputs.filter(|(_, input)| input.axis == Some(axis) && input.signal.is_none());
            let bits = inputs.filter_map(|(place, input)| Some((place, input.bit?))).collect();
            OfDrive { node, bits, due: Instant::ZERO, asked: None }
        };
        Self(drives.map(of_drive).filter(|drive| !drive.bits.is_empty()).collect())
    }

    /// Reads what is due on a bus. `is_booted`: of a node; `alone`: there is no other master.
    pub(super) fn advance(
        &mut self,
        now: Instant,
        (bus, alone): (usize, bool),
        is_booted: impl Fn(NodeAt) -> bool,
        master: &mut Master,
    ) {
        for drive in self.0.iter_mut().filter(|drive| drive.node.bus == bus) {
            if !is_booted(drive.node) {
                (drive.asked, drive.due) = (None, now);
            } else if drive.asked.is_none() && drive.due <= now {
                drive.due = now + PERIOD;
                let read = alone.then(|| master.sdo_read(now, drive.node.id, INPUTS, 0).ok()).flatten();
                drive.asked = read.map(|ticket| (ticket, now));
            }
        }
    }

    /// A transfer has ended; false if it is not one of these.
    pub(super) fn on_sdo(&mut self, ticket: Ticket, data: Option<&[u8]>, line: &mut PauseLine) -> bool {
        for drive in &mut self.0 {
            let Some((_, at)) = drive.asked.take_if(|(own, _)| *own == ticket) else { continue };
            // Some drives have fewer than 32 bits.
            let Some(bytes) = data.filter(|data| (1..=4).contains(&data.len())) else { return true };
            let value = bytes.iter().rev().fold(0_u32, |value, byte| value << 8 | u32::from(*byte));
            for (place, bit) in &drive.bits {
                line.on_input(at, *place, value >> bit & 1 == 0);
            }
            return true;
        }
        false
    }

    /// When the next request is due, of drives that are booted.
    pub(super) fn poll_timeout(&self, is_booted: impl Fn(NodeAt) -> bool) -> Option<Instant> {
        let due = self.0.iter().filter(|drive| drive.asked.is_none() && is_booted(drive.node));
        due.map(|drive| drive.due).min()
    }
}
