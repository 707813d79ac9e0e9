//! Attributes of a type, a field or a variant.

use std::collections::BTreeSet;
use syn::punctuated::Punctuated;
use syn::{Attribute, LitStr, Token};

/// Attributes of serde's on a type, a field or a variant.
#[derive(Default)]
pub struct Serde {
    /// Name in JSON.
    pub rename: Option<String>,
    /// Names of the fields or variants in lower case.
    pub lowercase: bool,
    /// Name of the field that has the name of the type or variant.
    pub tag: Option<String>,
    /// Not written.
    pub skip: bool,
    /// Not written while it is `None`.
    pub skip_none: bool,
    /// The fields of a struct instead of the struct.
    pub flatten: bool,
    /// May be missing where it is read.
    pub default: bool,
    /// `serialize_with = "text"`: an `Arc<str>` as a string.
    pub text: bool,
    /// `deserialize_with = "there"`: absent, but never `null`.
    pub there: bool,
}

/// True if the server reads the type, false if it writes it.
///
/// # Errors
/// It does neither.
pub fn reads(attributes: &[Attribute]) -> Result<bool, String> {
    let mut derived = BTreeSet::new();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("derive")) {
        let paths = attribute.parse_args_with(Punctuated::<syn::Path, Token![,]>::parse_terminated);
        let paths = paths.map_err(|error| error.to_string())?;
        derived.extend(paths.iter().filter_map(|path| path.segments.last().map(|last| last.ident.to_string())));
    }
    match (derived.contains("Serialize"), derived.contains("Deserialize")) {
        (true, _) => Ok(false),
        (false, true) => Ok(true),
        (false, false) => Err("derives neither Serialize nor Deserialize".into()),
    }
}

/// Attributes of serde's.
///
/// # Errors
/// An attribute without an equivalent on the page.
pub fn serde(attributes: &[Attribute]) -> Result<Serde, String> {
    let mut serde = Serde::default();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("serde")) {
        let parsed = attribute.parse_nested_meta(|meta| {
            let name = meta.path.get_ident().map(ToString::to_string).unwrap_or_default();
            let value = match meta.input.peek(Token![=]) {
                true => Some(meta.value()?.parse::<LitStr>()?.value()),
                false => None,
            };
            match (name.as_str(), value.as_deref()) {
                ("rename", Some(name)) => serde.rename = Some(name.into()),
                ("rename_all", Some("lowercase")) => serde.lowercase = true,
                ("tag", Some(tag)) => serde.tag = Some(tag.into()),
                ("skip" | "skip_serializing", None) => serde.skip = true,
                ("skip_serializing_if", Some("Option::is_none")) => serde.skip_none = true,
                ("flatten", None) => serde.flatten = true,
                ("default", _) => serde.default = true,
                ("serialize_with", Some("text")) => serde.text = true,
                ("deserialize_with", Some("there")) => serde.there = true,
                ("deny_unknown_fields" | "borrow", None) => {}
                _ => return Err(meta.error(format!("serde({name}) has no equivalent"))),
            }
            Ok(())
        });
        parsed.map_err(|error| error.to_string())?;
    }
    Ok(serde)
}
