//! Drives as they are on the wire: where their commands and reports are.
//!
//! The rules know one language, that of CANopen with CiA 402: identifiers, data, controlword and statusword. An
//! ODrive is read as such a drive where its frames are looked at. Of any other motor controller a [`Reader`] reads
//! the traffic, and the [`Listener`] passes on what a CANopen drive would have sent, as telegrams with identifiers
//! beyond those of CAN. So a further protocol is a file with its reader, and a line in [`Protocol`], in
//! [`Drive::reader`] and in each function of what other programs can do to it.
//!
//! Nodes on two buses may have the same id. So identifiers are those of all buses: [`on_bus`] of the frame's own one.

mod roboclaw;
mod telegram;
mod vesc;

pub use roboclaw::RoboClaw;
pub use telegram::{Heartbeat, Meaning, Reader};
pub use vesc::Vesc;

use base::can::{Frame, Id};
use base::serial::Word;
use telegram::{DRIVE, FAULT, OPERATION_ENABLED, SWITCH_ON_DISABLED};

/// Number of the standard identifiers of a CAN bus.
const IDS: u16 = 0x800;
/// Greatest number of CAN buses: the identifiers of telegrams are beyond theirs.
pub const BUSES_MAX: usize = (TELEGRAMS / IDS) as usize;

/// An identifier of the frames on a bus, less than 0x800, among those of all buses.
#[must_use]
pub const fn on_bus(bus: u8, id: u16) -> u16 {
    IDS * bus as u16 + id
}

/// Place in the frames of an identifier: bytes before a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The identifier, among those of all buses.
    pub id: u16,
    /// Bytes before the value.
    pub at: usize,
}

/// Protocol by which a drive is commanded.
#[derive(Clone, Debug, PartialEq)]
pub enum Protocol {
    /// CANopen with CiA 402: controlword and statusword in PDOs, the target a signed integer.
    Canopen,
    /// CAN Simple of an ODrive: the set-point is a velocity, a float; the heartbeat has its state.
    CanSimple {
        /// Endpoint of `axis0.config.enable_watchdog`: what another master writes to take its stop away.
        enable_watchdog: u16,
    },
    /// A VESC on CAN.
    VescOnCan(Vesc),
    /// A VESC on a serial line.
    VescOnUart {
        /// The line: `serial.left`.
        line: String,
        /// The device.
        vesc: Vesc,
    },
    /// A motor of a RoboClaw.
    RoboClaw {
        /// The line: `serial.wheels`.
        line: String,
        /// The motor.
        of: RoboClaw,
    },
}

/// A drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Protocol by which it is commanded.
    pub protocol: Protocol,
    /// Number of its CAN bus, in [`Limits::buses`](super::Limits::buses).
    pub bus: u8,
    /// Node id; of CAN Simple the upper six bits of its identifiers; of a controller that a reader reads its number.
    pub node: u8,
    /// The controlword in its RPDO; of CAN Simple the set-point of the velocity.
    pub command: Place,
    /// Bytes before the target in that frame, 32 bits; 64 bits in a telegram.
    pub target: usize,
    /// The statusword in each TPDO that has it; of CAN Simple the heartbeat.
    pub reports: Vec<Place>,
}

/// CAN Simple (ODrive documentation, "CAN Protocol"): messages by the lowest five bits of an identifier.
mod can_simple {
    pub const HEARTBEAT: u16 = 0x01;
    pub const ESTOP: u16 = 0x02;
    pub const RX_SDO: u16 = 0x04;
    pub const SET_AXIS_STATE: u16 = 0x07;
    pub const SET_CONTROLLER_MODE: u16 = 0x0B;
    pub const SET_INPUT_VEL: u16 = 0x0D;
    pub const SET_INPUT_TORQUE: u16 = 0x0E;
    pub const CLEAR_ERRORS: u16 = 0x18;
    /// Operation of an RxSdo that changes a parameter.
    pub const WRITE: u8 = 1;
    /// States of an axis: IDLE, CLOSED_LOOP_CONTROL.
    pub const IDLE: u8 = 1;
    pub const CLOSED_LOOP: u8 = 8;
}

