//! Test vectors, types by name, comparison of values.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "tests read their own files, which are there")]

#[path = "support/files.rs"]
pub mod files;

use std::fmt::Debug;
use std::fs;

use files::folder;
use lcm::codec::{DecodeError, Type, View};
use serde_json::Value;

use crate::own::more;
use crate::vectors::{Nopkg, NopkgRef, advee, vec};

/// Content of `vectors.json`.
pub struct Vectors {
    pub types: Vec<Value>,
    pub messages: Vec<Value>,
}

impl Vectors {
    pub fn load() -> Self {
        let text = fs::read_to_string(folder("vectors/vectors.json")).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        let list = |key: &str| json[key].as_array().unwrap().clone();
        Self { types: list("types"), messages: list("messages") }
    }
}

pub fn hex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
}

/// Operation on a type known by name only.
pub trait Visitor {
    type Output;
    fn visit<T: Type + serde::Serialize + serde::de::DeserializeOwned>(self) -> Self::Output;
}

macro_rules! types {
    ($($type:ty),* $(,)?) => {
        /// Visits the generated type of that name.
        pub fn for_all_types<V: Visitor>(name: &str, visitor: V) -> V::Output {
            $(if name == <$type>::NAME {
                return visitor.visit::<$type>();
            })*
            panic!("no type {name} here")
        }
    };
}

types![
    advee::Range,
    advee::RangeScan,
    Nopkg,
    vec::Arrays,
    vec::Color,
    vec::Constants,
    vec::ConstantsDec,
    vec::deep::er::Wrapper,
    vec::Empty,
    vec::EnumUser,
    vec::geom::Point,
    vec::Nested,
    vec::other::SeveralC,
    vec::other::SeveralD,
    vec::Ping,
    vec::Pong,
    vec::Primitives,
    vec::SeveralA,
    vec::SeveralB,
    vec::Tree,
    more::Empty,
    more::Item,
    more::Large,
    more::LargeFixed,
    more::Lengths,
    more::Nothing,
    more::r#mod::r#type::Default,
    more::r#mod::r#type::Option,
    more::r#mod::r#type::Result,
    more::r#mod::r#type::Self_,
    more::r#mod::r#type::String,
    more::r#mod::r#type::Vec,
];

/// Message decoded by its type and by the type's view, for comparison.
pub type Readings = (Result<String, DecodeError>, Result<String, DecodeError>);

fn both<'a, V: View<'a, Of: Debug> + Debug>(bytes: &'a [u8]) -> Readings {
    let owned = V::Of::decode(bytes).map(|value| format!("{value:?}").replace("Self_ {", "Self {"));
    let view = V::decode(bytes).map(|value| format!("{value:?}").replace("Ref {", " {"));
    (owned, view)
}

macro_rules! views {
    ($($type:ty),* $(,)?) => {
        /// Results of both decoders of the type of that name; `None` if it has no view.
        pub fn readings(name: &str, bytes: &[u8]) -> Option<Readings> {
            $(if name == <<$type as View>::Of as Type>::NAME {
                return Some(both::<$type>(bytes));
            })*
            None
        }
    };
}

views![
    advee::RangeScanRef<'_>,
    NopkgRef<'_>,
    vec::ArraysRef<'_>,
    vec::deep::er::WrapperRef<'_>,
    vec::NestedRef<'_>,
    vec::PrimitivesRef<'_>,
    vec::TreeRef<'_>,
    more::ItemRef<'_>,
    more::LargeRef<'_>,
    more::LengthsRef<'_>,
    more::r#mod::r#type::SelfRef<'_>,
    more::r#mod::r#type::StringRef<'_>,
    more::r#mod::r#type::VecRef<'_>,
];

/// Compares a value as JSON with that of the vectors, in which lengths are members, bytes are hexadecimal, and floats
/// that JSON cannot represent are strings.
pub fn same(path: &str, ours: &Value, theirs: &Value) {
    match (ours, theirs) {
        (Value::Object(ours), Value::Object(theirs)) => {
            for (name, value) in ours {
                same(&format!("{path}.{name}"), value, &theirs[name]);
            }
            for (name, value) in theirs.iter().filter(|(name, _)| !ours.contains_key(*name)) {
                let count = value.as_u64().unwrap_or_else(|| panic!("{path}.{name} is missing"));
                let lent = ours.values().any(|value| value.as_array().is_some_and(|array| array.len() as u64 == count));
                assert!(lent, "{path}.{name} is the length of nothing");
            }
        }
        (Value::Array(ours), Value::Array(theirs)) => {
            assert_eq!(ours.len(), theirs.len(), "{path}");
            ours.iter().zip(theirs).for_each(|(ours, theirs)| same(path, ours, theirs));
        }
        (Value::Array(ours), Value::String(theirs)) => {
            let bytes: Vec<u64> = hex(theirs).into_iter().map(u64::from).collect();
            let ours: Vec<u64> = ours.iter().map(|byte| byte.as_u64().unwrap()).collect();
            assert_eq!(ours, bytes, "{path}");
        }
        (Value::Null, Value::String(theirs)) => {
            assert!(["inf", "-inf"].contains(&theirs.as_str()), "{path}");
        }
        (Value::Number(ours), Value::String(theirs)) => {
            assert_eq!(ours.as_f64().map(f64::to_bits), theirs.parse().ok().map(f64::to_bits), "{path}");
        }
        // serde_json reads a decimal number to within one unit in its last place; the bytes are compared elsewhere.
        (Value::Number(ours), Value::Number(theirs)) if ours.is_f64() => {
            let (ours, theirs) = (ours.as_f64().unwrap(), theirs.as_f64().unwrap());
            assert!((ours - theirs).abs() <= ours.abs() * f64::EPSILON, "{path}: {ours} and {theirs}");
        }
        (ours, theirs) => assert_eq!(ours, theirs, "{path}"),
    }
}
