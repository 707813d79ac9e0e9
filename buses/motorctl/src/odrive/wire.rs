//! CAN Simple: identifiers and data of the messages that the engine and the emulated axis exchange; stateless.
//!
//! Layouts: "CAN Protocol" of the ODrive documentation 0.5.6 (`can_id = axis_id << 5 | cmd_id`, little endian); the
//! messages that 0.6 changed or added (0x00, 0x01, 0x03, 0x04, 0x05, 0x15) by ODriveArduino, `can_simple_messages.hpp`,
//! commit f52eef5, and ODriveResources, `examples/can_param_access.py`, commit 06dc846.

use base::can::{Frame, Id};

/// Greatest node id; 0x3F is taken for an axis without one.
pub const NODE_MAX: u8 = 0x3E;
/// Node id of an axis without one; taken for one that all receive, too.
const TO_ALL: u8 = 0x3F;

/// Axis state IDLE.
pub const IDLE: u8 = 1;
/// Axis state CLOSED_LOOP_CONTROL.
pub const CLOSED_LOOP: u8 = 8;

/// Control mode TORQUE_CONTROL.
pub const TORQUE_CONTROL: u32 = 1;
/// Control mode VELOCITY_CONTROL.
pub const VELOCITY_CONTROL: u32 = 2;
/// Input mode PASSTHROUGH.
pub const PASSTHROUGH: u32 = 1;

/// Error bits of an axis, `ODrive.Error` of firmware 0.6.
pub mod error {
    /// Current of the supply above its limit.
    pub const DC_BUS_OVER_CURRENT: u32 = 0x0000_0400;
    /// Motor current above its limit.
    pub const CURRENT_LIMIT_VIOLATION: u32 = 0x0000_1000;
    /// No message within the watchdog's time.
    pub const WATCHDOG_TIMER_EXPIRED: u32 = 0x0100_0000;
    /// The message Estop arrived.
    pub const ESTOP_REQUESTED: u32 = 0x0200_0000;
    /// Encoder and motor turn in different ways.
    pub const SPINOUT_DETECTED: u32 = 0x0400_0000;
}

const VERSION: u8 = 0x00;
const HEARTBEAT: u8 = 0x01;
const ESTOP: u8 = 0x02;
const ERROR: u8 = 0x03;
const RX_SDO: u8 = 0x04;
const TX_SDO: u8 = 0x05;
const ADDRESS: u8 = 0x06;
const AXIS_STATE: u8 = 0x07;
const ESTIMATES: u8 = 0x09;
const CONTROLLER_MODE: u8 = 0x0B;
const INPUT_VEL: u8 = 0x0D;
const INPUT_TORQUE: u8 = 0x0E;
const IQ: u8 = 0x14;
const TEMPERATURE: u8 = 0x15;
const BUS: u8 = 0x17;
const CLEAR_ERRORS: u8 = 0x18;

/// Messages that move an axis or change what it does, beside RxSdo: Estop, Address, Set_Axis_State, the modes, inputs,
/// limits and trajectories from 0x0B on, Reboot, Clear_Errors, Set_Absolute_Position, the gains, Enter_DFU_Mode.
const CHANGES: [u8; 18] = [
    ESTOP,
    ADDRESS,
    AXIS_STATE,
    0x08,
    CONTROLLER_MODE,
    0x0C,
    INPUT_VEL,
    INPUT_TORQUE,
    0x0F,
    0x10,
    0x11,
    0x12,
    0x13,
    0x16,
    CLEAR_ERRORS,
    0x19,
    0x1B,
    0x1F,
];

/// Operation of an RxSdo.
const SDO_READ: u8 = 0;
const SDO_WRITE: u8 = 1;

/// Hardware and firmware of a device, as Get_Version has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Version {
    /// Version of the protocol.
    pub protocol: u8,
    /// Product line, version and variant of the hardware.
    pub hardware: [u8; 3],
    /// Major, minor and revision of the firmware.
    pub firmware: [u8; 3],
    /// Not 0: no released firmware.
    pub unreleased: u8,
}

impl Version {
    fn from_bytes(bytes: [u8; 8]) -> Self {
        let [protocol, h0, h1, h2, f0, f1, f2, unreleased] = bytes;
        Self { protocol, hardware: [h0, h1, h2], firmware: [f0, f1, f2], unreleased }
    }

