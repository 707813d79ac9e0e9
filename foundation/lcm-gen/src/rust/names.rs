//! Names and types in Rust.

use std::collections::BTreeSet;

use crate::{Definition, Member, MemberType, Primitive, Size};

const KEYWORDS: &[&str] = &[
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do", "dyn", "else", "enum",
    "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop", "macro", "match", "mod", "move",
    "mut", "override", "priv", "pub", "ref", "return", "static", "struct", "trait", "true", "try", "type", "typeof",
    "unsafe", "unsized", "use", "virtual", "where", "while", "yield",
];

/// A name as an identifier: raw if it is a keyword, another word if it cannot even be raw.
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
        Some(_) => safe(&name),
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

/// The first of the words that no member is named.
pub fn free(words: &[&str], members: &[Member]) -> String {
    let taken = |word: &str| members.iter().any(|member| member.name == word);
    let mut found = words.iter().find(|word| !taken(word)).map_or_else(|| words[0].to_owned(), |&word| word.to_owned());
    while taken(&found) {
        found.push('_');
    }
    found
}

/// A module of the generated code: what names mean in it.
pub struct Scope {
    types: BTreeSet<String>,
    depth: usize,
    package: String,
}

impl Scope {
    pub fn new(definitions: &[&Definition], depth: usize) -> Self {
        let types = definitions.iter().map(|definition| camel_case(&definition.short)).collect();
        let package = definitions.first().map_or_else(String::new, |definition| definition.package.clone());
        Self { types, depth, package }
    }

    /// A name from the standard library's prelude; in full where a type of the module has the same.
    pub fn std_name<'a>(&self, name: &'a str, full: &'a str) -> &'a str {
        if self.types.contains(name) { full } else { name }
    }

    pub fn member_type(&self, member: &Member) -> String {
        let element = match &member.ty {
            MemberType::Primitive(Primitive::String) => self.std_name("String", "::std::string::String").to_owned(),
            MemberType::Primitive(ty) => primitive(*ty).to_owned(),
            MemberType::Named(name) => self.path(name),
        };
        let vec = self.std_name("Vec", "::std::vec::Vec");
        member.dims.iter().rev().fold(element, |element, dim| match dim.size {
            Size::Fixed(n) => format!("[{element}; {n}]"),
            Size::Variable => format!("{vec}<{element}>"),
        })
    }

    /// The path of a type from here.
    fn path(&self, name: &str) -> String {
        let (package, short) = name.rsplit_once('.').unwrap_or(("", name));
        if package == self.package {
            return camel_case(short);
        }
        let up = "super::".repeat(self.depth);
        let down = package.split('.').filter(|segment| !segment.is_empty()).map(|segment| module(segment) + "::");
        format!("{up}{}{}", down.collect::<String>(), camel_case(short))
    }
}
