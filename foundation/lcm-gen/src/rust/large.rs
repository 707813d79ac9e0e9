//! Arrays beyond 32 elements, where serde's and the standard library's own implementations stop.

use std::fmt::Write as _;

use super::names::{Scope, field};
use crate::{Member, Size};

/// Whether the member is one.
pub fn is_large(member: &Member) -> bool {
    member.dims.iter().any(|dim| matches!(dim.size, Size::Fixed(33..)))
}

/// `impl Default`.
pub fn emit_default(out: &mut String, scope: &Scope, name: &str, fields: &[&Member]) {
    let default = scope.std_name("Default", "::std::default::Default");
    let _ = write!(out, "\nimpl {default} for {name} {{\n    fn default() -> Self {{\n        Self {{\n");
    for member in fields {
        let mut value = format!("{default}::default()");
        let variable = member.dims.iter().position(|dim| dim.size == Size::Variable).unwrap_or(member.dims.len());
        for _ in member.dims[..variable].iter().filter(|_| is_large(member)) {
            value = format!("::std::array::from_fn(|_| {value})");
        }
        let _ = writeln!(out, "            {}: {value},", field(&member.name));
    }
    out.push_str("        }\n    }\n}\n");
}

/// A serializer for a member that serde's derived one does not take.
pub fn emit_large(out: &mut String, scope: &Scope, name: &str, member: &Member) {
    let row = |level: usize| {
        if level == 0 { "rows".to_owned() } else { format!("row{level}") }
    };
    let last = member.dims.len() - 1;
    let mut value = format!("{}[..]", row(last));
    for level in (0..last).rev() {
        let amp = if level + 1 == last { "&" } else { "" };
        value = format!("{}.iter().map(|{}| {amp}{value}).collect::<::std::vec::Vec<_>>()", row(level), row(level + 1));
    }
    let _ = write!(
        out,
        "
impl {name} {{
    #[allow(non_snake_case)]
    fn serialize_{}<S: ::serde::Serializer>(rows: &{}, serializer: S) -> ::std::result::Result<S::Ok, S::Error> {{
        ::serde::Serialize::serialize(&{value}, serializer)
    }}
}}
",
        member.name,
        scope.member_type(member),
    );
}
