//! ROS 2 names and definitions of the types of a [`Schema`]: `ros2msg` texts, as contained in logs.
//!
//! A message converted by [`cdr`](crate::cdr) has the type of the same name here.
//!
//! | LCM | ROS 2 |
//! |---|---|
//! | `lowlevel.data_odo_t` | `lowlevel/msg/DataOdo` |
//! | `a.b.c_t`, `c_t` without package, `x_msgs.c_t` | `a_b/msg/C`, `lcm/msg/C`, `lcm_x_msgs/msg/C` (the name is ROS's own) |
//! | `int8_t` .. `int64_t`, `byte`, `boolean` | `int8` .. `int64`, `uint8`, `bool` |
//! | `float`, `double`, `string` | `float32`, `float64`, `string` |
//! | `T x[2][3]`, `T x[n]`, `T x[n][3]` | `T[6] x`, `T[] x`, `T[] x`, row by row |
//! | length members | ordinary fields |
//! | `const`, values of an enum | constants |
//! | enum | a message with the only field `int32 value` |
//! | struct without members | a message with ROS 2's placeholder `uint8 structure_needs_at_least_one_member` |
//!
//! ROS 2 requires names of fields in lower case and of constants in upper case, without consecutive, leading or
//! trailing underscores: names are converted, and a number is appended to duplicates. ROS 2 has no recursive types.
//!
//! ```
//! let files = [("scan.lcm", "package demo; struct scan_t { int32_t n; point_t at[n]; } struct point_t { double x; }")];
//! let types = lcm_gen::ros2::Types::new(&lcm_gen::Schema::new(&files).unwrap());
//! let scan = types.get("demo.scan_t").unwrap();
//! assert_eq!(scan.name(), "demo/msg/Scan");
//! let rule = "=".repeat(80);
//! assert_eq!(scan.text(), format!("int32 n\ndemo/Point[] at\n{rule}\nMSG: demo/Point\nfloat64 x\n"));
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use crate::rust::words;
use crate::{Definition, Kind, Literal, Member, MemberType, Primitive, Schema};

/// Types of a schema.
#[derive(Clone, Debug, Default)]
pub struct Types {
    entries: Vec<Entry>,
    index: BTreeMap<String, usize>,
}

#[derive(Clone, Debug)]
struct Entry {
    package: String,
    short: String,
    /// Own constants and fields.
    text: String,
    /// Types contained in its fields, in order of the schema; `None` for a recursive type.
    needs: Option<Vec<usize>>,
}

/// Type of [`Types`].
#[derive(Clone, Copy, Debug)]
pub struct Type<'a> {
    types: &'a Types,
    entry: &'a Entry,
}

impl Types {
    /// All types of the schema.
    #[must_use]
    pub fn new(schema: &Schema) -> Self {
        Self::named(schema, |definition| package(&definition.package))
    }

    /// All types of the schema in one package of ROS, whatever their packages in LCM.
    #[must_use]
    pub fn in_package(schema: &Schema, package: &str) -> Self {
        Self::named(schema, |_| package.to_owned())
    }

    fn named(schema: &Schema, package: impl Fn(&Definition) -> String) -> Self {
        let mut types = Self::default();
        let mut taken = BTreeSet::new();
        for (i, definition) in schema.definitions().iter().enumerate() {
            let (package, short) = (package(definition), words(&definition.short));
            let short = unique(short, "", |name| taken.insert((package.clone(), name.to_owned())));
            types.entries.push(Entry { package, short, text: String::new(), needs: None });
            types.index.insert(definition.name(), i);
        }
        for (i, definition) in schema.definitions().iter().enumerate() {
            types.entries[i].text = types.own_text(definition);
            let name = definition.name();
            let parts = || schema.parts(&name).map(Definition::name);
            if !parts().any(|part| schema.is_recursive(&part)) {
                types.entries[i].needs = Some(
                    parts().filter_map(|part| types.index.get(&part).copied()).filter(|&part| part != i).collect(),
                );
            }
        }
        types
    }

