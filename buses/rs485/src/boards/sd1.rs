//! BR-SD1, distance board: 8 ultrasonic rangers SRF-08 and 2 infrared rangers GP2Y0A41 that look at the floor.
//!
//! Protocol  `docs/facts/boards.md` 3; values of two bytes are little-endian
//! Timing    the sonars fire in three slots of 70 ms, sweep after sweep; an answer holds the last finished slot of each
//! Pause     the board pulls the PAUSE line by itself, without the host

use super::{Board, DO_RESET, GET_VERSION, Implausible, Instruction, instruction};
use crate::instruction::Lengths;
use base::Duration;
use heapless::Vec;

/// Address of the board in front.
pub const FRONT: u8 = 0x10;
/// Address of the board in the rear.
pub const REAR: u8 = 0x11;

/// Sonars of a board.
pub const SRFS: usize = 8;
/// Infrared rangers of a board.
pub const IRS: usize = 2;

/// Duration of a slot. Ranging takes an SRF-08 65 ms, and it fires at the slot's beginning.
pub const SLOT: Duration = Duration::from_millis(70);
/// Number of slots in a sweep; channel `c` fires in slot `c % SLOTS`.
pub const SLOTS: u32 = 3;
/// Duration of a sweep, from one firing of a channel to its next.
pub const SWEEP: Duration = Duration::from_millis(210);
/// Measuring cycle of an infrared ranger (`docs/facts/robot.md` 2.2).
pub const IR_CYCLE: Duration = Duration::from_micros(16_500);

/// Reading of a sonar without an echo.
pub const NO_ECHO: u16 = 0;
/// Reading of an infrared ranger with nothing in its range.
pub const OUT_OF_RANGE: u8 = 255;

/// The longest distance that an SRF-08 can be set to listen for: 255 x 43 + 43 mm, and 2 % for warm air
/// (`docs/facts/robot.md` 2.1).
pub const SRF_MAX_MM: u16 = 11_228;

/// Sonar distances.
pub const GET_SRF_DATA: Instruction = instruction(0x01, "get_srf_data", Lengths { min: 0, max: 16, step: 2 });
/// Infrared distances.
pub const GET_IR_DATA: Instruction = instruction(0x02, "get_ir_data", Lengths::between(0, 2));
/// All distances, with their counts.
pub const GET_BOTH_DATA: Instruction = instruction(0x10, "get_both_data", Lengths::between(2, 20));
/// Which ranger pulled the PAUSE line.
pub const GET_PAUSE_SRC: Instruction = instruction(0x20, "get_pause_src", Lengths::exactly(1));
/// Let go of the PAUSE line.
pub const CLEAR_PAUSE_SRC: Instruction = instruction(0x21, "clear_pause_src", Lengths::NONE);

/// All instructions of the board.
pub const INSTRUCTIONS: &[Instruction] =
    &[GET_SRF_DATA, GET_IR_DATA, GET_BOTH_DATA, GET_PAUSE_SRC, CLEAR_PAUSE_SRC, GET_VERSION, DO_RESET];

/// The board.
pub const BOARD: Board = Board { name: "sd1", addresses: &[FRONT, REAR], instructions: INSTRUCTIONS, unasked: &[] };

/// Sonar distances in mm by channel, [`NO_ECHO`] without an echo.
pub type Srfs = Vec<u16, SRFS>;
/// Infrared distances in mm by channel, [`OUT_OF_RANGE`] where there is nothing.
pub type Irs = Vec<u8, IRS>;

/// The answer to [`GET_BOTH_DATA`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Both {
    /// Sonars.
    pub srfs: Srfs,
    /// Infrared rangers.
    pub irs: Irs,
}

impl Both {
    /// From the answer's data.
    ///
    /// # Errors
    /// When the counts and the length disagree, there are more sensors than the board has, or a distance is beyond
    /// [`SRF_MAX_MM`].
    pub fn parse(data: &[u8]) -> Result<Self, Implausible> {
        let layout = Implausible::Layout { len: data.len() };
        let (n_srf, rest) = data.split_first().ok_or(layout)?;
        let (srfs, rest) = rest.split_at_checked(2 * usize::from(*n_srf)).ok_or(layout)?;
        let (n_ir, irs) = rest.split_first().ok_or(layout)?;
        if irs.len() != usize::from(*n_ir) {
            return Err(layout);
        }
        Ok(Self { srfs: parse_srfs(srfs)?, irs: parse_irs(irs)? })
    }

    /// The answer's data.
    #[must_use]
    pub fn build(&self) -> Vec<u8, { 2 + 2 * SRFS + IRS }> {
        let srfs = self.srfs.iter().flat_map(|mm| mm.to_le_bytes());
        [self.srfs.len() as u8]
            .into_iter()
            .chain(srfs)
            .chain([self.irs.len() as u8])
            .chain(self.irs.iter().copied())
            .collect()
    }
}

