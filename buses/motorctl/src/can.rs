//! Devices on CAN with one axis, whichever they are: one engine for all of them, and their emulations.

use crate::config::{Config, ConfigError};
use crate::engine::{Engine, Progress, Protocol, Setpoint, Shared};
use crate::motor::Motor;
use crate::{odrive, vesc};
use base::Instant;
use base::can::{Frame, Id};

/// Engine of one device on CAN.
pub type OnCan = Engine<CanProtocol, 1>;

/// Which device it must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Device {
    /// An ODrive by CAN Simple.
    Odrive(odrive::Device),
    /// A VESC.
    Vesc {
        /// The device.
        device: vesc::Device,
        /// The id to which it answers: each engine on the bus needs its own, and no VESC may have it.
        host: u8,
    },
}

/// Its protocol.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no allocator for a box, and a robot has a few of them")]
pub enum CanProtocol {
    /// ODrive.
    Odrive(odrive::CanSimple),
    /// VESC.
    Vesc(vesc::Commands<vesc::can::Link>),
}

impl Device {
    /// True for a frame of this device, or to it.
    #[must_use]
    pub fn owns(&self, frame: &Frame) -> bool {
        match (self, frame.id()) {
            (Self::Odrive(device), Id::Standard(id)) => odrive::wire::node_of(id) == device.node,
            (Self::Vesc { device, host }, Id::Extended(id)) => {
                let [.., to] = id.to_be_bytes();
                [device.id, *host, vesc::can::TO_ALL].contains(&to)
            }
            _ => false,
        }
    }

    /// True for a frame by which this device is commanded or configured, by whomever; one that asks it for something is
    /// not.
    #[must_use]
    pub fn is_commanded_by(&self, frame: &Frame) -> bool {
        match self {
            Self::Odrive(device) => odrive::wire::changes(device.node, frame),
            Self::Vesc { device, host } => vesc::can::is_command(frame, device.id, *host),
        }
    }
}

impl OnCan {
    /// An engine for this device. Its first [`Engine::handle_timeout`] starts it.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn new(config: &Config<1>, device: Device) -> Result<Self, ConfigError> {
        config.check()?;
        let protocol = match device {
            Device::Odrive(device) => CanProtocol::Odrive(odrive::CanSimple::checked(device, config.timing)?),
            Device::Vesc { device, host } => CanProtocol::Vesc(vesc::Commands::on_can(device, host, config.timing)?),
        };
        Ok(Self::with(protocol, config))
    }
}

/// Passes a call on to the protocol of the device.
macro_rules! of_device {
    ($protocol:expr, $own:ident => $call:expr) => {
        match $protocol {
            CanProtocol::Odrive($own) => $call,
            CanProtocol::Vesc($own) => $call,
        }
    };
}

impl Protocol<1> for CanProtocol {
    type Rx = Frame;
    type Tx = Frame;

    fn start(&mut self, now: Instant) {
        of_device!(self, own => own.start(now));
    }

    fn reset(&mut self) {
        of_device!(self, own => own.reset());
    }

    fn withdraw(&mut self, now: Instant) {
        of_device!(self, own => own.withdraw(now));
    }

    fn handle_rx(&mut self, now: Instant, frame: &Frame, shared: &mut Shared<1>) -> Progress {
        of_device!(self, own => own.handle_rx(now, frame, shared))
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared<1>) -> Progress {
        of_device!(self, own => own.handle_timeout(now, shared))
    }

    fn send(&mut self, now: Instant, setpoint: &Setpoint<1>, shared: &Shared<1>) {
        of_device!(self, own => own.send(now, setpoint, shared));
    }

    fn halt(&mut self, now: Instant) {
        of_device!(self, own => own.halt(now));
    }

    fn disarm(&mut self, now: Instant) {
        of_device!(self, own => own.disarm(now));
    }

    fn poll_tx(&mut self, now: Instant) -> Option<Frame> {
        of_device!(self, own => own.poll_tx(now))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        of_device!(self, own => own.poll_timeout())
    }
}

/// The other end of any of them, for the simulator and for tests.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no allocator for a box, and a robot has a few of them")]
pub enum Emulated {
    /// An ODrive.
    Odrive(odrive::device::Device),
    /// A VESC.
    Vesc(vesc::device::Device<vesc::can::Link>),
}

impl Emulated {
    /// A device at power-on.
    #[must_use]
    pub fn new(device: Device) -> Self {
        match device {
            Device::Odrive(device) => Self::Odrive(odrive::device::Device::new(device)),
            Device::Vesc { device, .. } => {
                let mut own = vesc::device::Device::new(device, vesc::can::Link::device(device.id));
                own.fault_stop = vesc::device::FAULT_STOP;
                Self::Vesc(own)
            }
        }
    }

    /// Its motor.
    #[must_use]
    pub fn motor(&self) -> &Motor {
        match self {
            Self::Odrive(own) => &own.motor,
            Self::Vesc(own) => &own.motor,
        }
    }

    /// Its motor.
    pub fn motor_mut(&mut self) -> &mut Motor {
        match self {
            Self::Odrive(own) => &mut own.motor,
            Self::Vesc(own) => &mut own.motor,
        }
    }

    /// Raises a fault, as its own checks do: error bits of an ODrive, of which there is at least one; the code of a
    /// VESC, from 1.
    pub fn raise(&mut self, fault: u16) {
        match self {
            Self::Odrive(own) => own.raise(fault.max(1).into()),
            Self::Vesc(own) => own.raise(u8::try_from(fault).unwrap_or(u8::MAX).max(1)),
        }
    }