    /// Type by its LCM name with package: `lowlevel.data_odo_t`. `None` also for a recursive type.
    #[must_use]
    pub fn get(&self, lcm_name: &str) -> Option<Type<'_>> {
        let entry = &self.entries[*self.index.get(lcm_name)?];
        entry.needs.is_some().then_some(Type { types: self, entry })
    }

    fn own_text(&self, definition: &Definition) -> String {
        let mut text = String::new();
        let (mut constants, mut fields) = (BTreeSet::new(), BTreeSet::new());
        let mut constant = |name: &str| unique(constant(name), "_", |name| constants.insert(name.to_owned()));
        match &definition.kind {
            Kind::Enum { values } => {
                for value in values {
                    let _ = writeln!(text, "int32 {}={}", constant(&value.name), value.number);
                }
                text.push_str("int32 value\n");
            }
            Kind::Struct { constants: of, members } => {
                for known in of {
                    let _ = match known.literal {
                        Literal::Int(value) => {
                            writeln!(text, "{} {}={value}", primitive(known.ty), constant(&known.name))
                        }
                        Literal::Float(value) => {
                            writeln!(text, "{} {}={value:?}", primitive(known.ty), constant(&known.name))
                        }
                    };
                }
                for member in members {
                    let name = unique(snake(&member.name, "x"), "_", |name| fields.insert(name.to_owned()));
                    let _ = writeln!(text, "{}{} {name}", self.element(member), array(member));
                }
                if members.is_empty() {
                    text.push_str("uint8 structure_needs_at_least_one_member\n");
                }
            }
        }
        text
    }

    fn element(&self, member: &Member) -> String {
        match &member.ty {
            MemberType::Primitive(ty) => primitive(*ty).to_owned(),
            // The schema has resolved every name.
            MemberType::Named(name) => self.index.get(name).map_or_else(String::new, |&i| self.entries[i].path()),
        }
    }
}

impl Entry {
    fn path(&self) -> String {
        format!("{}/{}", self.package, self.short)
    }
}

impl Type<'_> {
    /// Name as in schemas: `lowlevel/msg/DataOdo`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}/msg/{}", self.entry.package, self.entry.short)
    }

    /// Constants and fields: the content of its `.msg` file.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.entry.text
    }

    /// Types that its fields contain, directly or not.
    pub fn parts(&self) -> impl Iterator<Item = Type<'_>> {
        let types = self.types;
        self.entry.needs.iter().flatten().map(move |part| Type { types, entry: &types.entries[*part] })
    }

    /// `ros2msg` text: constants and fields, then those of each contained type, after a line of `=` and one with its
    /// name.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.entry.text.clone();
        for &part in self.entry.needs.iter().flatten() {
            let part = &self.types.entries[part];
            let _ = write!(text, "{}\nMSG: {}\n{}", "=".repeat(80), part.path(), part.text);
        }
        text
    }
}

fn primitive(ty: Primitive) -> &'static str {
    match ty {
        Primitive::Int8 => "int8",
        Primitive::Int16 => "int16",
        Primitive::Int32 => "int32",
        Primitive::Int64 => "int64",
        Primitive::Byte => "uint8",
        Primitive::Float => "float32",
        Primitive::Double => "float64",
        Primitive::String => "string",
        Primitive::Boolean => "bool",
    }
}

fn array(member: &Member) -> String {
    if member.dims.is_empty() {
        return String::new();
    }
    member.fixed_count().map_or_else(|| "[]".to_owned(), |count| format!("[{count}]"))
}

/// `a.b` as `a_b`. ROS's own message packages are named `something_msgs` and `something_interfaces`.
fn package(package: &str) -> String {
    let name = if package.is_empty() { "lcm".to_owned() } else { snake(&package.replace('.', "_"), "p") };
    let of_ros = name.ends_with("_msgs") || name.ends_with("_interfaces");
    if of_ros { format!("lcm_{name}") } else { name }
}

fn snake(name: &str, front: &str) -> String {
    let words: Vec<&str> = name.split('_').filter(|word| !word.is_empty()).collect();
    let name = words.join("_").to_ascii_lowercase();
    if name.starts_with(|first: char| first.is_ascii_lowercase()) { name } else { format!("{front}{name}") }
}

fn constant(name: &str) -> String {
    snake(name, "x").to_ascii_uppercase()
}

/// Name, with a number appended if necessary to make it unique.
fn unique(name: String, join: &str, mut insert: impl FnMut(&str) -> bool) -> String {
    if insert(&name) {
        return name;
    }
    let mut numbered = (2..).map(|number| format!("{name}{join}{number}"));
    numbered.find(|name| insert(name)).unwrap_or(name)
}