/// Velocity of the motor below which a set-point of CAN Simple is 0, turns/s: 1 rpm, the least that the CANopen drives
/// here can be commanded. A ramp in floating point ends with less.
const STANDS_TURNS_PER_S: f64 = 1.0 / 60.0;
/// Bits of a statusword that have the state (CiA 402-2).
const STATE_MASK: u16 = 0x6F;
/// First identifier of the telegrams, more than CAN has; each drive has as many of them.
const TELEGRAMS: u16 = 0x8000;
const TELEGRAMS_OF_DRIVE: u16 = 4;
/// The telegrams of a drive, by what they mean.
const COMMAND: u16 = 0;
const STATUS: u16 = 1;
const HEARTBEAT: u16 = 2;
/// First identifier of emergencies, and the code of one whose master is silent (CiA 301).
const EMERGENCY: u16 = 0x80;
const HEARTBEAT_LOST: [u8; 2] = 0x8130u16.to_le_bytes();
/// NMT states in a heartbeat (CiA 301).
const BOOT_UP: u8 = 0;
const OPERATIONAL: u8 = 5;
/// The same of a telegram, beside [`OPERATIONAL`].
const DOWN: u8 = 0;
const OTHER: u8 = 127;
/// Ramp of the quick stop that a foreign SDO request sets, rpm/s: two metres and more to a stand.
const RAMP_RPM_PER_S: u8 = 60;

/// A driven wheel, or the driven axle.
#[derive(Clone, Debug, PartialEq)]
pub struct Wheel {
    /// Name of its axis: `propulsion`, `left`.
    pub name: String,
    /// Its drive.
    pub drive: Drive,
    /// Low byte of the controlword by which it stops.
    pub stop_word: u8,
    /// Target at 1 m/s.
    pub units_per_mps: f64,
}

impl Drive {
    /// An ODrive with this node id by CAN Simple; `enable_watchdog` is an endpoint of its firmware.
    #[must_use]
    pub fn can_simple(bus: u8, node: u8, enable_watchdog: u16) -> Self {
        let place = |message| Place { id: on_bus(bus, u16::from(node) << 5 | message), at: 0 };
        Self {
            protocol: Protocol::CanSimple { enable_watchdog },
            bus,
            node,
            command: place(can_simple::SET_INPUT_VEL),
            target: 0,
            reports: vec![place(can_simple::HEARTBEAT)],
        }
    }

    /// The wheel of this number, driven by a motor controller whose traffic a reader reads; `bus`: if it is on CAN.
    #[must_use]
    pub fn of_controller(bus: u8, number: u8, protocol: Protocol) -> Self {
        let place = |what| Place { id: TELEGRAMS + TELEGRAMS_OF_DRIVE * u16::from(number) + what, at: 0 };
        Self { protocol, bus, node: number, command: place(COMMAND), target: 1, reports: vec![place(STATUS)] }
    }

    /// What reads its traffic; none of a drive whose frames are read as they are.
    #[must_use]
    pub fn reader(&self) -> Option<Box<dyn Reader>> {
        Some(match &self.protocol {
            Protocol::Canopen | Protocol::CanSimple { .. } => return None,
            Protocol::VescOnCan(vesc) => Box::new(vesc::OnCan::new(vesc.clone())),
            Protocol::VescOnUart { vesc, .. } => Box::new(vesc::OnUart::new(vesc.clone())),
            Protocol::RoboClaw { of, .. } => Box::new(roboclaw::OnLine::new(of.clone())),
        })
    }

    /// The serial line that it is on; none: it is on CAN.
    #[must_use]
    pub fn line(&self) -> Option<&str> {
        match &self.protocol {
            Protocol::VescOnUart { line, .. } | Protocol::RoboClaw { line, .. } => Some(line),
            _ => None,
        }
    }

