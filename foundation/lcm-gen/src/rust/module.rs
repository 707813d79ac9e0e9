//! Packages as modules.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::definition::emit_definition;
use super::doc::emit_doc;
use super::names::{Scope, camel_case, field, has_view, module, view_name};
use super::options::Options;
use crate::{Definition, Error, Schema};

fn check_names(schema: &Schema, options: &Options) -> Result<(), Error> {
    let mut taken: BTreeMap<(&str, String), &Definition> = BTreeMap::new();
    for definition in schema.definitions() {
        let wrong = |message: String| Err(Error::new(&definition.file, definition.at, message));
        if definition.package.split('.').any(|segment| segment == "codec") {
            return wrong("a package cannot be named `codec` in Rust: the generated code needs the name".to_owned());
        }
        let view = has_view(schema, options, definition).then(|| view_name(&definition.short));
        for name in [camel_case(&definition.short)].into_iter().chain(view) {
            if let Some(first) = taken.insert((&definition.package, name), definition) {
                return wrong(format!("`{}` and `{}` get the same name in Rust", first.name(), definition.name()));
            }
        }
        let mut fields: BTreeMap<String, &str> = BTreeMap::new();
        for member in definition.members() {
            if let Some(first) = fields.insert(field(&member.name), &member.name) {
                let message = format!("`{first}` and `{}` get the same name in Rust", member.name);
                return Err(Error::new(&definition.file, member.at, message));
            }
        }
    }
    Ok(())
}

/// Package with those below it.
#[derive(Default)]
pub struct Module<'a> {
    doc: Vec<&'a Vec<String>>,
    definitions: Vec<&'a Definition>,
    pub children: BTreeMap<String, Module<'a>>,
}

impl<'a> Module<'a> {
    /// All packages of the schema.
    pub fn root(schema: &'a Schema, options: &Options) -> Result<Self, Error> {
        check_names(schema, options)?;
        let mut root = Self::default();
        for (package, doc) in schema.packages() {
            let docs = &mut root.at(package).doc;
            if !doc.is_empty() && !docs.contains(&doc) {
                docs.push(doc);
            }
        }
        for definition in schema.definitions() {
            root.at(&definition.package).definitions.push(definition);
        }
        Ok(root)
    }

    fn at(&mut self, package: &str) -> &mut Self {
        package
            .split('.')
            .filter(|segment| !segment.is_empty())
            .fold(self, |module, segment| module.children.entry(segment.to_owned()).or_default())
    }

    /// Writes the module's own types and the modules below it.
    pub fn emit(&self, out: &mut String, schema: &Schema, options: &Options, depth: usize) {
        self.emit_own(out, schema, options, depth);
        for (name, child) in &self.children {
            out.push('\n');
            child.emit_doc(out, name);
            let _ = writeln!(out, "pub mod {} {{", module(name));
            let mut code = String::new();
            child.emit(&mut code, schema, options, depth + 1);
            for line in code.trim_start_matches('\n').lines() {
                let _ = if line.is_empty() { writeln!(out) } else { writeln!(out, "    {line}") };
            }
            out.push_str("}\n");
        }
    }

    /// Writes the module's own types.
    pub fn emit_own(&self, out: &mut String, schema: &Schema, options: &Options, depth: usize) {
        let scope = Scope::new(schema, options, &self.definitions, depth);
        if !self.definitions.is_empty() {
            out.push_str(&scope.import(&self.definitions));
        }
        for definition in &self.definitions {
            emit_definition(out, schema, &scope, definition);
        }
    }

    /// Writes the documentation before `mod`.
    pub fn emit_doc(&self, out: &mut String, name: &str) {
        let paragraphs: Vec<String> = self.doc.iter().map(|lines| lines.join("\n")).collect();
        let doc = if paragraphs.is_empty() { format!("Package `{name}`.") } else { paragraphs.join("\n\n") };
        emit_doc(out, "", doc.lines());
    }
}
