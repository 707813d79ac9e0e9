//! Types of TypeScript from types of Rust that serde writes or reads as JSON.
//!
//! A type or an attribute of serde's without an equivalent here is an error: nothing is left out silently.

mod attributes;

use crate::text::{WIDTH, comment, doc};
use attributes::{reads, serde};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use syn::punctuated::Punctuated;
use syn::{Expr, ExprLit, Field, Fields, GenericArgument, GenericParam, Generics, Item, ItemEnum, ItemStruct};
use syn::{Lit, PathArguments, PathSegment, Token, Type};

/// A type of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Export {
    /// The file that has it.
    pub file: &'static str,
    /// Name in Rust.
    pub rust: &'static str,
    /// Name in TypeScript.
    pub page: &'static str,
}

/// Types whose equivalent is written here: any message, as JSON.
const GIVEN: [(&str, &str); 1] = [("Message", "Record<string, unknown>")];

/// Rust files, and which of their types the page has.
pub struct Library {
    files: BTreeMap<&'static str, syn::File>,
    exports: Vec<Export>,
    packages: BTreeSet<String>,
    /// Messages that were referred to: package, and name in Rust.
    used: RefCell<BTreeSet<(String, String)>>,
}

impl Library {
    /// Files by their paths; the types of the page; the packages of messages.
    #[must_use]
    pub fn new(
        files: impl IntoIterator<Item = (&'static str, syn::File)>,
        exports: &[Export],
        packages: impl IntoIterator<Item = String>,
    ) -> Self {
        Self {
            files: files.into_iter().collect(),
            exports: exports.to_vec(),
            packages: packages.into_iter().collect(),
            used: RefCell::default(),
        }
    }

    /// Messages that the types refer to: package, and name in Rust.
    #[must_use]
    pub fn used(&self) -> BTreeSet<(String, String)> {
        self.used.borrow().clone()
    }

    /// The declaration of a type.
    ///
    /// # Errors
    /// One line: what has no equivalent.
    pub fn declaration(&self, export: &Export) -> Result<String, String> {
        let declared = match self.item(export.file, export.rust) {
            Some(Item::Struct(item)) => self.interface(export, item),
            Some(Item::Enum(item)) => self.union(export, item),
            _ => Err("no struct or enum of that name".into()),
        };
        declared.map_err(|error| format!("{}: {}: {error}", export.file, export.rust))
    }

    /// True if a type is a struct with this tag.
    #[must_use]
    pub fn has_tag(&self, export: &Export, tag: &str) -> bool {
        match self.item(export.file, export.rust) {
            Some(Item::Struct(item)) => serde(&item.attrs).is_ok_and(|serde| serde.tag.as_deref() == Some(tag)),
            _ => false,
        }
    }

    fn item(&self, file: &str, name: &str) -> Option<&Item> {
        self.files.get(file)?.items.iter().find(|item| match item {
            Item::Struct(item) => item.ident == name,
            Item::Enum(item) => item.ident == name,
            Item::Type(item) => item.ident == name,
            _ => false,
        })
    }

    fn interface(&self, export: &Export, item: &ItemStruct) -> Result<String, String> {
        let serde = serde(&item.attrs)?;
        let Fields::Named(fields) = &item.fields else { return Err("fields without names".into()) };
        let (generics, list) = generics(&item.generics);
        let mut out = comment(&doc(&item.attrs), "");
        let _ = writeln!(out, "export interface {}{list} {{", export.page);
        if let Some(tag) = &serde.tag {
            let _ = writeln!(out, "  {tag}: {:?};", serde.rename.unwrap_or_else(|| item.ident.to_string()));
        }
        let scope = Scope { file: export.file, generics: &generics, reads: reads(&item.attrs)? };
        for (doc, field) in self.fields(&scope, &fields.named, serde.lowercase)? {
            let _ = writeln!(out, "{}  {field};", comment(&doc, "  "));
        }
        Ok(out + "}\n")
    }

    fn union(&self, export: &Export, item: &ItemEnum) -> Result<String, String> {
        let serde = serde(&item.attrs)?;
        let scope = Scope { file: export.file, generics: &[], reads: reads(&item.attrs)? };
        let mut out = comment(&doc(&item.attrs), "");
        let _ = write!(out, "export type {} =", export.page);
        for variant in &item.variants {
            let own = attributes::serde(&variant.attrs)?;
            let name = own.rename.unwrap_or_else(|| cased(&variant.ident.to_string(), serde.lowercase));
            let fields = match (&variant.fields, &serde.tag) {
                (Fields::Unit, None) => format!("{name:?}"),
                (Fields::Unit, Some(tag)) => object(&[(String::new(), format!("{tag}: {name:?}"))]),
                (Fields::Named(fields), Some(tag)) => {
                    let mut all = vec![(String::new(), format!("{tag}: {name:?}"))];
                    all.extend(self.fields(&scope, &fields.named, false)?);
                    object(&all)
                }
                _ => return Err(format!("variant {name}: this form of enum has no equivalent")),
            };
            let _ = write!(out, "\n{}  | {fields}", comment(&doc(&variant.attrs), "  "));
        }
        Ok(out + ";\n")
    }

    /// Comments and declarations of fields, those of flattened structs among them.
    fn fields(
        &self,
        scope: &Scope<'_>,
        fields: &Punctuated<Field, Token![,]>,
        lowercase: bool,
    ) -> Result<Vec<(String, String)>, String> {
        let mut all = Vec::new();
        for field in fields {
            let ident = field.ident.as_ref().map(ToString::to_string).unwrap_or_default();
            let ident = ident.trim_start_matches("r#");
            let here = |error: String| format!("{ident}: {error}");
            let serde = serde(&field.attrs).map_err(here)?;
            if serde.skip {
                continue;
            }
            if serde.flatten {
                all.extend(self.flattened(scope, &field.ty).map_err(here)?);
                continue;
            }
            // A missing field is not sent, or takes its default when it is read.
            let missing = serde.skip_none || scope.reads && serde.default;
            let inner = option(&field.ty).filter(|_| serde.skip_none || serde.there);
            let ty = match inner {
                _ if serde.text => "string".to_owned(),
                Some(inner) => self.ty(scope, inner).map_err(here)?,
                None => self.ty(scope, &field.ty).map_err(here)?,
            };
            let name = serde.rename.unwrap_or_else(|| cased(ident, lowercase));
            all.push((doc(&field.attrs), format!("{name}{}: {ty}", if missing { "?" } else { "" })));
        }
        Ok(all)
    }

    fn flattened(&self, scope: &Scope<'_>, ty: &Type) -> Result<Vec<(String, String)>, String> {
        let name = match through_references(ty) {
            Type::Path(path) => path.path.segments.last().map(|segment| segment.ident.to_string()).unwrap_or_default(),
            _ => String::new(),
        };
        match self.item(scope.file, &name) {
            Some(Item::Struct(ItemStruct { fields: Fields::Named(fields), attrs, .. })) => {
                self.fields(scope, &fields.named, serde(attrs)?.lowercase)
            }
            _ => Err(format!("{name}: no struct of the same file")),
        }
    }

    fn ty(&self, scope: &Scope<'_>, ty: &Type) -> Result<String, String> {
        match through_references(ty) {
            Type::Array(array) => {
                let element = self.ty(scope, &array.elem)?;
                match &array.len {
                    Expr::Lit(ExprLit { lit: Lit::Int(count), .. }) => {
                        let count: usize = count.base10_parse().map_err(|error| error.to_string())?;
                        Ok(format!("[{}]", vec![element; count].join(", ")))
                    }
                    _ => Ok(list_of(&element)),
                }
            }
            Type::Slice(slice) => Ok(list_of(&self.ty(scope, &slice.elem)?)),
            Type::Path(path) => {
                let segments: Vec<&PathSegment> = path.path.segments.iter().collect();
                match segments[..] {
                    [.., package, segment] => self.named(scope, &package.ident.to_string(), segment),
                    [segment] => self.named(scope, "", segment),
                    [] => Err("a type without a name".into()),
                }
            }
            _ => Err("this form of type has no equivalent".into()),
        }
    }

    fn named(&self, scope: &Scope<'_>, package: &str, segment: &PathSegment) -> Result<String, String> {
        let name = segment.ident.to_string();
        let types = arguments(segment);
        let arguments: Vec<String> = types.iter().map(|ty| self.ty(scope, ty)).collect::<Result<_, _>>()?;
        if let Some((_, page)) = GIVEN.iter().find(|(known, _)| *known == name) {
            return Ok((*page).to_owned());
        }
        if self.packages.contains(package) {
            self.used.borrow_mut().insert((package.to_owned(), name.clone()));
            return Ok(name);
        }
        Ok(match (name.as_str(), &arguments[..]) {
            ("bool", []) => "boolean".into(),
            ("i8" | "i16" | "i32" | "i64" | "isize" | "u8" | "u16" | "u32" | "u64" | "usize", []) => "number".into(),
            // serde_json writes what is not finite as null; what the server computes is finite, or an `Option`.
            ("f32" | "f64", []) => "number".into(),
            ("String" | "str" | "char", []) => "string".into(),
            ("Option", [inner]) => format!("{inner} | null"),
            ("Vec" | "VecDeque", [inner]) => list_of(inner),
            ("Box" | "Arc" | "Rc" | "Cow", [inner]) => inner.clone(),
            (name, []) if scope.generics.iter().any(|generic| generic == name) => name.into(),
            (name, arguments) => {
                let page = self.exported(scope, name)?;
                if arguments.is_empty() { page } else { format!("{page}<{}>", arguments.join(", ")) }
            }
        })
    }

    /// The page's name of a type, of the same file first.
    fn exported(&self, scope: &Scope<'_>, name: &str) -> Result<String, String> {
        if let Some(Item::Type(alias)) = self.item(scope.file, name) {
            return self.ty(scope, &alias.ty);
        }
        let of_name = || self.exports.iter().filter(|export| export.rust == name);
        let own = of_name().find(|export| export.file == scope.file);
        let is_own = self.item(scope.file, name).is_some();
        let mut others = of_name();
        match (own, others.next(), others.next()) {
            (Some(own), ..) => Ok(own.page.into()),
            (None, Some(only), None) if !is_own => Ok(only.page.into()),
            (None, Some(_), Some(_)) if !is_own => Err(format!("{name}: several types of the page have this name")),
            _ => Err(format!("{name}: is not among the types of the page (tools/generate/src/protocol.rs)")),
        }
    }
}

/// File and item that a type occurs in.
struct Scope<'a> {
    file: &'a str,
    generics: &'a [String],
    /// True if the server reads it; else it writes it.
    reads: bool,
}