    /// Low byte of the controlword, and the target in units of the drive, of the data of its command; `None`: too
    /// short, or no number. A set-point of CAN Simple always drives, also at 0: it has no command that only stops.
    #[must_use]
    pub fn commanded(&self, data: &[u8]) -> Option<(u8, f64)> {
        let target = data.get(self.target..)?;
        match self.protocol {
            Protocol::Canopen => {
                Some((*data.get(self.command.at)?, f64::from(i32::from_le_bytes(*target.first_chunk()?))))
            }
            Protocol::CanSimple { .. } => {
                let target = f64::from(f32::from_le_bytes(*target.first_chunk()?));
                let turns = if target.abs() < STANDS_TURNS_PER_S { 0.0 } else { target };
                Some((DRIVE, turns)).filter(|_| target.is_finite())
            }
            _ => Some((*data.get(self.command.at)?, f64::from_le_bytes(*target.first_chunk()?))),
        }
    }

    /// True if this command moves the drive.
    #[must_use]
    pub fn moves((controlword, target): (u8, f64)) -> bool {
        controlword & DRIVE == DRIVE && target != 0.0
    }

    /// True for a frame that commands this drive to turn; false for one that commands it to stop, or in which it
    /// reports that it stops by itself: a statusword other than operation enabled, of a CANopen drive also the
    /// emergency for a silent master; `None`: any other frame.
    #[must_use]
    pub fn turns(&self, id: u16, data: &[u8]) -> Option<bool> {
        if id == self.command.id {
            return self.commanded(data).map(Self::moves);
        }
        let disabled = || self.reported(id, data).is_some_and(|status| status & STATE_MASK != OPERATION_ENABLED);
        (self.loses_master(id, data) || disabled()).then_some(false)
    }

    /// True for the emergency by which a CANopen drive reports that its master is silent, and that it stops by itself.
    #[must_use]
    pub fn loses_master(&self, id: u16, data: &[u8]) -> bool {
        self.protocol == Protocol::Canopen
            && id == on_bus(self.bus, EMERGENCY + u16::from(self.node))
            && data.starts_with(&HEARTBEAT_LOST)
    }

    /// The frame on its bus that drives it at this target, in units of the drive; none: nobody else can send it one.
    #[must_use]
    pub fn drive_at(&self, target: f64) -> Option<Frame> {
        let data = match &self.protocol {
            Protocol::Canopen => {
                let mut data = vec![0; (self.target + 4).max(self.command.at + 2)];
                data[self.command.at] = DRIVE;
                data[self.target..self.target + 4].copy_from_slice(&(target as i32).to_le_bytes());
                data
            }
            Protocol::CanSimple { .. } => [(target as f32).to_le_bytes(), [0; 4]].concat(),
            Protocol::VescOnCan(vesc) => return vesc.drive_at(target),
            Protocol::VescOnUart { .. } | Protocol::RoboClaw { .. } => return None,
        };
        Some(Frame::standard(self.command.id % IDS, &data))
    }

    /// Statusword in a frame; `None`: it has none. For CAN Simple, the statusword of CiA 402 that corresponds to the
    /// errors and the state in the heartbeat.
    #[must_use]
    pub fn reported(&self, id: u16, data: &[u8]) -> Option<u16> {
        let place = self.reports.iter().find(|place| place.id == id)?;
        match self.protocol {
            Protocol::CanSimple { .. } => {
                let (errors, state) = axis_state(data)?;
                Some(match state {
                    _ if errors => FAULT,
                    can_simple::CLOSED_LOOP => OPERATION_ENABLED,
                    _ => SWITCH_ON_DISABLED,
                })
            }
            _ => Some(u16::from_le_bytes(*data.get(place.at..)?.first_chunk()?)),
        }
    }