    fn to_bytes(self) -> [u8; 8] {
        let ([h0, h1, h2], [f0, f1, f2]) = (self.hardware, self.firmware);
        [self.protocol, h0, h1, h2, f0, f1, f2, self.unreleased]
    }
}

/// Value of a parameter: a bool or a float.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// One byte.
    Bool(bool),
    /// Four bytes, IEEE 754.
    Float(f32),
}

/// Message of the master to an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Get_Version; no data.
    GetVersion,
    /// Estop.
    Estop,
    /// Get_Error; no data.
    GetError,
    /// RxSdo that reads.
    Read {
        /// Number of the parameter.
        endpoint: u16,
    },
    /// RxSdo that writes.
    Write {
        /// Number of the parameter.
        endpoint: u16,
        /// Its new value.
        value: Value,
    },
    /// Set_Axis_State.
    SetAxisState(u32),
    /// Set_Controller_Mode.
    SetControllerMode {
        /// Control mode.
        control: u32,
        /// Input mode.
        input: u32,
    },
    /// Set_Input_Vel, turns/s; the torque that is added, 0, is not sent otherwise.
    SetInputVel(f32),
    /// Set_Input_Torque, N m.
    SetInputTorque(f32),
    /// Get_Iq; no data.
    GetIq,
    /// Get_Temperature; no data.
    GetTemperature,
    /// Get_Bus_Voltage_Current; no data.
    GetBus,
    /// Clear_Errors, without identification of the device.
    ClearErrors,
}

/// True for a frame that moves the axis with this node id or changes what it does, whatever its values and its length
/// are; false for questions, and for what the axis itself sends.
#[must_use]
pub fn changes(node: u8, frame: &Frame) -> bool {
    match address(frame) {
        Some((to, _)) if ![node, TO_ALL].contains(&to) => false,
        // An axis without a node id asks for one.
        Some((TO_ALL, ADDRESS)) => false,
        Some((_, RX_SDO)) => frame.data().first().is_some_and(|operation| *operation != SDO_READ),
        Some((_, command)) => CHANGES.contains(&command),
        None => false,
    }
}

/// Node id in an identifier.
#[must_use]
pub const fn node_of(id: u16) -> u8 {
    (id >> 5) as u8
}

/// Message of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Get_Version.
    Version(Version),
    /// Heartbeat.
    Heartbeat {
        /// Error bits.
        errors: u32,
        /// Axis state.
        state: u8,
    },
    /// Get_Error.
    Errors {
        /// Error bits that are active.
        active: u32,
        /// Error bits for which the axis was disarmed last.
        disarm: u32,
    },
    /// TxSdo: the value of a parameter. A bool is a value of one byte, a float of four.
    Parameter {
        /// Its number.
        endpoint: u16,
        /// Its value.
        value: Value,
    },
    /// Get_Encoder_Estimates.
    Estimates {
        /// Turns.
        position: f32,
        /// Turns/s.
        velocity: f32,
    },
    /// Get_Iq: measured current, A.
    Iq(f32),
    /// Get_Temperature: power stage, °C.
    Temperature(f32),
    /// Get_Bus_Voltage_Current: voltage, V.
    Bus(f32),
}

fn frame(node: u8, command: u8, data: &[u8]) -> Frame {
    Frame::standard(u16::from(node) << 5 | u16::from(command), data)
}

/// Node and command of a frame; none for one that is not CAN Simple.
fn address(frame: &Frame) -> Option<(u8, u8)> {
    match frame.id() {
        Id::Standard(id) => Some((node_of(id), (id & 0x1F) as u8)),
        Id::Extended(_) => None,
    }
}

fn pair(first: [u8; 4], second: [u8; 4]) -> [u8; 8] {
    let mut data = [0; 8];
    data[..4].copy_from_slice(&first);
    data[4..].copy_from_slice(&second);
    data
}

fn halves(data: &[u8]) -> Option<([u8; 4], [u8; 4])> {
    let [a, b, c, d, e, f, g, h] = *data else { return None };
    Some(([a, b, c, d], [e, f, g, h]))
}