/// From the data of an answer to [`GET_SRF_DATA`].
///
/// # Errors
/// When there are more sensors than the board has, half a value, or a distance beyond [`SRF_MAX_MM`].
pub fn parse_srfs(data: &[u8]) -> Result<Srfs, Implausible> {
    let (pairs, []) = data.as_chunks::<2>() else {
        return Err(Implausible::Layout { len: data.len() });
    };
    let mut srfs = Srfs::new();
    for (index, pair) in pairs.iter().enumerate() {
        let mm = u16::from_le_bytes(*pair);
        if mm > SRF_MAX_MM {
            return Err(Implausible::Value { index, value: mm.into() });
        }
        srfs.push(mm).map_err(|_| Implausible::Layout { len: data.len() })?;
    }
    Ok(srfs)
}

/// The data of an answer to [`GET_SRF_DATA`].
#[must_use]
pub fn build_srfs(srfs: &Srfs) -> Vec<u8, { 2 * SRFS }> {
    srfs.iter().flat_map(|mm| mm.to_le_bytes()).collect()
}

/// From the data of an answer to [`GET_IR_DATA`]; its bytes are what [`Irs`] holds, both ways.
///
/// # Errors
/// When there are more sensors than the board has.
pub fn parse_irs(data: &[u8]) -> Result<Irs, Implausible> {
    Irs::from_slice(data).map_err(|_| Implausible::Layout { len: data.len() })
}

/// Reason for which a board pulls the PAUSE line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PauseSource {
    /// Not pulled.
    #[default]
    None = 0,
    /// The left infrared ranger.
    IrLeft = 1,
    /// The right one.
    IrRight = 2,
}

impl PauseSource {
    /// From the data of an answer to [`GET_PAUSE_SRC`].
    ///
    /// # Errors
    /// When it is not one byte, or one that names no source.
    pub fn parse(data: &[u8]) -> Result<Self, Implausible> {
        match *data {
            [0] => Ok(Self::None),
            [1] => Ok(Self::IrLeft),
            [2] => Ok(Self::IrRight),
            [value] => Err(Implausible::Value { index: 0, value: value.into() }),
            _ => Err(Implausible::Layout { len: data.len() }),
        }
    }

    /// The data of an answer to [`GET_PAUSE_SRC`].
    #[must_use]
    pub const fn build(self) -> [u8; 1] {
        [self as u8]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Typed from the table: 8 sonars, the first at 1.000 m, the second without echo, then 2 infrared rangers.
    const ANSWER: [u8; 20] = [8, 0xE8, 0x03, 0, 0, 0x2C, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0x10, 0x27, 2, 120, 255];

    #[test]
    fn an_answer_reads_as_the_table_says_and_is_built_the_same() {
        let both = Both::parse(&ANSWER).unwrap();
        assert_eq!(both.srfs, [1000, NO_ECHO, 300, 0, 0, 0, 0, 10_000]);
        assert_eq!(both.irs, [120, OUT_OF_RANGE]);
        assert_eq!(both.build(), ANSWER);
        assert_eq!(build_srfs(&both.srfs), ANSWER[1..17]);
        assert_eq!(parse_srfs(&ANSWER[1..17]).unwrap(), both.srfs);
        assert!(GET_BOTH_DATA.answer.allow(ANSWER.len()) && GET_SRF_DATA.answer.allow(16));
    }

    #[test]
    fn counts_that_do_not_fit_the_length_are_implausible() {
        let layout = |data: &[u8]| {
            assert_eq!(Both::parse(data), Err(Implausible::Layout { len: data.len() }));
        };
        layout(&[]);
        layout(&[8]);
        layout(&[0, 1]);
        layout(&[255, 0, 0]);
        layout(&ANSWER[..19]);
        layout(&[0, 0, 0]);
        // More sensors than the board has; the length is then not an allowed one either.
        let nine = [&[9][..], &[0; 18], &[0]].concat();
        assert_eq!(Both::parse(&nine), Err(Implausible::Layout { len: 18 }));
        assert_eq!(parse_srfs(&[1]), Err(Implausible::Layout { len: 1 }));
        assert_eq!(parse_irs(&[1, 2, 3]), Err(Implausible::Layout { len: 3 }));
    }

    #[test]
    fn a_distance_beyond_the_sonar_s_range_is_implausible() {
        assert_eq!(parse_srfs(&[0, 0, 0xDD, 0x2B]), Err(Implausible::Value { index: 1, value: 11_229 }));
        assert!(parse_srfs(&[0xDC, 0x2B]).is_ok());
    }

    #[test]
    fn a_pause_source_is_one_of_three() {
        for source in [PauseSource::None, PauseSource::IrLeft, PauseSource::IrRight] {
            assert_eq!(PauseSource::parse(&source.build()), Ok(source));
        }
        assert_eq!(PauseSource::parse(&[3]), Err(Implausible::Value { index: 0, value: 3 }));
        assert_eq!(PauseSource::parse(&[]), Err(Implausible::Layout { len: 0 }));
    }
}