    /// What a frame reports if it is the heartbeat of this drive, otherwise `None`.
    #[must_use]
    pub fn heartbeat(&self, id: u16, data: &[u8]) -> Option<Heartbeat> {
        if id != self.heartbeat_id() {
            return None;
        }
        Some(match self.protocol {
            Protocol::Canopen => match data.first() {
                Some(&BOOT_UP) => Heartbeat::Down,
                Some(&OPERATIONAL) => Heartbeat::Operational,
                _ => Heartbeat::Other,
            },
            Protocol::CanSimple { .. } => match axis_state(data) {
                Some((_, can_simple::IDLE)) => Heartbeat::Down,
                Some((false, can_simple::CLOSED_LOOP)) => Heartbeat::Operational,
                _ => Heartbeat::Other,
            },
            _ => match data.first() {
                Some(&DOWN) => Heartbeat::Down,
                Some(&OPERATIONAL) => Heartbeat::Operational,
                _ => Heartbeat::Other,
            },
        })
    }

    /// Identifier of its heartbeat.
    #[must_use]
    pub fn heartbeat_id(&self) -> u16 {
        match self.protocol {
            Protocol::Canopen => on_bus(self.bus, 0x700 + u16::from(self.node)),
            Protocol::CanSimple { .. } => on_bus(self.bus, u16::from(self.node) << 5 | can_simple::HEARTBEAT),
            _ => TELEGRAMS + TELEGRAMS_OF_DRIVE * u16::from(self.node) + HEARTBEAT,
        }
    }

    /// The telegram with this meaning: identifier and data.
    fn telegram(&self, meaning: Meaning) -> (u16, Vec<u8>) {
        match meaning {
            Meaning::Command(controlword, target) => {
                (self.command.id, [&[controlword][..], &target.to_le_bytes()].concat())
            }
            Meaning::Status(status) => {
                (TELEGRAMS + TELEGRAMS_OF_DRIVE * u16::from(self.node) + STATUS, status.to_le_bytes().into())
            }
            Meaning::Heartbeat(heartbeat) => {
                let state = match heartbeat {
                    Heartbeat::Down => DOWN,
                    Heartbeat::Operational => OPERATIONAL,
                    Heartbeat::Other => OTHER,
                };
                (self.heartbeat_id(), vec![state])
            }
        }
    }

    /// True for a frame by which a master commands this drive on its bus: of CANopen an NMT command, SYNC, an RPDO or an
    /// SDO request; of a motor controller a message that changes something. Nobody else is on a serial line.
    #[must_use]
    pub fn is_command(&self, frame: &Frame) -> bool {
        if let Protocol::VescOnCan(vesc) = &self.protocol {
            return vesc.is_command(frame);
        }
        let Id::Standard(id) = frame.id() else { return false };
        let (node, data) = (u16::from(self.node), frame.data());
        match self.protocol {
            Protocol::Canopen => match (id & 0x780, id & 0x7F, data) {
                (0, 0, &[_, to]) => to == 0 || to == self.node,
                (0x80, 0, _) => true,
                (0x200 | 0x300 | 0x400 | 0x500 | 0x600, to, _) => to == node,
                _ => false,
            },
            Protocol::CanSimple { .. } if id >> 5 != node => false,
            Protocol::CanSimple { .. } => match id & 0x1F {
                can_simple::RX_SDO => data.first() == Some(&can_simple::WRITE),
                can_simple::ESTOP
                | can_simple::SET_AXIS_STATE
                | can_simple::SET_CONTROLLER_MODE
                | can_simple::SET_INPUT_VEL
                | can_simple::SET_INPUT_TORQUE
                | can_simple::CLEAR_ERRORS => true,
                _ => false,
            },
            _ => false,
        }
    }

