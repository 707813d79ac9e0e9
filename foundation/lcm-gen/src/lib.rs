//! LCM type language: parser, fingerprints, Rust generator.
//!
//! Strings in, strings out: the caller reads the `.lcm` files. Only [`build`], for build scripts, accesses files.
//!
//! ```
//! let files = [("point.lcm", "package demo; struct point_t { double x, y, z; }")];
//! let schema = lcm_gen::Schema::new(&files).unwrap();
//! assert_eq!(schema.fingerprint("demo.point_t"), Some(0xae7e5fba5eeca11e));
//! let code = lcm_gen::rust::generate(&schema, &lcm_gen::rust::Options::default()).unwrap();
//! assert!(code.contains("pub struct Point"));
//! ```
//!
//! Differs from the official `lcm-gen` in its quirks: braces need no white space around them, the package does not
//! persist from one file to the next, a comment at the end of a line documents the declaration on that line. Rejected
//! here and accepted there: names that are not identifiers, `int64_t` constants out of range, arrays of enums (encoded
//! wrongly in C), types that contain themselves without end or nest deeper than 64 levels, arrays above the largest
//! message.
//!
//! - [`Schema`]: definitions, fingerprints, sizes; [`rust`]: code from them; [`build`]: the same for a build script.
//! - [`dynamic`]: messages without generated code; with the feature `serde` to and from any serde format.
//! - [`ros2`]: the types in the language of ROS 2; [`cdr`]: messages in its encoding.
#![forbid(unsafe_code)]

mod ast;
pub mod build;
pub mod cdr;
pub mod dynamic;
mod error;
mod fingerprint;
mod parse;
pub mod ros2;
pub mod rust;
mod schema;
mod token;

pub use ast::{Constant, Definition, Dim, Kind, Literal, Member, MemberType, Primitive, Size, Value};
pub use error::{At, Error};
pub use parse::{File, parse};
pub use schema::Schema;
