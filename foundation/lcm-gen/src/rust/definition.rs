//! Code of one definition: types, fields and views.

use super::body::{self, Body, emit_type};
use super::doc::emit_doc_or;
use super::large::{emit_default, emit_large, is_large};
use super::names::{Scope, camel_case, field, has_upper_case, has_view, is_implicit, safe, view_name};
use super::options::Serde;
use super::values::{emit_constants, emit_enum};
use crate::{Constant, Definition, Kind, Member, MemberType, Schema};
use std::fmt::Write as _;

/// Writes the types of one definition.
pub fn emit_definition(out: &mut String, schema: &Schema, scope: &Scope, definition: &Definition) {
    out.push('\n');
    emit_doc_or(out, "", &definition.doc, &definition.name());
    match &definition.kind {
        Kind::Struct { constants, members } => {
            emit_struct(out, schema, scope, definition, constants, members);
        }
        Kind::Enum { values } => emit_enum(out, schema, scope, definition, values),
    }
}

fn emit_struct(
    out: &mut String,
    schema: &Schema,
    scope: &Scope,
    definition: &Definition,
    constants: &[Constant],
    members: &[Member],
) {
    let name = camel_case(&definition.short);
    let fields: Vec<&Member> = members.iter().filter(|member| !is_implicit(member, members)).collect();
    let large = fields.iter().any(|member| is_large(member));
    let default = if large { "" } else { "Default, " };
    let _ = writeln!(out, "#[derive(Clone, Debug, {default}PartialEq{})]", scope.options.serde.derives());
    if has_upper_case(members) {
        out.push_str("#[allow(non_snake_case)]\n");
    }
    if fields.is_empty() {
        let _ = writeln!(out, "pub struct {name} {{}}");
    } else {
        let _ = writeln!(out, "pub struct {name} {{");
        for member in &fields {
            emit_doc_or(out, "    ", &member.doc, &declaration(member));
            emit_serde(out, scope.options.serde, member, &name);
            let _ = writeln!(out, "    pub {}: {},", field(&member.name), scope.member_type(member));
        }
        out.push_str("}\n");
    }
    emit_constants(out, &name, constants);
    if large {
        emit_default(out, scope, &name, &fields);
    }
    for member in fields.iter().filter(|member| is_large(member)) {
        emit_large(out, scope, &name, member);
    }
    if schema.is_fixed(&definition.name()) {
        emit_fixed(out, schema, &name, members);
        emit_type(out, schema, scope, definition, &Body::whole());
    } else {
        emit_type(out, schema, scope, definition, &Body::of(schema, definition));
    }
    if has_view(schema, scope.options, definition) {
        emit_view(out, schema, scope, definition, &fields);
    }
}

/// Writes the type that borrows from a message.
fn emit_view(out: &mut String, schema: &Schema, scope: &Scope, definition: &Definition, fields: &[&Member]) {
    let (name, view) = (camel_case(&definition.short), view_name(&definition.short));
    let (reader, decode) = body::view(schema, definition);
    let (snake, allow) = match has_upper_case(definition.members()) {
        true => (", non_snake_case", "#[allow(non_snake_case)]\n"),
        false => ("", ""),
    };
    let fields: String = fields
        .iter()
        .map(|member| format!("    pub {}: {},\n", field(&member.name), scope.view_type(member)))
        .collect();
    let result = scope.known("Result", "::core::result::Result");
    let _ = write!(
        out,
        "
/// Borrowed form of [`{name}`]: strings and arrays stay in the message where possible.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs{snake})]
pub struct {view}<'a> {{
{fields}}}

{allow}impl<'a> codec::View<'a> for {view}<'a> {{
    type Of = {name};

    fn decode_body({reader}: &mut codec::Reader<'a>) -> {result}<Self, codec::DecodeError> {{
{decode}    }}
}}
"
    );
}
/// Declaration of a member in the LCM language.
fn declaration(member: &Member) -> String {
    let ty = match &member.ty {
        MemberType::Primitive(primitive) => primitive.name(),
        MemberType::Named(name) => name,
    };
    let dims: String = member.dims.iter().map(|dim| format!("[{}]", dim.text)).collect();
    format!("{ty} {}{dims}", member.name)
}

fn emit_serde(out: &mut String, serde: Serde, member: &Member, owner: &str) {
    if serde == Serde::None {
        return;
    }
    let name = &member.name;
    if safe(name) != *name && !field(name).starts_with("r#") {
        let _ = writeln!(out, "    #[serde(rename = \"{name}\")]");
    }
    if is_large(member) {
        let _ = writeln!(out, "    #[serde(serialize_with = \"{owner}::serialize_{name}\")]");
    }
    if is_large(member) && serde == Serde::Both {
        let _ = writeln!(out, "    #[serde(deserialize_with = \"{owner}::deserialize_{name}\")]");
    }
}

/// `impl Fixed`: each member at its offset.
fn emit_fixed(out: &mut String, schema: &Schema, name: &str, members: &[Member]) {
    let (mut store, mut load, mut offset) = (String::new(), String::new(), 0);
    for member in members {
        let end = offset + body::min_size(schema, member);
        let field = field(&member.name);
        let _ = writeln!(store, "        self.{field}.store(&mut out[{offset}..{end}]);");
        let _ = writeln!(load, "            {field}: codec::Fixed::load(&bytes[{offset}..{end}]),");
        offset = end;
    }
    let (out_name, bytes_name) = if members.is_empty() { ("_out", "_bytes") } else { ("out", "bytes") };
    let load = if members.is_empty() { "Self {}".to_owned() } else { format!("Self {{\n{load}        }}") };
    let _ = write!(
        out,
        "
impl codec::Fixed for {name} {{
    const SIZE: usize = {offset};

    #[inline]
    fn store(&self, {out_name}: &mut [u8]) {{
{store}    }}

    #[inline]
    fn load({bytes_name}: &[u8]) -> Self {{
        {load}
    }}
}}
"
    );
}