    /// The frame by which another master takes this drive out of operation; none: nobody else can send it one.
    #[must_use]
    pub fn foreign_stop(&self) -> Option<Frame> {
        match &self.protocol {
            // CiA 301, 7.2.8.2.1.2: stop remote node.
            Protocol::Canopen => Some(Frame::standard(0, &[0x02, self.node])),
            Protocol::CanSimple { .. } => {
                let id = u16::from(self.node) << 5 | can_simple::SET_AXIS_STATE;
                Some(Frame::standard(id, &[can_simple::IDLE, 0, 0, 0, 0, 0, 0, 0]))
            }
            Protocol::VescOnCan(vesc) => vesc.foreign_stop(),
            Protocol::VescOnUart { .. } | Protocol::RoboClaw { .. } => None,
        }
    }

    /// The frame by which another master takes the stop of this drive away; none: nobody else can send it one.
    #[must_use]
    pub fn foreign_parameter(&self) -> Option<Frame> {
        match &self.protocol {
            // CiA 301, 7.2.4.3.3: expedited download of four bytes to 0x6085, the quick stop's deceleration.
            Protocol::Canopen => {
                let id = 0x600 + u16::from(self.node);
                Some(Frame::standard(id, &[0x23, 0x85, 0x60, 0, RAMP_RPM_PER_S, 0, 0, 0]))
            }
            Protocol::CanSimple { enable_watchdog } => {
                let [low, high] = enable_watchdog.to_le_bytes();
                let id = u16::from(self.node) << 5 | can_simple::RX_SDO;
                Some(Frame::standard(id, &[can_simple::WRITE, low, high, 0, 0]))
            }
            Protocol::VescOnCan(vesc) => vesc.foreign_parameter(),
            Protocol::VescOnUart { .. } | Protocol::RoboClaw { .. } => None,
        }
    }
}

/// Reads the traffic of all drives that need a reader.
#[derive(Debug)]
pub struct Listener {
    readers: Vec<(Drive, Box<dyn Reader>)>,
}

impl Listener {
    /// Of the drives of these wheels.
    #[must_use]
    pub fn new(wheels: &[Wheel]) -> Self {
        let reader = |wheel: &Wheel| Some((wheel.drive.clone(), wheel.drive.reader()?));
        Self { readers: wheels.iter().filter_map(reader).collect() }
    }

    /// The telegrams of a frame on a bus, as identifiers and data.
    pub fn on_frame(&mut self, bus: u8, frame: &Frame) -> Vec<(u16, Vec<u8>)> {
        let mut all = Vec::new();
        for (drive, reader) in self.readers.iter_mut().filter(|(drive, _)| drive.bus == bus) {
            reader.on_frame(frame, &mut |meaning| all.push(drive.telegram(meaning)));
        }
        all
    }

    /// Identifiers of what is missing if this frame is received by nobody: the heartbeats of its drives.
    pub fn on_frame_lost(&mut self, bus: u8, frame: &Frame) -> Vec<u16> {
        let mut all = Vec::new();
        for (drive, reader) in self.readers.iter_mut().filter(|(drive, _)| drive.bus == bus) {
            if reader.on_frame(frame, &mut |_| {}) {
                all.push(drive.heartbeat_id());
            }
        }
        all
    }

    /// The telegrams of words on a serial line, as identifiers and data.
    pub fn on_words(&mut self, line: &str, by_driver: bool, words: &[Word]) -> Vec<(u16, Vec<u8>)> {
        let mut all = Vec::new();
        for (drive, reader) in self.readers.iter_mut().filter(|(drive, _)| drive.line() == Some(line)) {
            reader.on_words(by_driver, words, &mut |meaning| all.push(drive.telegram(meaning)));
        }
        all
    }
}

