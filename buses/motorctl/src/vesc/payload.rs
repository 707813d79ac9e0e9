//! Payloads: requests and answers, for both ends; stateless. Numbers and layouts: `datatypes.h` (`COMM_PACKET_ID`),
//! `comm/commands.c` and `confgenerator.c` of the firmware.

use crate::event::Text;
use heapless::Vec;

const FW_VERSION: u8 = 0;
const SET_CURRENT: u8 = 6;
const SET_CURRENT_BRAKE: u8 = 7;
const SET_RPM: u8 = 8;
const GET_APPCONF: u8 = 17;
const GET_VALUES_SELECTIVE: u8 = 50;

/// Values that are asked for, by their bits: temperature of the power stage, motor current, ERPM, supply, tachometer,
/// fault, id, state of the timeout.
const VALUES: u32 = 1 | 1 << 2 | 1 << 7 | 1 << 8 | 1 << 13 | 1 << 15 | 1 << 17 | 1 << 21;

/// Currents are sent in mA.
const MILLI: f64 = 1000.0;

/// Kind of hardware that is a motor controller, `HW_TYPE_VESC`.
pub const MOTOR_CONTROLLER: u8 = 0;

/// Fault code ABS_OVER_CURRENT.
pub const ABS_OVER_CURRENT: u8 = 4;

/// Bytes of a request.
pub type Bytes = Vec<u8, 8>;

/// Request of the host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// COMM_FW_VERSION.
    Firmware,
    /// COMM_GET_APPCONF.
    AppConf,
    /// COMM_GET_VALUES_SELECTIVE, with the values that [`Answer::Values`] has.
    Values,
    /// COMM_SET_CURRENT, A.
    SetCurrent(f64),
    /// COMM_SET_CURRENT_BRAKE, A.
    SetBrake(f64),
    /// COMM_SET_RPM: ERPM.
    SetRpm(i32),
}

/// Answer of the device.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// COMM_FW_VERSION.
    Firmware {
        /// Major and minor.
        version: [u8; 2],
        /// Name of the hardware.
        hardware: Text,
        /// Kind of the hardware.
        kind: u8,
    },
    /// The first fields of the application's configuration.
    AppConf {
        /// VESC id.
        id: u8,
        /// Time without commands, ms; 0: without limit.
        timeout_ms: u32,
        /// Brake current after it, A.
        brake_current_a: f32,
    },
    /// Measurements and state.
    Values(Values),
}

/// Measurements and state of a VESC.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Values {
    /// Power stage, in tenths of a °C.
    pub temperature_dc: i16,
    /// Motor, in hundredths of an A.
    pub current_ca: i32,
    /// ERPM.
    pub erpm: i32,
    /// Supply, in tenths of a V.
    pub supply_dv: i16,
    /// Steps of the tachometer; wraps.
    pub tachometer: i32,
    /// Fault code; 0: none.
    pub fault: u8,
    /// VESC id.
    pub id: u8,
    /// True if the command time limit has acted.
    pub timed_out: bool,
    /// True if a kill switch is active.
    pub killed: bool,
}

/// Reads fields one after the other.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*field)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take::<1>().map(|[byte]| byte)
    }

    fn word(&mut self) -> Option<i16> {
        self.take().map(i16::from_be_bytes)
    }

    fn long(&mut self) -> Option<i32> {
        self.take().map(i32::from_be_bytes)
    }
}

fn with(command: u8, value: i32) -> Bytes {
    let [a, b, c, d] = value.to_be_bytes();
    [command, a, b, c, d].into_iter().collect()
}

impl Request {
    /// The bytes.
    #[must_use]
    pub fn bytes(self) -> Bytes {
        match self {
            Self::Firmware => [FW_VERSION].into_iter().collect(),
            Self::AppConf => [GET_APPCONF].into_iter().collect(),
            Self::Values => with(GET_VALUES_SELECTIVE, VALUES as i32),
            // Saturate; the limits of a configuration are far below.
            Self::SetCurrent(current) => with(SET_CURRENT, libm::round(current * MILLI) as i32),
            Self::SetBrake(current) => with(SET_CURRENT_BRAKE, libm::round(current * MILLI) as i32),
            Self::SetRpm(erpm) => with(SET_RPM, erpm),
        }
    }

    /// Reads a request; none for one that the emulated device does not know.
    #[must_use]
    pub fn decode(payload: &[u8]) -> Option<Self> {
        let (command, data) = payload.split_first()?;
        let value = || data.first_chunk().map(|bytes| i32::from_be_bytes(*bytes));
        let current = || value().map(|milli| f64::from(milli) / MILLI);
        Some(match *command {
            FW_VERSION => Self::Firmware,
            GET_APPCONF => Self::AppConf,
            GET_VALUES_SELECTIVE if value()? == VALUES as i32 => Self::Values,
            SET_CURRENT => Self::SetCurrent(current()?),
            SET_CURRENT_BRAKE => Self::SetBrake(current()?),
            SET_RPM => Self::SetRpm(value()?),
            _ => return None,
        })
    }
}

