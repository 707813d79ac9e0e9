//! Small inputs of Rust, and their declarations on the page.

use super::*;

/// Declaration of the first type of a text; all its types are exported under their names, `One` as `Another`.
fn page(text: &'static str) -> Result<String, String> {
    let parsed = syn::parse_file(text).unwrap();
    let mut exports = Vec::new();
    for item in &parsed.items {
        let name: &'static str = match item {
            Item::Struct(item) => item.ident.to_string().leak(),
            Item::Enum(item) => item.ident.to_string().leak(),
            _ => continue,
        };
        exports.push(Export { file: "a.rs", rust: name, page: if name == "One" { "Another" } else { name } });
    }
    let library = Library::new([("a.rs", parsed)], &exports, ["lowlevel".to_owned()]);
    library.declaration(&exports[0])
}

#[test]
fn each_rust_type_has_its_equivalent() {
    for (rust, expected) in [
        ("bool", "boolean"),
        ("u64", "number"),
        ("f64", "number"),
        ("&'a str", "string"),
        ("Arc<str>", "string"),
        ("Cow<'a, str>", "string"),
        ("Option<f64>", "number | null"),
        ("Vec<String>", "string[]"),
        ("Vec<Option<i32>>", "(number | null)[]"),
        ("Vec<[f64; 2]>", "[number, number][]"),
        ("[u8; LENGTH]", "number[]"),
        ("&'a [One]", "Another[]"),
        ("Id", "number"),
        ("lowlevel::DataMotion", "DataMotion"),
        ("Vec<&'a lowlevel::DataMotion>", "DataMotion[]"),
        ("Shown<'a, lowlevel::DataMotion>", "Shown<DataMotion>"),
        ("Option<&'a Message>", "Record<string, unknown> | null"),
        ("T", "T"),
    ] {
        let text = format!(
            "#[derive(Serialize)] struct S<'a, T> {{ f: {rust} }} struct One {{}} struct Shown<'a, T> {{}} \
             type Id = u32;"
        );
        assert_eq!(page(text.leak()).unwrap(), format!("export interface S<T> {{\n  f: {expected};\n}}\n"), "{rust}");
    }
}

#[test]
fn structs_keep_names_comments_and_tag() {
    let text = r#"
        /// A part.
        #[derive(Debug, Serialize)]
        #[serde(tag = "part", rename = "drive")]
        pub struct Part<'a> {
            /// Speed, m/s.
            pub speed: f64,
            #[serde(rename = "busses")]
            buses: Vec<&'a str>,
            r#type: String,
            #[serde(skip)]
            seen: Instant,
            #[serde(skip_serializing_if = "Option::is_none")]
            error: Option<String>,
            #[serde(serialize_with = "text")]
            name: Arc<str>,
            #[serde(flatten)]
            more: &'a More,
        }
        #[derive(Serialize)]
        struct More {
            /// More.
            more: bool,
        }"#;
    let expected = r#"/** A part. */
export interface Part {
  part: "drive";
  /** Speed, m/s. */
  speed: number;
  busses: string[];
  type: string;
  error?: string;
  name: string;
  /** More. */
  more: boolean;
}
"#;
    assert_eq!(page(text).unwrap(), expected);
}

#[test]
fn what_is_read_may_be_missing_where_it_has_a_default() {
    let text = r#"
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Place {
            x: f64,
            #[serde(default)]
            text: String,
            #[serde(default, deserialize_with = "there")]
            theta: Option<f64>,
            from: Option<u32>,
        }"#;
    let expected =
        "export interface Place {\n  x: number;\n  text?: string;\n  theta?: number;\n  from: number | null;\n}\n";
    assert_eq!(page(text).unwrap(), expected);
}

#[test]
fn enums_are_words_or_tagged_objects() {
    let words = r#"
        #[derive(Serialize)]
        #[serde(rename_all = "lowercase")]
        enum Role { Nobody, #[serde(rename = "x")] Viewer }"#;
    assert_eq!(page(words).unwrap(), "export type Role =\n  | \"nobody\"\n  | \"x\";\n");
    let tagged = r#"
        #[derive(Deserialize)]
        #[serde(tag = "type", rename_all = "lowercase")]
        enum Command {
            /// Zero.
            Zero { hold: u64, r#loop: bool },
            Stop,
        }"#;
    let expected = "export type Command =\n  /** Zero. */\n  | { type: \"zero\"; hold: number; loop: boolean }\n  \
                    | { type: \"stop\" };\n";
    assert_eq!(page(tagged).unwrap(), expected);
}

#[test]
fn what_has_no_equivalent_is_an_error() {
    for (text, why) in [
        ("struct S { f: u8 }", "derives neither"),
        ("#[derive(Serialize)] struct S { f: Unknown }", "is not among"),
        ("#[derive(Serialize)] struct S { f: fn() }", "form of type"),
        ("#[derive(Serialize)] struct S(u8);", "without names"),
        ("#[derive(Serialize)] #[serde(rename_all = \"camelCase\")] struct S { f: u8 }", "rename_all"),
        ("#[derive(Serialize)] struct S { #[serde(with = \"x\")] f: u8 }", "serde(with)"),
        ("#[derive(Serialize)] #[serde(untagged)] enum E { A { a: u8 } }", "untagged"),
        ("#[derive(Serialize)] enum E { A(u8) }", "form of enum"),
        ("#[derive(Serialize)] struct S { #[serde(flatten)] f: u8 }", "no struct"),
    ] {
        let error = page(text).unwrap_err();
        assert!(error.contains(why), "{text}: {error}");
    }
}
