//! BR-PSC1, power source controller: eight switched channels, their currents, the battery, and the PAUSE line.
//!
//! Protocol  `docs/facts/boards.md` 6, on a full-duplex link of its own; values of two bytes are little-endian
//! Unasked   [`UNASKED`]: told from an answer by their instruction; each change of the PAUSE line, and every 500 ms
//! Timing    500 ms between starting channels, 1 s between stopping them

use super::{Board, DO_RESET, GET_VERSION, Implausible, Instruction, instruction};
use crate::instruction::Lengths;
use heapless::Vec;

/// Address of the board.
pub const ADDRESS: u8 = 0x40;

/// Names of the channels in messages and on the command line, by the load on each.
pub const CHANNELS: [&str; 8] = ["host", "computer1", "computer2", "motors", "monitor", "audio", "sensors", "switch"];

/// Plausible battery voltages, mV: eight LiFeYPO4 cells, 2.5 to 3.65 V each in use; below 1 V a cell the board is off,
/// and no charger reaches 5 V a cell.
pub const BATTERY_MV: core::ops::RangeInclusive<u16> = 8_000..=40_000;

/// Which channels are on: a bit mask, channel 0 lowest.
pub const GET_PWR_STATUS: Instruction = instruction(0x01, "get_pwr_status", Lengths::exactly(1));
/// Switches channels: [`build_set`]; answered by the resulting mask.
pub const SET_PWR_STATUS: Instruction =
    Instruction { code: 0x02, name: "set_pwr_status", request: Lengths::exactly(2), answer: Lengths::exactly(1) };
/// Currents and the battery's voltage.
pub const GET_CURRENTS: Instruction = instruction(0x03, "get_currents", Lengths::exactly(18));
/// Unasked: the state of the PAUSE line.
pub const PAUSE_CHANGED: Instruction = instruction(0x80, "pause_changed", Lengths::exactly(2));
/// Unasked: the supply will be cut.
pub const POWER_OFF_REQUESTED: Instruction = instruction(0x81, "power_off_requested", Lengths::exactly(1));

/// All instructions of the board.
pub const INSTRUCTIONS: &[Instruction] = &[GET_PWR_STATUS, SET_PWR_STATUS, GET_CURRENTS, GET_VERSION, DO_RESET];
/// Unsolicited messages, not acknowledged: for [`Config::unasked`](crate::master::Config::unasked).
pub const UNASKED: &[Instruction] = &[PAUSE_CHANGED, POWER_OFF_REQUESTED];

/// The board.
pub const BOARD: Board = Board { name: "psc1", addresses: &[ADDRESS], instructions: INSTRUCTIONS, unasked: UNASKED };

/// From the data of an answer to [`GET_PWR_STATUS`] or [`SET_PWR_STATUS`]: which channels are on. Every mask is
/// plausible.
///
/// # Errors
/// When it is not one byte.
pub fn parse_status(data: &[u8]) -> Result<u8, Implausible> {
    match *data {
        [mask] => Ok(mask),
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}

/// The data of an answer to [`GET_PWR_STATUS`] or [`SET_PWR_STATUS`].
#[must_use]
pub const fn build_status(mask: u8) -> [u8; 1] {
    [mask]
}

/// The data of a request [`SET_PWR_STATUS`]: the channels in `mask` take their bits of `states`, the others stay.
#[must_use]
pub const fn build_set(mask: u8, states: u8) -> [u8; 2] {
    [mask, states]
}

/// From the data of a request [`SET_PWR_STATUS`]: mask and states.
///
/// # Errors
/// When it has not two bytes.
pub fn parse_set(data: &[u8]) -> Result<(u8, u8), Implausible> {
    match *data {
        [mask, states] => Ok((mask, states)),
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}

/// The answer to [`GET_CURRENTS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Currents {
    /// Current of each channel, mA.
    pub milliamps: [u16; CHANNELS.len()],
    /// The battery's voltage, mV.
    pub battery_mv: u16,
}

/// From the data of an answer to [`GET_CURRENTS`].
///
/// # Errors
/// When it has not 18 bytes, or the voltage is not in [`BATTERY_MV`]: value 8.
pub fn parse_currents(data: &[u8]) -> Result<Currents, Implausible> {
    let (pairs @ &[_, _, _, _, _, _, _, _, battery], []) = data.as_chunks::<2>() else {
        return Err(Implausible::Layout { len: data.len() });
    };
    let battery_mv = u16::from_le_bytes(battery);
    if !BATTERY_MV.contains(&battery_mv) {
        return Err(Implausible::Value { index: CHANNELS.len(), value: battery_mv.into() });
    }
    Ok(Currents { milliamps: core::array::from_fn(|channel| u16::from_le_bytes(pairs[channel])), battery_mv })
}

/// The data of an answer to [`GET_CURRENTS`].
#[must_use]
pub fn build_currents(currents: &Currents) -> Vec<u8, 18> {
    currents.milliamps.iter().chain([&currents.battery_mv]).flat_map(|value| value.to_le_bytes()).collect()
}

/// Unsolicited message of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unasked {
    /// The PAUSE line, on change and every 500 ms.
    PauseChanged {
        /// True if it is pulled.
        engaged: bool,
        /// Source that pulls the line, or pulled it last: see [`source_name`]; 0 for none so far.
        source: u8,
    },
    /// The supply is cut soon.
    PowerOffRequested {
        /// Until then, s.
        seconds: u8,
    },
}