impl Answer {
    /// Reads an answer; none for anything else.
    #[must_use]
    pub fn decode(payload: &[u8]) -> Option<Self> {
        let mut fields = Fields(payload);
        match fields.byte()? {
            FW_VERSION => {
                let version = fields.take()?;
                let end = fields.0.iter().position(|byte| *byte == 0)?;
                let hardware = Text::from_slice(&fields.0[..end]).ok()?;
                // Behind the name: its end, the processor's number, pairing, test version, kind.
                let kind = *fields.0.get(end + 1 + 12 + 2)?;
                Some(Self::Firmware { version, hardware, kind })
            }
            GET_APPCONF => {
                let [_, _, _, _, id] = fields.take()?;
                let timeout_ms = fields.take().map(u32::from_be_bytes)?;
                // The firmware's own format of a float is that of IEEE 754, but for subnormal numbers.
                let brake_current_a = fields.take().map(f32::from_be_bytes)?;
                brake_current_a.is_finite().then_some(Self::AppConf { id, timeout_ms, brake_current_a })
            }
            GET_VALUES_SELECTIVE if fields.take()? == VALUES.to_be_bytes() => {
                let values = Values::decode(&mut fields)?;
                fields.0.is_empty().then_some(Self::Values(values))
            }
            _ => None,
        }
    }
}

impl Values {
    fn decode(fields: &mut Fields<'_>) -> Option<Self> {
        let values = Self {
            temperature_dc: fields.word()?,
            current_ca: fields.long()?,
            erpm: fields.long()?,
            supply_dv: fields.word()?,
            tachometer: fields.long()?,
            fault: fields.byte()?,
            id: fields.byte()?,
            ..Self::default()
        };
        let state = fields.byte()?;
        Some(Self { timed_out: state & 1 != 0, killed: state & 2 != 0, ..values })
    }

    /// The bytes of the answer.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8, 32> {
        let mut bytes = Vec::new();
        // 24 bytes: it fits.
        let mut extend = |data: &[u8]| data.iter().for_each(|byte| _ = bytes.push(*byte));
        extend(&[GET_VALUES_SELECTIVE]);
        extend(&VALUES.to_be_bytes());
        extend(&self.temperature_dc.to_be_bytes());
        extend(&self.current_ca.to_be_bytes());
        extend(&self.erpm.to_be_bytes());
        extend(&self.supply_dv.to_be_bytes());
        extend(&self.tachometer.to_be_bytes());
        extend(&[self.fault, self.id, u8::from(self.timed_out) | u8::from(self.killed) << 1]);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    #[test]
    fn requests_are_those_of_the_source() {
        let cases: [(Request, &[u8]); 6] = [
            (Request::Firmware, &[0]),
            (Request::AppConf, &[17]),
            (Request::Values, &[50, 0x00, 0x22, 0xA1, 0x85]),
            // The current of the example in documentation/comm_can.md.
            (Request::SetCurrent(51.0), &[6, 0x00, 0x00, 0xC7, 0x38]),
            (Request::SetBrake(0.5), &[7, 0x00, 0x00, 0x01, 0xF4]),
            (Request::SetRpm(-3000), &[8, 0xFF, 0xFF, 0xF4, 0x48]),
        ];
        for (request, bytes) in cases {
            assert_eq!(request.bytes(), bytes, "{request:?}");
            assert_eq!(Request::decode(bytes), Some(request));
        }
    }

    #[test]
    fn answers_typed_from_the_source_are_read() {
        let mut firmware: std::vec::Vec<u8> = std::vec![0, 6, 5];
        firmware.extend(b"60_MK5\0");
        firmware.extend([0xAB; 12]);
        // Paired, test version, kind, and what follows it.
        firmware.extend([1, 0, 0, 0, 0]);
        let hardware = b"60_MK5".iter().copied().collect();
        assert_eq!(Answer::decode(&firmware), Some(Answer::Firmware { version: [6, 5], hardware, kind: 0 }));

        // Signature of 7.01, id 23, 200 ms, 5.5 A, and the beginning of what follows.
        let appconf = [17, 0x3A, 0x91, 0xDE, 0x56, 23, 0, 0, 0, 200, 0x40, 0xB0, 0, 0, 0, 50];
        let expected = Answer::AppConf { id: 23, timeout_ms: 200, brake_current_a: 5.5 };
        assert_eq!(Answer::decode(&appconf), Some(expected));

        let values = [
            50, 0x00, 0x22, 0xA1, 0x85, 0x01, 0x36, 0xFF, 0xFF, 0xFF, 0x9C, 0x00, 0x00, 0x0B, 0xB8, 0x00, 0xF3, 0xFF,
            0xFF, 0xFF, 0xFE, 0x04, 0x17, 0x01,
        ];
        let expected = Values {
            temperature_dc: 310,
            current_ca: -100,
            erpm: 3000,
            supply_dv: 243,
            tachometer: -2,
            fault: ABS_OVER_CURRENT,
            id: 23,
            timed_out: true,
            killed: false,
        };
        assert_eq!(Answer::decode(&values), Some(Answer::Values(expected)));
        assert_eq!(expected.bytes(), values);
    }

    #[test]
    fn any_bytes_are_read_without_a_panic_and_cut_answers_are_refused() {
        let mut random = Random::new(5);
        for _ in 0..100_000 {
            let len = random.index(64);
            let mut bytes = random.bytes(len);
            if let Some(command) = bytes.first_mut() {
                *command = [FW_VERSION, GET_APPCONF, GET_VALUES_SELECTIVE, SET_RPM][random.index(4)];
            }
            let _ = (Answer::decode(&bytes), Request::decode(&bytes));
        }
        let values = Values::default().bytes();
        assert!((0..values.len()).all(|len| Answer::decode(&values[..len]).is_none()));
    }
}