    /// Takes a frame.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        match self {
            Self::Odrive(own) => own.handle_rx(now, frame),
            Self::Vesc(own) => own.handle_rx(now, frame),
        }
    }

    /// Moves the motor, checks, and sends what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Odrive(own) => own.handle_timeout(now),
            Self::Vesc(own) => own.handle_timeout(now),
        }
    }

    /// Next frame.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        match self {
            Self::Odrive(own) => own.poll_tx(),
            Self::Vesc(own) => own.poll_tx(),
        }
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Odrive(own) => own.poll_timeout(),
            Self::Vesc(own) => own.poll_timeout(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, State};

    fn frame(id: Id, data: &[u8]) -> Frame {
        Frame::new(id, data).unwrap()
    }

    const DEVICES: [Device; 2] = [
        Device::Odrive(odrive::Device { node: 3, ..odrive::Device::EXAMPLE }),
        Device::Vesc { device: vesc::Device { erpm_min: 60.0, ..vesc::Device::EXAMPLE }, host: 254 },
    ];

    #[test]
    fn one_engine_drives_any_device() {
        for device in DEVICES {
            let axis = Axis { gear: 8.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
            let mut engine = OnCan::new(&Config::new([axis]), device).unwrap();
            let mut end = Emulated::new(device);
            for now in (1..2000).map(Instant::from_millis) {
                engine.handle_timeout(now);
                end.handle_timeout(now);
                if engine.state() == State::Ready {
                    engine.command(now, [2.0]).unwrap();
                }
                while let Some(frame) = engine.poll_tx(now) {
                    assert!(device.owns(&frame), "{frame:?}");
                    end.handle_rx(now, &frame);
                }
                while let Some(frame) = end.poll_tx() {
                    assert!(device.owns(&frame) && !device.is_commanded_by(&frame), "{frame:?}");
                    engine.handle_rx(now, &frame);
                }
            }
            let velocity = engine.feedback(0).unwrap().velocity_radps;
            assert!((velocity - 2.0).abs() < 0.02, "{device:?} {velocity}");
        }
    }

    #[test]
    fn commands_of_anybody_are_recognized_and_questions_are_none() {
        let [odrive, vesc] = DEVICES;
        // Set_Input_Vel to node 3, Get_Error of node 3, Set_Input_Vel to node 4.
        for (id, data, expected) in [(0x6D, &[0; 8][..], true), (0x63, &[], false), (0x8D, &[0; 8], false)] {
            assert_eq!(odrive.is_commanded_by(&frame(Id::Standard(id), data)), expected, "{id:x}");
        }
        // RxSdo that writes a bool, a value of two bytes, and nothing; that reads; empty. Set_Limits, Reboot,
        // Clear_Errors without data, Set_Vel_Gains, Enter_DFU_Mode; what the axis sends: heartbeat, TxSdo, estimates.
        for (id, data, expected) in [
            (0x64, &[1, 0xFA, 1, 0, 0][..], true),
            (0x64, &[1, 0x10, 1, 0, 0x10, 0x27], true),
            (0x64, &[1], true),
            (0x64, &[0, 0xFA, 1, 0], false),
            (0x64, &[], false),
            (0x84, &[1, 0xFA, 1, 0, 0], false),
            (0x66, &[0; 8], true),
            (0x7E4, &[1, 0xFA, 1, 0, 0], true),
            (0x7E6, &[0; 8], false),
            (0x6F, &[0; 8], true),
            (0x76, &[], true),
            (0x78, &[], true),
            (0x7B, &[0; 8], true),
            (0x7F, &[], true),
            (0x61, &[0; 8], false),
            (0x65, &[0, 0xFA, 1, 0, 1], false),
            (0x69, &[0; 8], false),
        ] {
            assert_eq!(odrive.is_commanded_by(&frame(Id::Standard(id), data)), expected, "{id:x} {data:?}");
        }
        // CAN_PACKET_SET_RPM to 23 and to all; to 24; COMM_GET_VALUES by 7; COMM_SET_RPM by 7, and by the host itself.
        for (id, data, expected) in [
            (0x0317, &[0, 0, 1, 0][..], true),
            (0x00FF, &[0, 0, 1, 0], true),
            (0x0318, &[0, 0, 1, 0], false),
            (0x0817, &[7, 0, 4], false),
            (0x0817, &[7, 0, 8, 0, 0, 1], true),
            (0x0817, &[254, 0, 8, 0, 0, 1], false),
            // CAN_PACKET_CONF_CURRENT_LIMITS, CAN_PACKET_SHUTDOWN, CAN_PACKET_STATUS; COMM_ALIVE, which feeds the
            // timeout, and a payload that is not known, by 7; the begin of COMM_SET_APPCONF and of an
            // answer COMM_GET_APPCONF.
            (0x1517, &[0; 8], true),
            (0x1F17, &[], true),
            (0x0917, &[0; 8], false),
            (0x0817, &[7, 0, 30], true),
            (0x0817, &[7, 0, 158, 0], true),
            (0x0517, &[0, 16, 0, 0, 0, 0, 0, 0], true),
            (0x0517, &[0, 17, 0, 0, 0, 0, 0, 0], false),
            (0x0517, &[7, 16, 0, 0, 0, 0, 0, 0], false),
        ] {
            assert_eq!(vesc.is_commanded_by(&frame(Id::Extended(id), data)), expected, "{id:x} {data:?}");
        }
        assert!(!vesc.owns(&frame(Id::Standard(0x17), &[])) && !odrive.owns(&frame(Id::Extended(0x6D), &[])));
    }
}
