//! BR-SBS1, beacon scanner: measures the bearings of active infrared beacons.
//!
//! Protocol  `docs/facts/boards.md` 5; values of two bytes are little-endian
//! Timing    one sweep a second; each beacon is sighted at its own instant, so each sighting carries its own age
//! CRC       an answer with more than four beacons is beyond what the CRC guards with Hamming distance 3
//!           (`docs/facts/boards.md`, CRC): length, bearings and beacons named twice are looked at too

use super::{Board, DO_RESET, GET_VERSION, Implausible, Instruction, instruction};
use crate::instruction::Lengths;
use heapless::Vec;

/// Address of the board.
pub const ADDRESS: u8 = 0x30;
/// Maximum number of sightings in an answer, by its 255 data bytes; the same number of beacons may be chosen.
pub const BEACONS: usize = 42;
/// Bytes of one sighting.
const SIGHTING: usize = 6;
/// Bearings are less than half a turn away from the robot's x axis, 0.01 deg; -180 deg belongs to them, 180 does not.
pub const BEARINGS: core::ops::Range<i16> = -18_000..18_000;

/// Which beacons to look for: their IDs as data, no data for all.
pub const SET_BEACON_IDS: Instruction = Instruction {
    code: 0x01,
    name: "set_beacon_ids",
    request: Lengths::between(0, BEACONS as u8),
    answer: Lengths::NONE,
};
/// Reads the sightings.
pub const GET_BEACON_DATA: Instruction =
    instruction(0x02, "get_beacon_data", Lengths { min: 1, max: (1 + SIGHTING * BEACONS) as u8, step: SIGHTING as u8 });
/// Reads the state of the scanner.
pub const GET_DEBUG_DATA: Instruction = instruction(0x03, "get_debug_data", Lengths::exactly(6));

/// All instructions of the board.
pub const INSTRUCTIONS: &[Instruction] = &[SET_BEACON_IDS, GET_BEACON_DATA, GET_DEBUG_DATA, GET_VERSION, DO_RESET];

/// The board.
pub const BOARD: Board = Board { name: "sbs1", addresses: &[ADDRESS], instructions: INSTRUCTIONS, unasked: &[] };

/// Newest sighting of a beacon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sighting {
    /// Which beacon.
    pub id: u8,
    /// Bearing, 0.01 deg counter-clockwise from the robot's x axis; in [`BEARINGS`].
    pub bearing: i16,
    /// Signal strength, 0..=255.
    pub strength: u8,
    /// Age at the answer, ms.
    pub age_ms: u16,
}

/// Sightings; each beacon at most once.
pub type Sightings = Vec<Sighting, BEACONS>;

/// From the data of an answer to [`GET_BEACON_DATA`].
///
/// # Errors
/// When count and length disagree, a bearing is not in [`BEARINGS`], or a beacon is named twice. Values are counted by
/// sighting; a bearing is given as its 16 bits.
pub fn parse_beacons(data: &[u8]) -> Result<Sightings, Implausible> {
    let layout = Implausible::Layout { len: data.len() };
    let (count, rest) = data.split_first().ok_or(layout)?;
    let (records, []) = rest.as_chunks::<SIGHTING>() else {
        return Err(layout);
    };
    if records.len() != usize::from(*count) {
        return Err(layout);
    }
    let mut sightings = Sightings::new();
    for (index, &[id, b0, b1, strength, a0, a1]) in records.iter().enumerate() {
        let [bearing, age_ms] = [[b0, b1], [a0, a1]].map(u16::from_le_bytes);
        if !BEARINGS.contains(&bearing.cast_signed()) {
            return Err(Implausible::Value { index, value: bearing.into() });
        }
        if sightings.iter().any(|earlier: &Sighting| earlier.id == id) {
            return Err(Implausible::Value { index, value: id.into() });
        }
        sightings.push(Sighting { id, bearing: bearing.cast_signed(), strength, age_ms }).map_err(|_| layout)?;
    }
    Ok(sightings)
}

/// The data of an answer to [`GET_BEACON_DATA`]; sightings beyond [`BEACONS`] are left out.
#[must_use]
pub fn build_beacons(sightings: &[Sighting]) -> Vec<u8, { 1 + SIGHTING * BEACONS }> {
    let sightings = &sightings[..sightings.len().min(BEACONS)];
    let record = |Sighting { id, bearing, strength, age_ms }: &Sighting| {
        let ([b0, b1], [a0, a1]) = (bearing.to_le_bytes(), age_ms.to_le_bytes());
        [*id, b0, b1, *strength, a0, a1]
    };
    [sightings.len() as u8].into_iter().chain(sightings.iter().flat_map(record)).collect()
}