fn list_of(element: &str) -> String {
    if element.contains(" | ") { format!("({element})[]") } else { format!("{element}[]") }
}

fn cased(name: &str, lowercase: bool) -> String {
    if lowercase { name.to_lowercase() } else { name.to_owned() }
}

/// An object on one line where it fits and has no comments.
fn object(fields: &[(String, String)]) -> String {
    let line = format!("{{ {} }}", fields.iter().map(|(_, field)| &field[..]).collect::<Vec<_>>().join("; "));
    if line.len() + 5 <= WIDTH && fields.iter().all(|(doc, _)| doc.is_empty()) {
        return line;
    }
    let fields = fields.iter().map(|(doc, field)| format!("{}      {field};\n", comment(doc, "      ")));
    format!("{{\n{}    }}", fields.collect::<String>())
}

fn through_references(ty: &Type) -> &Type {
    match ty {
        Type::Reference(reference) => through_references(&reference.elem),
        Type::Paren(inner) => through_references(&inner.elem),
        Type::Group(inner) => through_references(&inner.elem),
        other => other,
    }
}

fn arguments(segment: &PathSegment) -> Vec<&Type> {
    let PathArguments::AngleBracketed(list) = &segment.arguments else { return Vec::new() };
    let types = list.args.iter().filter_map(|argument| match argument {
        GenericArgument::Type(ty) => Some(ty),
        _ => None,
    });
    types.collect()
}

/// The type inside of an `Option`.
fn option(ty: &Type) -> Option<&Type> {
    let Type::Path(path) = ty else { return None };
    let segment = path.path.segments.last().filter(|segment| segment.ident == "Option")?;
    arguments(segment).first().copied()
}

/// Names of type parameters, and the list of them.
fn generics(generics: &Generics) -> (Vec<String>, String) {
    let names = generics.params.iter().filter_map(|parameter| match parameter {
        GenericParam::Type(parameter) => Some(parameter.ident.to_string()),
        _ => None,
    });
    let names: Vec<String> = names.collect();
    let list = if names.is_empty() { String::new() } else { format!("<{}>", names.join(", ")) };
    (names, list)
}

#[cfg(test)]
mod tests;