/// From the instruction and data of a frame that came unasked.
///
/// # Errors
/// The instruction is not in [`UNASKED`] (its code is the value then), the length is wrong, `engaged` is neither 0 nor
/// 1, or the source is unknown.
pub fn parse_unasked(instruction: u8, data: &[u8]) -> Result<Unasked, Implausible> {
    match (instruction, data) {
        (code, &[engaged @ 0..=1, source]) if code == PAUSE_CHANGED.code => {
            if source_name(source).is_some() || (engaged, source) == (0, 0) {
                Ok(Unasked::PauseChanged { engaged: engaged == 1, source })
            } else {
                Err(Implausible::Value { index: 1, value: source.into() })
            }
        }
        (code, &[engaged, _]) if code == PAUSE_CHANGED.code => {
            Err(Implausible::Value { index: 0, value: engaged.into() })
        }
        (code, &[seconds]) if code == POWER_OFF_REQUESTED.code => Ok(Unasked::PowerOffRequested { seconds }),
        (code, _) if UNASKED.iter().any(|known| known.code == code) => Err(Implausible::Layout { len: data.len() }),
        (code, _) => Err(Implausible::Value { index: 0, value: code.into() }),
    }
}

impl Unasked {
    /// The instruction and the data of the frame.
    #[must_use]
    pub fn build(self) -> (Instruction, Vec<u8, 2>) {
        match self {
            Self::PauseChanged { engaged, source } => {
                (PAUSE_CHANGED, [u8::from(engaged), source].into_iter().collect())
            }
            Self::PowerOffRequested { seconds } => (POWER_OFF_REQUESTED, [seconds].into_iter().collect()),
        }
    }
}

/// Name of a source of PAUSE in messages; `None` for an unknown byte.
#[must_use]
pub const fn source_name(source: u8) -> Option<&'static str> {
    const BUMPERS: [&str; 8] = ["bumper1", "bumper2", "bumper3", "bumper4", "bumper5", "bumper6", "bumper7", "bumper8"];
    match source {
        1..=8 => Some(BUMPERS[source as usize - 1]),
        0x10 => Some("sd1_front"),
        0x11 => Some("sd1_rear"),
        0x20 => Some("button"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Typed from the table: channels 0 to 7 draw 1, 2 .. 8 A, the battery has 26.4 V.
    const CURRENTS: [u8; 18] =
        [0xE8, 0x03, 0xD0, 0x07, 0xB8, 0x0B, 0xA0, 0x0F, 0x88, 0x13, 0x70, 0x17, 0x58, 0x1B, 0x40, 0x1F, 0x20, 0x67];

    #[test]
    fn currents_read_as_the_table_says_and_are_built_the_same() {
        let currents = parse_currents(&CURRENTS).unwrap();
        assert_eq!(currents.milliamps, [1000, 2000, 3000, 4000, 5000, 6000, 7000, 8000]);
        assert_eq!(currents.battery_mv, 26_400);
        assert_eq!(build_currents(&currents), CURRENTS);
        assert_eq!(parse_currents(&CURRENTS[..17]), Err(Implausible::Layout { len: 17 }));
        let dead = build_currents(&Currents { battery_mv: 7_999, ..currents });
        assert_eq!(parse_currents(&dead), Err(Implausible::Value { index: 8, value: 7_999 }));
    }

    #[test]
    fn channels_are_switched_by_mask_and_state() {
        // Monitor and audio off.
        assert_eq!(build_set(0x30, 0x00), [0x30, 0x00]);
        assert_eq!(parse_set(&[0x30, 0x00]), Ok((0x30, 0x00)));
        assert_eq!(parse_set(&[0x30]), Err(Implausible::Layout { len: 1 }));
        assert_eq!(parse_status(&build_status(0xCF)), Ok(0xCF));
        assert_eq!(parse_status(&[]), Err(Implausible::Layout { len: 0 }));
        assert_eq!((CHANNELS[4], CHANNELS[5]), ("monitor", "audio"));
    }

    #[test]
    fn what_it_says_unasked_reads_as_the_table_says() {
        let said = |instruction, data: &[u8]| parse_unasked(instruction, data);
        assert_eq!(said(0x80, &[1, 0x20]), Ok(Unasked::PauseChanged { engaged: true, source: 0x20 }));
        assert_eq!(said(0x80, &[0, 3]), Ok(Unasked::PauseChanged { engaged: false, source: 3 }));
        assert_eq!(said(0x80, &[0, 0]), Ok(Unasked::PauseChanged { engaged: false, source: 0 }));
        assert_eq!(said(0x81, &[30]), Ok(Unasked::PowerOffRequested { seconds: 30 }));
    }

    #[test]
    fn what_it_cannot_say_is_implausible() {
        let value = |index, value| Err(Implausible::Value { index, value });
        assert_eq!(parse_unasked(0x80, &[1, 0]), value(1, 0), "engaged by nobody");
        assert_eq!(parse_unasked(0x80, &[0, 9]), value(1, 9));
        assert_eq!(parse_unasked(0x80, &[2, 1]), value(0, 2));
        assert_eq!(parse_unasked(0x82, &[1]), value(0, 0x82));
        assert_eq!(parse_unasked(0x80, &[1]), Err(Implausible::Layout { len: 1 }));
        assert_eq!(parse_unasked(0x81, &[]), Err(Implausible::Layout { len: 0 }));
    }

    #[test]
    fn parsing_undoes_building_for_every_source() {
        let sources = (1..=255).filter(|source| source_name(*source).is_some());
        assert_eq!(sources.clone().count(), 11);
        for source in sources {
            for engaged in [false, true] {
                let unasked = Unasked::PauseChanged { engaged, source };
                let (instruction, data) = unasked.build();
                assert!(UNASKED.contains(&instruction) && instruction.answer.allow(data.len()));
                assert_eq!(parse_unasked(instruction.code, &data), Ok(unasked));
            }
        }
    }
}