fn floats(data: &[u8]) -> Option<(f32, f32)> {
    let (first, second) = halves(data)?;
    let (first, second) = (f32::from_le_bytes(first), f32::from_le_bytes(second));
    (first.is_finite() && second.is_finite()).then_some((first, second))
}

/// Operation, parameter and value of an SDO.
fn sdo(data: &[u8]) -> Option<(u8, u16, Option<Value>)> {
    let [operation, low, high, _, value @ ..] = data else { return None };
    let value = match *value {
        [] => None,
        [byte @ 0..=1] => Some(Value::Bool(byte == 1)),
        [a, b, c, d] => Some(Value::Float(f32::from_le_bytes([a, b, c, d]))),
        _ => return None,
    };
    Some((*operation, u16::from_le_bytes([*low, *high]), value))
}

fn sdo_frame(node: u8, command: u8, operation: u8, endpoint: u16, value: Option<Value>) -> Frame {
    let [low, high] = endpoint.to_le_bytes();
    let head = [operation, low, high, 0];
    match value {
        None => frame(node, command, &head),
        Some(Value::Bool(value)) => {
            let [a, b, c, d] = head;
            frame(node, command, &[a, b, c, d, u8::from(value)])
        }
        Some(Value::Float(value)) => frame(node, command, &pair(head, value.to_le_bytes())),
    }
}

impl Command {
    /// The frame to the axis with this node id.
    #[must_use]
    pub fn frame(self, node: u8) -> Frame {
        match self {
            Self::GetVersion => frame(node, VERSION, &[]),
            Self::Estop => frame(node, ESTOP, &[]),
            Self::GetError => frame(node, ERROR, &[]),
            Self::Read { endpoint } => sdo_frame(node, RX_SDO, SDO_READ, endpoint, None),
            Self::Write { endpoint, value } => sdo_frame(node, RX_SDO, SDO_WRITE, endpoint, Some(value)),
            Self::SetAxisState(state) => frame(node, AXIS_STATE, &pair(state.to_le_bytes(), [0; 4])),
            Self::SetControllerMode { control, input } => {
                frame(node, CONTROLLER_MODE, &pair(control.to_le_bytes(), input.to_le_bytes()))
            }
            Self::SetInputVel(velocity) => frame(node, INPUT_VEL, &pair(velocity.to_le_bytes(), [0; 4])),
            Self::SetInputTorque(torque) => frame(node, INPUT_TORQUE, &pair(torque.to_le_bytes(), [0; 4])),
            Self::GetIq => frame(node, IQ, &[]),
            Self::GetTemperature => frame(node, TEMPERATURE, &[]),
            Self::GetBus => frame(node, BUS, &[]),
            Self::ClearErrors => frame(node, CLEAR_ERRORS, &[0]),
        }
    }

    /// Node and command of a frame that an axis receives; none for one that an axis ignores.
    #[must_use]
    pub fn decode(frame: &Frame) -> Option<(u8, Self)> {
        let (node, command) = address(frame)?;
        let data = frame.data();
        let command = match command {
            VERSION if data.is_empty() => Self::GetVersion,
            ESTOP => Self::Estop,
            ERROR if data.is_empty() => Self::GetError,
            RX_SDO => match sdo(data)? {
                (SDO_READ, endpoint, None) => Self::Read { endpoint },
                (SDO_WRITE, endpoint, Some(value)) => Self::Write { endpoint, value },
                _ => return None,
            },
            AXIS_STATE => Self::SetAxisState(u32::from_le_bytes(*data.first_chunk()?)),
            CONTROLLER_MODE => {
                let (control, input) = halves(data)?;
                Self::SetControllerMode { control: u32::from_le_bytes(control), input: u32::from_le_bytes(input) }
            }
            INPUT_VEL => Self::SetInputVel(floats(data)?.0),
            INPUT_TORQUE => Self::SetInputTorque(f32::from_le_bytes(*data.first_chunk()?)),
            IQ if data.is_empty() => Self::GetIq,
            TEMPERATURE if data.is_empty() => Self::GetTemperature,
            BUS if data.is_empty() => Self::GetBus,
            CLEAR_ERRORS => Self::ClearErrors,
            _ => return None,
        };
        Some((node, command))
    }
}

