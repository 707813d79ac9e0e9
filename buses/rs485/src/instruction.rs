//! Instructions of boards, and requests by them: what master, boards and schedule have in common.

/// One instruction of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Number on the wire.
    pub code: u8,
    /// Name in the board's table.
    pub name: &'static str,
    /// Which lengths a request's data may have.
    pub request: Lengths,
    /// Which lengths a good answer's data may have.
    pub answer: Lengths,
}

impl Instruction {
    /// The request of this instruction to the board at address `to`.
    #[must_use]
    pub const fn ask<'a>(&self, to: u8, data: &'a [u8]) -> Request<'a> {
        Request { to, instruction: self.code, data, no_ack: false, answer: self.answer }
    }
}

/// Which lengths an answer's data may have: every `step`-th number of bytes from `min` to `max`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lengths {
    /// Fewest bytes.
    pub min: u8,
    /// Most bytes.
    pub max: u8,
    /// Distance of two allowed lengths; 0 counts as 1.
    pub step: u8,
}

impl Lengths {
    /// Any length.
    pub const ANY: Self = Self::between(0, 255);
    /// No data.
    pub const NONE: Self = Self::exactly(0);

    /// Exactly this length.
    #[must_use]
    pub const fn exactly(length: u8) -> Self {
        Self { min: length, max: length, step: 1 }
    }

    /// Any length from `min` to `max`.
    #[must_use]
    pub const fn between(min: u8, max: u8) -> Self {
        Self { min, max, step: 1 }
    }

    /// True if data of `length` bytes is allowed.
    #[must_use]
    pub fn allow(self, length: usize) -> bool {
        let (min, max, step) = (usize::from(self.min), usize::from(self.max), usize::from(self.step.max(1)));
        (min..=max).contains(&length) && (length - min).is_multiple_of(step)
    }
}

/// Request to a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request<'a> {
    /// The node; [`BROADCAST`](crate::frame::BROADCAST) is never answered.
    pub to: u8,
    /// The instruction.
    pub instruction: u8,
    /// At most [`MAX_DATA`](crate::frame::MAX_DATA) bytes.
    pub data: &'a [u8],
    /// Ask the node not to answer.
    pub no_ack: bool,
    /// Which lengths a good answer may have; another one counts as damaged.
    pub answer: Lengths,
}

impl<'a> Request<'a> {
    /// A request that is answered, by any number of bytes.
    #[must_use]
    pub const fn new(to: u8, instruction: u8, data: &'a [u8]) -> Self {
        Self { to, instruction, data, no_ack: false, answer: Lengths::ANY }
    }
}
