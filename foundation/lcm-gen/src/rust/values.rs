//! Constants and enums.

use std::fmt::Write as _;

use super::body::{Body, emit_type};
use super::doc::emit_doc_or;
use super::names::{Scope, camel_case, primitive, safe};
use crate::{Constant, Definition, Literal, Primitive, Schema, Value};

pub fn emit_enum(out: &mut String, schema: &Schema, scope: &Scope, definition: &Definition, values: &[Value]) {
    let name = camel_case(&definition.short);
    let _ = writeln!(out, "#[derive(Clone, Copy, Debug, Default, PartialEq, Eq{})]", scope.options.serde.derives());
    let _ = writeln!(out, "pub struct {name}(pub i32);");
    if !values.is_empty() {
        let odd = values.iter().any(|value| value.name.contains(|c: char| c.is_ascii_lowercase()));
        let _ = write!(out, "\n{}impl {name} {{\n", if odd { "#[allow(non_upper_case_globals)]\n" } else { "" });
        for Value { name, number, doc } in values {
            emit_doc_or(out, "    ", doc, &format!("{name} = {number}"));
            let _ = writeln!(out, "    pub const {}: Self = Self({number});", safe(name));
        }
        out.push_str("}\n");
    }
    let _ = write!(
        out,
        "
impl codec::Fixed for {name} {{
    const SIZE: usize = 4;

    #[inline]
    fn store(&self, out: &mut [u8]) {{
        self.0.store(out);
    }}

    #[inline]
    fn load(bytes: &[u8]) -> Self {{
        Self(codec::Fixed::load(bytes))
    }}
}}
"
    );
    emit_type(out, schema, scope, definition, &Body::whole());
}

pub fn emit_constants(out: &mut String, name: &str, constants: &[Constant]) {
    if constants.is_empty() {
        return;
    }
    out.push('\n');
    if constants.iter().any(|constant| matches!(constant.literal, Literal::Float(_))) {
        out.push_str("#[allow(clippy::approx_constant, clippy::excessive_precision)]\n");
    }
    if constants.iter().any(|constant| constant.name.contains(|c: char| c.is_ascii_lowercase())) {
        out.push_str("#[allow(non_upper_case_globals)]\n");
    }
    let _ = writeln!(out, "impl {name} {{");
    for Constant { name, ty, text, literal, doc } in constants {
        emit_doc_or(out, "    ", doc, &format!("const {} {name} = {text}", ty.name()));
        let value = match literal {
            Literal::Int(value) if text.starts_with("0x") => format!("{value:#x}"),
            Literal::Int(value) => value.to_string(),
            Literal::Float(value) if *ty == Primitive::Float => format!("{:?}", *value as f32),
            Literal::Float(value) => format!("{value:?}"),
        };
        let _ = writeln!(out, "    pub const {}: {} = {value};", safe(name), primitive(*ty));
    }
    out.push_str("}\n");
}
