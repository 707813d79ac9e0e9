//! Conversion of LCM messages to the encoding of ROS 2 (CDR), without intermediate values.
//!
//! A [`Plan`] is compiled once from a type of a [`Schema`]: steps that take a number of bytes of the message, swap
//! their byte order, and append them where ROS 2 expects them. The output is little-endian CDR (OMG CORBA 3.0, 15.3; in
//! the encapsulation of DDS: `00 01 00 00` in front, which does not count for the alignment) of the type that
//! [`ros2`](crate::ros2) gives the same name.
//!
//! Messages are treated as hostile input, exactly as in [`dynamic`](crate::dynamic): whatever is rejected there is
//! rejected here. Nothing is allocated except for the output.
//!
//! ```
//! use lcm_gen::{Schema, cdr::Plans};
//!
//! let plans = Plans::new(&Schema::new(&[("t.lcm", "struct t { int8_t a; int32_t b; string c; }")]).unwrap());
//! let plan = plans.get("t").unwrap();
//! let mut message = plan.fingerprint().to_be_bytes().to_vec();
//! message.extend([7, 0, 0, 1, 2, 0, 0, 0, 3, b'h', b'i', 0]);
//! let mut out = Vec::new();
//! plan.convert(&message, &mut out).unwrap();
//! assert_eq!(out, [0, 1, 0, 0, 7, 0, 0, 0, 2, 1, 0, 0, 3, 0, 0, 0, b'h', b'i', 0]);
//! ```

mod plan;
mod run;
mod writer;

use std::collections::BTreeMap;
use std::fmt;

use crate::Schema;
use crate::dynamic::DecodeError;
use plan::Body;

pub use writer::Writer;

/// Longest message produced by [`Plan::convert`], bytes; the same as for LCM.
pub const MESSAGE_MAX: usize = crate::dynamic::MESSAGE_MAX;

/// Maximum number of lengths of variable arrays in scope at once, including those of all enclosing structs. Types with
/// more have no plan.
pub const LENGTHS_MAX: usize = 64;

/// Reason why a message cannot be converted to CDR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConvertError {
    /// The bytes are not a message of the type.
    Message(DecodeError),
    /// The output would be longer than [`MESSAGE_MAX`].
    TooLong,
}

impl fmt::Display for ConvertError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Message(error) => error.fmt(f),
            Self::TooLong => write!(f, "longer than {} MiB as CDR", MESSAGE_MAX >> 20),
        }
    }
}

impl std::error::Error for ConvertError {}

impl From<DecodeError> for ConvertError {
    fn from(error: DecodeError) -> Self {
        Self::Message(error)
    }
}

/// Types of a [`Schema`], compiled for conversion.
#[derive(Clone, Debug, Default)]
pub struct Plans {
    bodies: Vec<Body>,
    index: BTreeMap<String, usize>,
}

impl Plans {
    /// Compiles all types of the schema.
    #[must_use]
    pub fn new(schema: &Schema) -> Self {
        let names = schema.definitions().iter().enumerate().map(|(i, definition)| (definition.name(), i));
        Self { bodies: plan::bodies(schema), index: names.collect() }
    }

    /// Plan of a type by its LCM name with package. `None` also for a recursive type, which ROS 2 does not support, and
    /// for one beyond [`LENGTHS_MAX`].
    #[must_use]
    pub fn get(&self, lcm_name: &str) -> Option<Plan<'_>> {
        let body = &self.bodies[*self.index.get(lcm_name)?];
        body.lengths.is_some_and(|lengths| lengths <= LENGTHS_MAX).then_some(Plan { plans: self, body })
    }
}

/// Conversion of the messages of one type to CDR.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    plans: &'a Plans,
    body: &'a Body,
}

impl Plan<'_> {
    /// Fingerprint at the beginning of the type's messages.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.body.fingerprint
    }

    /// Appends the message as CDR, with the encapsulation header of DDS, to `out`.
    ///
    /// # Errors
    /// `message` is not exactly one message of the type, or the output becomes too long. `out` is then unchanged.
    pub fn convert(&self, message: &[u8], out: &mut Vec<u8>) -> Result<(), ConvertError> {
        let before = out.len();
        let result = run::message(&self.plans.bodies, self.body, message, out);
        if result.is_err() {
            out.truncate(before);
        }
        result
    }
}