/// Errors and state of an axis in the heartbeat of CAN Simple.
fn axis_state(data: &[u8]) -> Option<(bool, u8)> {
    let (errors, rest) = data.split_first_chunk::<4>()?;
    Some((*errors != [0; 4], *rest.first()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_where_the_mapping_has_them() {
        // Target first; the statusword behind a position.
        let drive = Drive {
            protocol: Protocol::Canopen,
            bus: 0,
            node: 1,
            command: Place { id: 0x201, at: 4 },
            target: 0,
            reports: vec![Place { id: 0x181, at: 0 }, Place { id: 0x281, at: 4 }],
        };
        let frame = drive.drive_at(-1000.0).unwrap();
        let data = frame.data();
        assert_eq!(data, [0x18, 0xFC, 0xFF, 0xFF, 0x0F, 0]);
        assert_eq!((drive.commanded(data), drive.commanded(&data[..4])), (Some((0x0F, -1000.0)), None));
        assert_eq!(drive.reported(0x281, &[1, 2, 3, 4, 0x37, 0x92]), Some(0x9237));
        assert_eq!((drive.reported(0x281, &[1, 2, 3, 4, 0x37]), drive.reported(0x381, data)), (None, None));
    }

    #[test]
    fn an_odrive_is_read_as_a_drive_of_cia_402() {
        // Node 3: 0x061 is the heartbeat, 0x06D Set_Input_Vel.
        let drive = Drive::can_simple(0, 3, 0x0123);
        assert_eq!((drive.command.id, drive.heartbeat_id()), (0x06D, 0x061));
        let frame = drive.drive_at(-2.5).unwrap();
        assert_eq!(frame.data(), [0, 0, 0x20, 0xC0, 0, 0, 0, 0]);
        assert_eq!(drive.commanded(frame.data()), Some((0x0F, -2.5)));
        assert!(Drive::moves((0x0F, -2.5)) && !Drive::moves((0x0F, 0.0)) && !Drive::moves((0x0B, 1.0)));
        assert_eq!(drive.commanded(&1e-9_f32.to_le_bytes()), Some((0x0F, 0.0)));
        assert_eq!((drive.commanded(&f32::NAN.to_le_bytes()), drive.commanded(&frame.data()[..3])), (None, None));
        for (data, statusword, heartbeat) in [
            ([0, 0, 0, 0, 8, 0, 0, 0], Some(0x27), Heartbeat::Operational),
            ([0, 0, 0, 0, 1, 0, 0, 0], Some(0x40), Heartbeat::Down),
            ([0, 0, 0, 1, 1, 0, 0, 0], Some(0x08), Heartbeat::Down),
            ([0, 0, 0, 1, 8, 0, 0, 0], Some(0x08), Heartbeat::Other),
        ] {
            assert_eq!((drive.reported(0x061, &data), drive.heartbeat(0x061, &data)), (statusword, Some(heartbeat)));
            assert_eq!((drive.reported(0x041, &data), drive.heartbeat(0x041, &data)), (None, None));
        }
        assert_eq!((drive.reported(0x061, &[0; 4]), drive.heartbeat(0x061, &[])), (None, Some(Heartbeat::Other)));
    }

    #[test]
    fn drives_with_the_same_node_id_on_two_buses_are_told_apart() {
        let canopen = |bus| {
            let place = |id| Place { id: on_bus(bus, id), at: 0 };
            let (command, reports) = (place(0x201), vec![place(0x181)]);
            Drive { protocol: Protocol::Canopen, bus, node: 1, command, target: 2, reports }
        };
        let drives = [canopen(0), canopen(1), Drive::can_simple(2, 3, 251)];
        let ids = drives.each_ref().map(|drive| [drive.command.id, drive.heartbeat_id(), drive.reports[0].id]);
        assert_eq!(ids, [[0x201, 0x701, 0x181], [0xA01, 0xF01, 0x981], [0x106D, 0x1061, 0x1061]]);
        // A frame has the identifier of its bus.
        let frames = drives.each_ref().map(|drive| drive.drive_at(2.0).map(|frame| frame.id()));
        assert_eq!(frames, [0x201, 0x201, 0x06D].map(|id| Some(Id::Standard(id))));
        let lost = [0x30, 0x81, 0x11];
        for (drive, bus) in drives[..2].iter().zip(0..) {
            for other in 0..2 {
                assert_eq!(drive.turns(on_bus(other, 0x081), &lost), (other == bus).then_some(false));
                assert_eq!(drive.reported(on_bus(other, 0x181), &[0x37, 2]).is_some(), other == bus);
                assert_eq!(drive.heartbeat(on_bus(other, 0x701), &[5]).is_some(), other == bus);
            }
        }
        // The last bus does not reach into the telegrams.
        assert_eq!(BUSES_MAX, 16);
        assert!(on_bus(15, 0x7FF) < TELEGRAMS);
    }

    #[test]
    fn a_drive_turns_until_a_command_or_its_own_report_stops_it() {
        let place = |id| Place { id, at: 0 };
        let canopen = Drive {
            protocol: Protocol::Canopen,
            bus: 0,
            node: 1,
            command: place(0x201),
            target: 2,
            reports: vec![place(0x181)],
        };
        let odrive = Drive::can_simple(0, 3, 0x0123);
        let below_1_rpm = 0.01_f32.to_le_bytes();
        for (drive, id, data, expected) in [
            (&canopen, 0x201, &[0x0F, 0, 1, 0, 0, 0][..], Some(true)),
            (&canopen, 0x201, &[0x0F, 0, 0, 0, 0, 0], Some(false)),
            (&canopen, 0x201, &[0x0B, 0, 1, 0, 0, 0], Some(false)),
            (&canopen, 0x201, &[0x0F, 0, 1], None),
            (&canopen, 0x081, &[0x30, 0x81, 0x11], Some(false)),
            (&canopen, 0x081, &[0x10, 0x23, 0x03], None),
            (&canopen, 0x082, &[0x30, 0x81, 0x11], None),
            (&canopen, 0x181, &[0x37, 0x02], None),
            (&canopen, 0x181, &[0x17, 0x02], Some(false)),
            (&odrive, 0x06D, &[0, 0, 0x20, 0xC0], Some(true)),
            (&odrive, 0x06D, &below_1_rpm, Some(false)),
            (&odrive, 0x061, &[0, 0, 0, 0, 8], None),
            (&odrive, 0x061, &[0, 0, 0, 0, 1], Some(false)),
            (&odrive, 0x083, &[0x30, 0x81, 0x11], None),
        ] {
            assert_eq!(drive.turns(id, data), expected, "{id:#x} {data:?}");
        }
    }

    #[test]
    fn a_command_of_a_master_is_one_that_changes_something() {
        let odrive = Drive::can_simple(0, 3, 0x0123);
        let canopen = Drive { protocol: Protocol::Canopen, node: 1, ..odrive.clone() };
        for (drive, id, data, expected) in [
            (&odrive, 0x06D, &[0; 8][..], true),
            (&odrive, 0x067, &[1, 0, 0, 0], true),
            (&odrive, 0x064, &[1, 0x23, 1, 0, 0], true),
            (&odrive, 0x064, &[0, 0x23, 1, 0], false),
            (&odrive, 0x077, &[], false),
            (&odrive, 0x04D, &[0; 8], false),
            (&odrive, 0, &[2, 3], false),
            (&canopen, 0, &[2, 1], true),
            (&canopen, 0, &[2, 2], false),
            (&canopen, 0x80, &[], true),
            (&canopen, 0x601, &[0; 8], true),
            (&canopen, 0x602, &[0; 8], false),
            (&canopen, 0x181, &[0; 2], false),
        ] {
            assert_eq!(drive.is_command(&Frame::standard(id, data)), expected, "{id:#x} {data:?}");
        }
        for drive in [&odrive, &canopen] {
            for frame in [drive.foreign_stop(), drive.foreign_parameter()].map(Option::unwrap) {
                assert!(drive.is_command(&frame), "{frame:?}");
            }
        }
    }
}
