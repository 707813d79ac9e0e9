//! Names and types in Rust.

use std::collections::BTreeSet;

use super::options::Options;
use crate::{Definition, Dim, Member, MemberType, Primitive, Schema, Size};

const KEYWORDS: &[&str] = &[
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do", "dyn", "else", "enum",
    "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop", "macro", "match", "mod", "move",
    "mut", "override", "priv", "pub", "ref", "return", "static", "struct", "trait", "true", "try", "type", "typeof",
    "unsafe", "unsized", "use", "virtual", "where", "while", "yield",
];

/// Name as an identifier: raw if it is a keyword, changed if it cannot be raw.
pub fn safe(name: &str) -> String {
    match name {
        "_" => "unnamed".to_owned(),
        "self" | "Self" | "super" | "crate" => format!("{name}_"),
        _ if KEYWORDS.contains(&name) => format!("r#{name}"),
        _ => name.to_owned(),
    }
}

pub fn field(name: &str) -> String {
    safe(name)
}

pub fn module(segment: &str) -> String {
    safe(segment)
}

/// `data_state_t` becomes `DataState`.
pub fn camel_case(short: &str) -> String {
    safe(&words(short))
}

/// Name of the borrowing type: `data_state_t` becomes `DataStateRef`.
pub fn view_name(short: &str) -> String {
    words(short) + "Ref"
}

/// `data_state_t` becomes `DataState`, even if that is a keyword.
pub fn words(short: &str) -> String {
    let stem = short.strip_suffix("_t").unwrap_or(short);
    let mut name = String::new();
    for word in stem.split('_') {
        let mut chars = word.chars();
        name.extend(chars.next().map(|first| first.to_ascii_uppercase()));
        name.push_str(chars.as_str());
    }
    match name.chars().next() {
        None => format!("T{}", short.len()),
        Some(first) if first.is_ascii_digit() => format!("T{name}"),
        Some(_) => name,
    }
}

pub fn primitive(ty: Primitive) -> &'static str {
    match ty {
        Primitive::Int8 => "i8",
        Primitive::Int16 => "i16",
        Primitive::Int32 => "i32",
        Primitive::Int64 => "i64",
        Primitive::Byte => "u8",
        Primitive::Float => "f32",
        Primitive::Double => "f64",
        Primitive::String => "String",
        Primitive::Boolean => "bool",
    }
}

/// First of the words that is not the name of a member.
pub fn free(words: &[&str], members: &[Member]) -> String {
    let taken = |word: &str| members.iter().any(|member| member.name == word);
    let mut found = words.iter().find(|word| !taken(word)).map_or_else(|| words[0].to_owned(), |&word| word.to_owned());
    while taken(&found) {
        found.push('_');
    }
    found
}

/// Scope of a module of the generated code.
pub struct Scope<'a> {
    schema: &'a Schema,
    pub options: &'a Options,
    types: BTreeSet<String>,
    depth: usize,
    package: String,
}

impl<'a> Scope<'a> {
    pub fn new(schema: &'a Schema, options: &'a Options, definitions: &[&Definition], depth: usize) -> Self {
        let types = definitions.iter().map(|definition| camel_case(&definition.short)).collect();
        let package = definitions.first().map_or_else(String::new, |definition| definition.package.clone());
        Self { schema, options, types, depth, package }
    }

    /// Name from the prelude; fully qualified if a type of the module has the same name.
    pub fn known<'b>(&self, name: &'b str, full: &'b str) -> &'b str {
        if self.types.contains(name) { full } else { name }
    }

    /// Import line for the names that the definitions need.
    pub fn import(&self, definitions: &[&Definition]) -> String {
        let members = || definitions.iter().flat_map(|definition| definition.members());
        let string = members().any(|member| member.ty == MemberType::Primitive(Primitive::String));
        let needed = [("String", string), ("Vec", members().any(Member::is_variable))];
        let names: String = needed
            .iter()
            .filter(|(name, needed)| *needed && !self.types.contains(*name))
            .map(|(name, _)| format!(", {name}"))
            .collect();
        if names.is_empty() {
            "use ::lcm::codec;\n".to_owned()
        } else {
            format!("use ::lcm::codec::{{self{names}}};\n")
        }
    }

