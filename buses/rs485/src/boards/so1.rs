//! BR-SO1, odometry board: counts the ticks of the incremental encoders on the undriven front wheels.
//!
//! Protocol  `docs/facts/boards.md` 4; counters are little-endian and wrap
//! Timing    at 1.2 m/s the signed difference of two counts is right up to a gap of 4.2 s

use super::{Board, DO_RESET, GET_VERSION, Implausible, Instruction, instruction};
use crate::instruction::Lengths;
use heapless::Vec;

/// Address of the board.
pub const ADDRESS: u8 = 0x20;
/// Most counters of a board.
pub const COUNTERS: usize = 4;

/// Ticks since reset: left wheel, right wheel, and up to two more.
pub const GET_TICKS: Instruction = instruction(0x01, "get_ticks", Lengths { min: 2, max: 8, step: 2 });
/// Sets all counters to 0.
pub const RESET_TICKS: Instruction = instruction(0x02, "reset_ticks", Lengths::NONE);

/// All instructions of the board.
pub const INSTRUCTIONS: &[Instruction] = &[GET_TICKS, RESET_TICKS, GET_VERSION, DO_RESET];

/// The board.
pub const BOARD: Board = Board { name: "so1", addresses: &[ADDRESS], instructions: INSTRUCTIONS, unasked: &[] };

/// Counters, left first.
pub type Ticks = Vec<i16, COUNTERS>;

/// Decodes the data of an answer to [`GET_TICKS`]. Every count is plausible; the driver checks it against the previous
/// one.
///
/// # Errors
/// When there is no counter, half a counter, or more counters than the board has.
pub fn parse_ticks(data: &[u8]) -> Result<Ticks, Implausible> {
    match data.as_chunks::<2>() {
        (pairs @ ([_] | [_, _] | [_, _, _] | [_, _, _, _]), []) => {
            Ok(pairs.iter().map(|pair| i16::from_le_bytes(*pair)).collect())
        }
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}

/// The data of an answer to [`GET_TICKS`].
#[must_use]
pub fn build_ticks(ticks: &Ticks) -> Vec<u8, { 2 * COUNTERS }> {
    ticks.iter().flat_map(|count| count.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_are_signed_and_little_endian() {
        let ticks = parse_ticks(&[0x01, 0x00, 0xFE, 0xFF]).unwrap();
        assert_eq!(ticks, [1, -2]);
        assert_eq!(build_ticks(&ticks), [0x01, 0x00, 0xFE, 0xFF]);
    }

    #[test]
    fn one_to_four_counters_and_nothing_else() {
        for len in 0..12_usize {
            let right = matches!(len, 2 | 4 | 6 | 8);
            assert_eq!(parse_ticks(&[0; 12][..len]).is_ok(), right, "{len}");
            assert_eq!(GET_TICKS.answer.allow(len), right, "{len}");
        }
    }
}