/// What a frame is to the master of `node`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Received {
    /// Message of the axis.
    Message(Message),
    /// A frame of another node, or one that a master sends.
    Other,
    /// A message of the axis that has a wrong length or a value that is no number.
    Malformed,
}

impl Message {
    /// The frame of the axis with this node id.
    #[must_use]
    pub fn frame(self, node: u8) -> Frame {
        let float = f32::to_le_bytes;
        match self {
            Self::Version(version) => frame(node, VERSION, &version.to_bytes()),
            Self::Heartbeat { errors, state } => frame(node, HEARTBEAT, &pair(errors.to_le_bytes(), [state, 0, 0, 0])),
            Self::Errors { active, disarm } => frame(node, ERROR, &pair(active.to_le_bytes(), disarm.to_le_bytes())),
            Self::Parameter { endpoint, value } => sdo_frame(node, TX_SDO, 0, endpoint, Some(value)),
            Self::Estimates { position, velocity } => frame(node, ESTIMATES, &pair(float(position), float(velocity))),
            Self::Iq(measured) => frame(node, IQ, &pair([0; 4], float(measured))),
            Self::Temperature(stage) => frame(node, TEMPERATURE, &pair(float(stage), [0; 4])),
            Self::Bus(voltage) => frame(node, BUS, &pair(float(voltage), [0; 4])),
        }
    }

    /// Decodes a frame for the master of `node`.
    #[must_use]
    pub fn decode(node: u8, frame: &Frame) -> Received {
        let Some((_, command)) = address(frame).filter(|(from, _)| *from == node) else { return Received::Other };
        let from_axis = [VERSION, HEARTBEAT, ERROR, TX_SDO, ESTIMATES, IQ, TEMPERATURE, BUS].contains(&command);
        // A message without data is a request for one: the master's own, where the bus returns it.
        if !from_axis || frame.data().is_empty() {
            return Received::Other;
        }
        Self::of(command, frame.data()).map_or(Received::Malformed, Received::Message)
    }

