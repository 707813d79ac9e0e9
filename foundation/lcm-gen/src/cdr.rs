//! Messages as ROS 2 encodes them: LCM bytes into CDR, without values in between.
//!
//! A [`Plan`] is compiled once from a type of a [`Schema`]: steps that take so many bytes of the message, turn what is
//! in them around, and append it where ROS 2 expects it. What comes out is little-endian CDR (OMG CORBA 3.0, 15.3; as
//! DDS wraps it: `00 01 00 00` in front, which does not count for the alignment) of the type that [`ros2`](crate::ros2)
//! gives the same name.
//!
//! A message is read as if somebody wanted to harm the reader, exactly as [`dynamic`](crate::dynamic) reads it: what is
//! refused there is refused here. Nothing is allocated but what the output takes.
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

/// The longest message that [`Plan::convert`] makes, bytes; as for LCM.
pub const MESSAGE_MAX: usize = crate::dynamic::MESSAGE_MAX;

/// How many lengths of variable arrays may be in force at once, those of all structs around an element counted. Types
/// with more have no plan.
pub const LENGTHS_MAX: usize = 64;

/// Why bytes do not become CDR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConvertError {
    /// They are no message of the type.
    Message(DecodeError),
    /// What comes out would be longer than [`MESSAGE_MAX`].
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

/// The types of a [`Schema`], made ready for conversion.
#[derive(Clone, Debug, Default)]
pub struct Plans {
    bodies: Vec<Body>,
    index: BTreeMap<String, usize>,
}

impl Plans {
    /// All types of the schema.
    #[must_use]
    pub fn new(schema: &Schema) -> Self {
        let names = schema.definitions().iter().enumerate().map(|(i, definition)| (definition.name(), i));
        Self { bodies: plan::bodies(schema), index: names.collect() }
    }

    /// By LCM's name with package. `None` also for a type that holds itself, at any depth, which ROS 2 does not have,
    /// and for one beyond [`LENGTHS_MAX`].
    #[must_use]
    pub fn get(&self, lcm_name: &str) -> Option<Plan<'_>> {
        let body = &self.bodies[*self.index.get(lcm_name)?];
        body.lengths.is_some_and(|lengths| lengths <= LENGTHS_MAX).then_some(Plan { plans: self, body })
    }
}

/// How messages of one type become CDR.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    plans: &'a Plans,
    body: &'a Body,
}

impl Plan<'_> {
    /// What stands in front of the type's messages.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.body.fingerprint
    }

    /// Appends the message as CDR, with what DDS puts in front, to `out`.
    ///
    /// # Errors
    /// `message` is anything but one message of the type, or becomes too long. `out` is as before then.
    pub fn convert(&self, message: &[u8], out: &mut Vec<u8>) -> Result<(), ConvertError> {
        let before = out.len();
        let result = run::message(&self.plans.bodies, self.body, message, out);
        if result.is_err() {
            out.truncate(before);
        }
        result
    }
}