/// The answer to [`GET_DEBUG_DATA`]; counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Debug {
    /// Sweeps since power-on.
    pub sweeps: u16,
    /// Pulses that belong to no beacon.
    pub rejected_pulses: u16,
    /// The board's supply, mV.
    pub supply_mv: u16,
}

/// From the data of an answer to [`GET_DEBUG_DATA`].
///
/// # Errors
/// When it has not six bytes.
pub fn parse_debug(data: &[u8]) -> Result<Debug, Implausible> {
    let &[s0, s1, r0, r1, v0, v1] = data else {
        return Err(Implausible::Layout { len: data.len() });
    };
    let [sweeps, rejected_pulses, supply_mv] = [[s0, s1], [r0, r1], [v0, v1]].map(u16::from_le_bytes);
    Ok(Debug { sweeps, rejected_pulses, supply_mv })
}

/// The data of an answer to [`GET_DEBUG_DATA`].
#[must_use]
pub fn build_debug(debug: Debug) -> [u8; 6] {
    let [[s0, s1], [r0, r1], [v0, v1]] = [debug.sweeps, debug.rejected_pulses, debug.supply_mv].map(u16::to_le_bytes);
    [s0, s1, r0, r1, v0, v1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Typed from the table: beacon 7 at 90.00 deg, 200 strong, 250 ms ago; beacon 3 at -180.00 deg, 12 strong, 1000
    /// ms.
    const ANSWER: [u8; 13] = [2, 7, 0x28, 0x23, 200, 0xFA, 0x00, 3, 0xB0, 0xB9, 12, 0xE8, 0x03];

    #[test]
    fn an_answer_reads_as_the_table_says_and_is_built_the_same() {
        let sightings = parse_beacons(&ANSWER).unwrap();
        assert_eq!(
            sightings,
            [
                Sighting { id: 7, bearing: 9000, strength: 200, age_ms: 250 },
                Sighting { id: 3, bearing: -18_000, strength: 12, age_ms: 1000 },
            ]
        );
        assert_eq!(build_beacons(&sightings), ANSWER);
        assert!(GET_BEACON_DATA.answer.allow(ANSWER.len()));
        assert_eq!(parse_beacons(&[0]), Ok(Sightings::new()));
    }

    #[test]
    fn counts_that_do_not_fit_the_length_are_implausible() {
        for data in [&[][..], &[1], &ANSWER[..12], &[3; 13], &[0, 1, 2, 3, 4, 5, 6]] {
            assert_eq!(parse_beacons(data), Err(Implausible::Layout { len: data.len() }));
        }
        let lengths = (0..=255).filter(|len| GET_BEACON_DATA.answer.allow(*len));
        assert!(lengths.eq((0..=BEACONS).map(|n| 1 + 6 * n)));
    }

    #[test]
    fn a_full_answer_fits_a_frame_and_more_is_left_out() {
        let many: [Sighting; BEACONS + 1] = core::array::from_fn(|n| Sighting { id: n as u8, ..Sighting::default() });
        assert_eq!(parse_beacons(&build_beacons(&many)).unwrap(), many[..BEACONS]);
    }

    #[test]
    fn a_bearing_beyond_half_a_turn_and_a_beacon_twice_are_implausible() {
        let bearing = |bearing: i16| parse_beacons(&build_beacons(&[Sighting { bearing, ..Sighting::default() }]));
        assert!(bearing(17_999).is_ok() && bearing(-18_000).is_ok());
        assert_eq!(bearing(18_000), Err(Implausible::Value { index: 0, value: 18_000 }));
        assert_eq!(bearing(-18_001), Err(Implausible::Value { index: 0, value: 47_535 }));
        assert_eq!(
            parse_beacons(&build_beacons(&[Sighting { id: 9, ..Sighting::default() }; 2])),
            Err(Implausible::Value { index: 1, value: 9 })
        );
    }

    #[test]
    fn debug_data_is_three_little_endian_values() {
        let debug = Debug { sweeps: 1, rejected_pulses: 0x0203, supply_mv: 5000 };
        assert_eq!(build_debug(debug), [1, 0, 3, 2, 0x88, 0x13]);
        assert_eq!(parse_debug(&build_debug(debug)), Ok(debug));
        assert_eq!(parse_debug(&[0; 5]), Err(Implausible::Layout { len: 5 }));
    }
}