    pub fn member_type(&self, member: &Member) -> String {
        let element = match &member.ty {
            MemberType::Primitive(Primitive::String) => self.known("String", "codec::String").to_owned(),
            MemberType::Primitive(ty) => primitive(*ty).to_owned(),
            MemberType::Named(name) => self.path(name, camel_case),
        };
        member.dims.iter().rev().fold(element, |element, dim| self.array(&element, dim))
    }

    fn array(&self, element: &str, dim: &Dim) -> String {
        match dim.size {
            Size::Fixed(n) => format!("[{element}; {n}]"),
            Size::Variable => format!("{}<{element}>", self.known("Vec", "codec::Vec")),
        }
    }

    /// Type of a member that borrows from the message where possible.
    pub fn view_type(&self, member: &Member) -> String {
        let byte = member.ty == MemberType::Primitive(Primitive::Byte);
        let row = |dims: &[Dim]| Member { dims: dims.to_vec(), ..member.clone() };
        match (&member.dims[..], &member.ty) {
            ([Dim { size: Size::Fixed(n), .. }], _) if byte => format!("&'a [u8; {n}]"),
            ([Dim { size: Size::Variable, .. }], _) if byte => "&'a [u8]".to_owned(),
            (dims, _) if is_fixed_row(self.schema, member, dims) => self.member_type(member),
            ([Dim { size: Size::Variable, .. }, inner @ ..], _) if is_fixed_row(self.schema, member, inner) => {
                format!("codec::Elements<'a, {}>", self.member_type(&row(inner)))
            }
            ([dim, inner @ ..], _) => self.array(&self.view_type(&row(inner)), dim),
            ([], MemberType::Named(name)) if borrows(self.schema, name) => self.path(name, view_name) + "<'a>",
            ([], MemberType::Named(_)) => self.member_type(member),
            ([], MemberType::Primitive(_)) => "&'a str".to_owned(),
        }
    }

    /// Path of a type from this module.
    fn path(&self, name: &str, rust: fn(&str) -> String) -> String {
        let (package, short) = name.rsplit_once('.').unwrap_or(("", name));
        if package == self.package {
            return rust(short);
        }
        let up = "super::".repeat(self.depth);
        let down = package.split('.').filter(|segment| !segment.is_empty()).map(|segment| module(segment) + "::");
        format!("{up}{}{}", down.collect::<String>(), rust(short))
    }
}

/// True if values of the member's type, in arrays of these dimensions, have a constant size.
pub fn is_fixed_row(schema: &Schema, member: &Member, dims: &[Dim]) -> bool {
    let element = match &member.ty {
        MemberType::Primitive(ty) => *ty != Primitive::String,
        MemberType::Named(name) => schema.is_fixed(name),
    };
    element && dims.iter().all(|dim| dim.size != Size::Variable)
}

/// True if a value of the type can borrow from the message: a string, a variable array of fixed-size elements, or an
/// array of bytes, at any depth outside fixed-size types.
pub fn borrows(schema: &Schema, name: &str) -> bool {
    let stays = |member: &Member| match member.ty {
        MemberType::Primitive(Primitive::String) => true,
        MemberType::Primitive(Primitive::Byte) if member.dims.len() == 1 => true,
        _ => member.is_variable() && is_fixed_row(schema, member, &[]),
    };
    schema.parts(name).any(|part| !schema.is_fixed(&part.name()) && part.members().iter().any(stays))
}

/// True if the member is only a length: the outermost dimension of an array.
pub fn is_implicit(member: &Member, members: &[Member]) -> bool {
    members
        .iter()
        .any(|other| other.dims.first().is_some_and(|dim| dim.size == Size::Variable && dim.text == member.name))
}

/// True if a member's name does not follow Rust's naming convention.
pub fn has_upper_case(members: &[Member]) -> bool {
    members.iter().any(|member| member.name.contains(|c: char| c.is_ascii_uppercase()))
}

/// True if the definition also has a borrowing type.
pub fn has_view(schema: &Schema, options: &Options, definition: &Definition) -> bool {
    options.views && borrows(schema, &definition.name())
}
