//! Arrays of more than 32 elements, which serde and `Default` of the standard library do not implement.

use std::fmt::Write as _;

use super::names::{Scope, field};
use super::options::Serde;
use crate::{Member, Size};

/// True if the member is such an array.
pub fn is_large(member: &Member) -> bool {
    member.dims.iter().any(|dim| matches!(dim.size, Size::Fixed(33..)))
}

/// `impl Default`.
pub fn emit_default(out: &mut String, scope: &Scope, name: &str, fields: &[&Member]) {
    let default = scope.known("Default", "::core::default::Default");
    let _ = write!(out, "\nimpl {default} for {name} {{\n    fn default() -> Self {{\n        Self {{\n");
    for member in fields {
        let mut value = format!("{default}::default()");
        let variable = member.dims.iter().position(|dim| dim.size == Size::Variable).unwrap_or(member.dims.len());
        for _ in member.dims[..variable].iter().filter(|_| is_large(member)) {
            value = format!("::core::array::from_fn(|_| {value})");
        }
        let _ = writeln!(out, "            {}: {value},", field(&member.name));
    }
    out.push_str("        }\n    }\n}\n");
}

/// Functions for a member that serde's derive macros do not support.
pub fn emit_large(out: &mut String, scope: &Scope, name: &str, member: &Member) {
    let serde = scope.options.serde;
    if serde == Serde::None {
        return;
    }
    let rust = scope.member_type(member);
    let _ = write!(
        out,
        "
impl {name} {{
    #[allow(non_snake_case)]
    fn serialize_{}<S: ::serde::Serializer>(rows: &{rust}, serializer: S) -> ::core::result::Result<S::Ok, S::Error> {{
        ::serde::Serialize::serialize(&{}, serializer)
    }}
",
        member.name,
        rows_of(member),
    );
    if serde == Serde::Both {
        let _ = write!(
            out,
            "
    #[allow(non_snake_case)]
    fn deserialize_{}<'de, D: ::serde::Deserializer<'de>>(deserializer: D) -> ::core::result::Result<{rust}, D::Error> {{
        let rows: {} = ::serde::Deserialize::deserialize(deserializer)?;
        let wrong = || <D::Error as ::serde::de::Error>::custom(\"`{}` has another length\");
        {}
    }}
",
            member.name,
            member.dims.iter().fold("_".to_owned(), |row, _| format!("codec::Vec<{row}>")),
            member.name,
            array_of(member, 0),
        );
    }
    out.push_str("}\n");
}

fn row(level: usize) -> String {
    if level == 0 { "rows".to_owned() } else { format!("row{level}") }
}

/// Converts the member to nested lists.
fn rows_of(member: &Member) -> String {
    let last = member.dims.len() - 1;
    let mut value = format!("{}[..]", row(last));
    for level in (0..last).rev() {
        let amp = if level + 1 == last { "&" } else { "" };
        value = format!("{}.iter().map(|{}| {amp}{value}).collect::<codec::Vec<_>>()", row(level), row(level + 1));
    }
    value
}

/// Converts nested lists to the member, as a `Result`.
fn array_of(member: &Member, level: usize) -> String {
    let (this, next) = (row(level), row(level + 1));
    let rows = if member.dims[level + 1..].iter().all(|dim| dim.size == Size::Variable) {
        this
    } else {
        let inner = array_of(member, level + 1);
        let collect = "collect::<::core::result::Result<codec::Vec<_>, D::Error>>()?";
        format!("{this}.into_iter().map(|{next}| {inner}).{collect}")
    };
    match member.dims[level].size {
        Size::Fixed(_) => format!("::core::convert::TryInto::try_into({rows}).map_err(|_| wrong())"),
        Size::Variable => format!("::core::result::Result::Ok({rows})"),
    }
}