    fn of(command: u8, data: &[u8]) -> Option<Self> {
        if command == TX_SDO {
            let (_, endpoint, value) = sdo(data)?;
            return Some(Self::Parameter { endpoint, value: value? });
        }
        let (first, second) = halves(data)?;
        let word = u32::from_le_bytes;
        Some(match command {
            VERSION => Self::Version(Version::from_bytes(pair(first, second))),
            HEARTBEAT => Self::Heartbeat { errors: word(first), state: second[0] },
            ERROR => Self::Errors { active: word(first), disarm: word(second) },
            ESTIMATES => {
                let (position, velocity) = floats(data)?;
                Self::Estimates { position, velocity }
            }
            IQ => Self::Iq(floats(data)?.1),
            TEMPERATURE => Self::Temperature(f32::from_le_bytes(first)),
            BUS => Self::Bus(floats(data)?.0),
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    /// Typed from the documents, with node 3.
    #[test]
    fn commands_are_the_frames_of_the_documents() {
        let cases: [(Command, u16, &[u8]); 12] = [
            (Command::GetVersion, 0x060, &[]),
            (Command::Estop, 0x062, &[]),
            (Command::GetError, 0x063, &[]),
            (Command::Read { endpoint: 0x0123 }, 0x064, &[0, 0x23, 0x01, 0]),
            (
                Command::Write { endpoint: 0x0123, value: Value::Float(0.2) },
                0x064,
                &[1, 0x23, 0x01, 0, 0xCD, 0xCC, 0x4C, 0x3E],
            ),
            (Command::Write { endpoint: 2, value: Value::Bool(true) }, 0x064, &[1, 2, 0, 0, 1]),
            (Command::SetAxisState(8), 0x067, &[8, 0, 0, 0, 0, 0, 0, 0]),
            (Command::SetControllerMode { control: 2, input: 1 }, 0x06B, &[2, 0, 0, 0, 1, 0, 0, 0]),
            (Command::SetInputVel(-2.5), 0x06D, &[0, 0, 0x20, 0xC0, 0, 0, 0, 0]),
            (Command::SetInputTorque(0.0), 0x06E, &[0, 0, 0, 0, 0, 0, 0, 0]),
            (Command::GetBus, 0x077, &[]),
            (Command::ClearErrors, 0x078, &[0]),
        ];
        for (command, id, data) in cases {
            let frame = command.frame(3);
            assert_eq!((frame.id(), frame.data()), (Id::Standard(id), data), "{command:?}");
            assert_eq!(Command::decode(&frame), Some((3, command)));
        }
    }

    #[test]
    fn messages_are_the_frames_of_the_documents() {
        let version = Version { protocol: 2, hardware: [4, 4, 58], firmware: [0, 6, 10], unreleased: 0 };
        let cases: [(Message, u16, &[u8]); 8] = [
            (Message::Version(version), 0x0A0, &[2, 4, 4, 58, 0, 6, 10, 0]),
            (Message::Heartbeat { errors: 0x0100_0000, state: 8 }, 0x0A1, &[0, 0, 0, 1, 8, 0, 0, 0]),
            (Message::Errors { active: 1, disarm: 0x0200_0000 }, 0x0A3, &[1, 0, 0, 0, 0, 0, 0, 2]),
            (Message::Parameter { endpoint: 0x1FA, value: Value::Bool(true) }, 0x0A5, &[0, 0xFA, 1, 0, 1]),
            (Message::Estimates { position: 1.0, velocity: -2.5 }, 0x0A9, &[0, 0, 0x80, 0x3F, 0, 0, 0x20, 0xC0]),
            (Message::Iq(1.0), 0x0B4, &[0, 0, 0, 0, 0, 0, 0x80, 0x3F]),
            (Message::Temperature(1.0), 0x0B5, &[0, 0, 0x80, 0x3F, 0, 0, 0, 0]),
            (Message::Bus(1.0), 0x0B7, &[0, 0, 0x80, 0x3F, 0, 0, 0, 0]),
        ];
        for (message, id, data) in cases {
            let frame = message.frame(5);
            assert_eq!((frame.id(), frame.data()), (Id::Standard(id), data), "{message:?}");
            assert_eq!(Message::decode(5, &frame), Received::Message(message));
            assert_eq!(Message::decode(4, &frame), Received::Other);
        }
    }

    #[test]
    fn wrong_lengths_and_values_that_are_no_numbers_are_malformed() {
        let nan = f32::NAN.to_le_bytes();
        for (command, data) in [
            (HEARTBEAT, &[0, 0, 0, 0, 8][..]),
            (ESTIMATES, &pair(nan, [0; 4])[..]),
            (ESTIMATES, &pair([0; 4], f32::INFINITY.to_le_bytes())[..]),
            (TX_SDO, &[0, 1, 0, 0][..]),
            (TX_SDO, &[0, 1, 0, 0, 2][..]),
            (TX_SDO, &[0, 1][..]),
        ] {
            assert_eq!(Message::decode(1, &frame(1, command, data)), Received::Malformed, "{command} {data:?}");
        }
        // Requests that the bus returns, and frames that are not CAN Simple.
        assert_eq!(Message::decode(1, &Command::GetVersion.frame(1)), Received::Other);
        assert_eq!(Message::decode(1, &Command::SetInputVel(1.0).frame(1)), Received::Other);
        assert_eq!(Message::decode(1, &Frame::new(Id::Extended(0x21), &[0; 8]).unwrap()), Received::Other);
        assert_eq!(Message::decode(1, &Frame::standard_remote(0x21, 8)), Received::Other);
    }

    #[test]
    fn whatever_is_decoded_encodes_to_the_same_meaning() {
        let mut random = Random::new(1);
        for _ in 0..100_000 {
            let len = random.index(9);
            let any = Frame::standard(random.below(0x800) as u16, &random.bytes(len));
            if let Some((node, command)) = Command::decode(&any) {
                // A float that is no number is not equal to itself.
                assert_eq!(std::format!("{:?}", Command::decode(&command.frame(node))), {
                    std::format!("{:?}", Some((node, command)))
                });
            }
            let node = (random.below(64)) as u8;
            if let Received::Message(message) = Message::decode(node, &any) {
                let again = Message::decode(node, &message.frame(node));
                assert_eq!(std::format!("{again:?}"), std::format!("{:?}", Received::Message(message)));
            }
        }
    }
}
