//! Bodies of `encode_body` and `decode_body`: one statement per member, in order of declaration.

use std::fmt::Write as _;

use super::names::{Scope, borrows, camel_case, field, free, has_upper_case, is_fixed_row, is_implicit, primitive};
use crate::{Definition, Dim, Member, MemberType, Primitive, Schema, Size};

/// Both bodies, and the names of their parameters.
pub struct Body {
    pub writer: String,
    pub reader: String,
    pub size: String,
    pub encode: String,
    pub decode: String,
}

impl Body {
    /// Bodies of a type that is `Fixed`.
    pub fn whole() -> Self {
        Self {
            writer: "w".to_owned(),
            reader: "r".to_owned(),
            // Fully qualified: a type may have a constant of that name.
            size: "        <Self as codec::Type>::MIN_SIZE\n".to_owned(),
            encode: "        w.put(self);\n".to_owned(),
            decode: "        r.get()\n".to_owned(),
        }
    }

    /// Bodies of any other struct.
    pub fn of(schema: &Schema, definition: &Definition) -> Self {
        let members = definition.members();
        let emitter = Emitter {
            schema,
            members,
            writer: free(&["w", "writer"], members),
            reader: free(&["r", "reader"], members),
            item: free(&["item", "element"], members),
            view: false,
        };
        let (size, encode, decode) = (emitter.size(), emitter.encode(), emitter.decode());
        Self { writer: emitter.writer, reader: emitter.reader, size, encode, decode }
    }
}

/// Minimum size of a member without a variable dimension, or of one element otherwise, bytes.
pub fn min_size(schema: &Schema, member: &Member) -> usize {
    let fixed = member.dims.iter().filter_map(|dim| match dim.size {
        Size::Fixed(n) => Some(n),
        Size::Variable => None,
    });
    fixed.product::<usize>() * element_min(schema, member)
}

fn element_min(schema: &Schema, member: &Member) -> usize {
    match &member.ty {
        MemberType::Primitive(ty) => ty.min_size(),
        MemberType::Named(name) => schema.min_size(name).unwrap_or_default(),
    }
}

/// Body of a view's `decode_body`, and the name of its parameter.
pub fn view(schema: &Schema, definition: &Definition) -> (String, String) {
    let members = definition.members();
    let reader = free(&["r", "reader"], members);
    let emitter =
        Emitter { schema, members, writer: String::new(), reader: reader.clone(), item: String::new(), view: true };
    (reader, emitter.decode())
}

struct Emitter<'a> {
    schema: &'a Schema,
    members: &'a [Member],
    writer: String,
    reader: String,
    item: String,
    /// True if decoded values borrow from the message where possible.
    view: bool,
}

impl Emitter<'_> {
    fn is_recursive(&self, member: &Member) -> bool {
        matches!(&member.ty, MemberType::Named(name) if self.schema.is_recursive(name))
    }

    /// True if the member is a length that is also a field.
    fn is_explicit(&self, member: &Member) -> bool {
        let used = |dim: &Dim| dim.size == Size::Variable && dim.text == member.name;
        !is_implicit(member, self.members) && self.members.iter().any(|other| other.dims.iter().any(used))
    }

    /// Local variable with the value of a length member as `usize`.
    fn length(&self, name: &str) -> String {
        let explicit = self.members.iter().any(|member| member.name == name && self.is_explicit(member));
        if explicit { free(&[&format!("{name}_len"), &format!("{name}_length")], self.members) } else { field(name) }
    }

    /// Sum of the constant sizes, plus a term for each member of variable size.
    fn size(&self) -> String {
        let (mut fixed, mut terms) = (0, Vec::new());
        for member in self.members {
            let place = format!("self.{}", field(&member.name));
            match &member.ty {
                _ if is_implicit(member, self.members) || is_fixed_row(self.schema, member, &member.dims) => {
                    fixed += min_size(self.schema, member);
                }
                MemberType::Primitive(_) if member.dims.is_empty() => {
                    fixed += min_size(self.schema, member);
                    terms.push(format!("{place}.len()"));
                }
                _ => terms.extend(self.size_of(member, &place)),
            }
        }
        if fixed > 0 || terms.is_empty() {
            terms.insert(0, fixed.to_string());
        }
        let separator =
            if terms.iter().map(|term| term.len() + 3).sum::<usize>() > 100 { "\n            + " } else { " + " };
        format!("        {}\n", terms.join(separator))
    }

    /// Size of an array, or of a struct, of variable size; `None` if it is always zero.
    fn size_of(&self, member: &Member, place: &str) -> Option<String> {
        let dims = &member.dims;
        let depth =
            (0..dims.len()).find(|&depth| is_fixed_row(self.schema, member, &dims[depth + 1..])).unwrap_or(dims.len());
        let (row, item) = (Member { dims: dims[depth..].to_vec(), ..member.clone() }, &self.item);
        let each = match (&member.ty, min_size(self.schema, &row)) {
            _ if depth == 0 && dims.is_empty() => return Some(format!("{place}.body_size()")),
            (MemberType::Named(_), _) if depth == dims.len() => "codec::Type::body_size".to_owned(),
            (_, _) if depth == dims.len() => format!("|{item}| 5 + {item}.len()"),
            (_, 0) => return None,
            (_, 1) if depth == 0 => return Some(format!("{place}.len()")),
            (_, size) if depth == 0 => return Some(format!("{size} * {place}.len()")),
            (_, 1) => "codec::Vec::len".to_owned(),
            (_, size) => format!("|{item}| {size} * {item}.len()"),
        };
        Some(format!("{place}.iter(){}.map({each}).sum::<usize>()", ".flatten()".repeat(depth.saturating_sub(1))))
    }

    fn encode(&self) -> String {
        let (mut lengths, mut out, w) = (String::new(), String::new(), &self.writer);
        for member in self.members {
            let (name, place) = (&member.name, format!("self.{}", field(&member.name)));
            if is_implicit(member, self.members) {
                let lends = |dim: &Dim| dim.size == Size::Variable && dim.text == *name;
                let lender = self.members.iter().find(|other| other.dims.first().is_some_and(lends));
                let lender = lender.map_or_else(String::new, |lender| field(&lender.name));
                let MemberType::Primitive(ty) = member.ty else {
                    continue;
                };
                let _ = writeln!(lengths, "        let {} = self.{lender}.len();", self.length(name));
                let ty = primitive(ty);
                let _ = writeln!(out, "        {w}.count::<{ty}>(\"{name}\", {})?;", self.length(name));
                continue;
            }
            if self.is_explicit(member) {
                let length = self.length(name);
                let _ = writeln!(lengths, "        let {length} = {w}.length(\"{name}\", {place})?;");
            }
            self.encode_array(&mut out, member, &member.dims, &place, "        ");
        }
        lengths + &out
    }

    /// `place` is the variable or field; a loop variable is already a reference.
    fn encode_array(&self, out: &mut String, member: &Member, dims: &[Dim], place: &str, indent: &str) {
        let (w, name) = (&self.writer, &member.name);
        let reference = if place.starts_with("self.") { format!("&{place}") } else { place.to_owned() };
        let is_lender = dims.len() == member.dims.len()
            && self
                .members
                .iter()
                .find(|other| {
                    other.dims.first().is_some_and(|dim| dims.first() == Some(dim) && dim.size == Size::Variable)
                })
                .is_some_and(|first| first.name == *name);
        if let Some(dim) = dims.first().filter(|dim| dim.size == Size::Variable && !is_lender) {
            let length = self.length(&dim.text);
            let _ = writeln!(out, "{indent}{w}.check(\"{name}\", {length}, {place}.len())?;");
        }
        match dims {
            _ if is_fixed_row(self.schema, member, dims) => {
                let _ = writeln!(out, "{indent}{w}.put({reference});");
            }
            [_, inner @ ..] if is_fixed_row(self.schema, member, inner) => {
                let _ = writeln!(out, "{indent}{w}.put_all({reference});");
            }
            [_, inner @ ..] => {
                let item = &self.item;
                let _ = writeln!(out, "{indent}for {item} in {reference} {{");
                self.encode_array(out, member, inner, item, &format!("{indent}    "));
                let _ = writeln!(out, "{indent}}}");
            }
            [] if matches!(member.ty, MemberType::Primitive(_)) => {
                let _ = writeln!(out, "{indent}{w}.string(\"{name}\", {reference})?;");
            }
            [] if self.is_recursive(member) => {
                let _ = writeln!(out, "{indent}{w}.nested(|{w}| {place}.encode_body({w}))?;");
            }
            [] => {
                let _ = writeln!(out, "{indent}{place}.encode_body({w})?;");
            }
        }
    }

    fn decode(&self) -> String {
        let r = &self.reader;
        let has_lengths = self.members.iter().any(Member::is_variable);
        let value = |member: &Member| self.call(&self.decode_array(member, &member.dims));
        if !has_lengths {
            let fields: String = self
                .members
                .iter()
                .map(|member| format!("            {}: {}?,\n", field(&member.name), value(member)))
                .collect();
            return format!("        Ok(Self {{\n{fields}        }})\n");
        }
        let (mut out, mut fields) = (String::new(), Vec::new());
        for member in self.members {
            let name = field(&member.name);
            if is_implicit(member, self.members) {
                let MemberType::Primitive(ty) = member.ty else {
                    continue;
                };
                let _ = writeln!(out, "        let {name} = {r}.count::<{}>()?;", primitive(ty));
                continue;
            }
            if self.is_explicit(member) {
                let MemberType::Primitive(ty) = member.ty else {
                    continue;
                };
                let _ = writeln!(out, "        let {name} = {r}.get::<{}>()?;", primitive(ty));
                let _ = writeln!(out, "        let {} = {r}.length({name})?;", self.length(&member.name));
            } else {
                let _ = writeln!(out, "        let {name} = {}?;", value(member));
            }
            fields.push(name);
        }
        let line = format!("        Ok(Self {{ {} }})\n", fields.join(", "));
        if line.len() <= 100 {
            return out + &line;
        }
        out + "        Ok(Self {\n            " + &fields.join(",\n            ") + ",\n        })\n"
    }

    /// Applies the result of [`Self::decode_array`] to the reader.
    fn call(&self, function: &Function) -> String {
        let r = &self.reader;
        match function {
            Function::Method(call) => format!("{r}.{call}"),
            Function::Path(path) => format!("{path}({r})"),
        }
    }

    fn decode_array(&self, member: &Member, dims: &[Dim]) -> Function {
        let r = &self.reader;
        let bytes = self.view && member.ty == MemberType::Primitive(Primitive::Byte);
        match (dims, &member.ty) {
            ([Dim { size: Size::Fixed(_), .. }], _) if bytes => Function::Method("block()".to_owned()),
            (dims, _) if is_fixed_row(self.schema, member, dims) => Function::Method("get()".to_owned()),
            ([Dim { text, .. }, inner @ ..], _) if is_fixed_row(self.schema, member, inner) => {
                let method = match self.view {
                    true if bytes && inner.is_empty() => "bytes",
                    true => "elements",
                    false => "get_vec",
                };
                Function::Method(format!("{method}({})", self.length(text)))
            }
            ([dim, inner @ ..], _) => {
                let element = match self.decode_array(member, inner) {
                    Function::Path(path) => path,
                    Function::Method(call) => match call.strip_suffix("()") {
                        Some(method @ ("str" | "string")) => format!("codec::Reader::{method}"),
                        _ => format!("|{r}| {r}.{call}"),
                    },
                };
                Function::Method(match dim.size {
                    Size::Fixed(_) => format!("array({element})"),
                    Size::Variable => {
                        format!("vec({}, {}, {element})", self.length(&dim.text), self.row_min(member, inner))
                    }
                })
            }
            ([], MemberType::Primitive(_)) => Function::Method(if self.view { "str()" } else { "string()" }.to_owned()),
            ([], MemberType::Named(name)) => {
                let kind = if self.view && borrows(self.schema, name) { "View" } else { "Type" };
                let path = format!("codec::{kind}::decode_body");
                if self.is_recursive(member) {
                    Function::Method(format!("nested({path})"))
                } else {
                    Function::Path(path)
                }
            }
        }
    }

    /// Expression for the minimum size of an element that is itself an array, bytes.
    fn row_min(&self, member: &Member, dims: &[Dim]) -> String {
        let row = Member { dims: dims.to_vec(), ..member.clone() };
        let mut min = min_size(self.schema, &row).to_string();
        for dim in dims.iter().filter(|dim| dim.size == Size::Variable) {
            let length = self.length(&dim.text);
            min = if min == "1" { length } else { format!("{length}.saturating_mul({min})") };
        }
        min
    }
}

/// Call that reads a value.
enum Function {
    /// `reader.call`
    Method(String),
    /// `path(reader)`
    Path(String),
}

/// Writes the codec of a type.
pub fn emit_type(out: &mut String, schema: &Schema, scope: &Scope, definition: &Definition, body: &Body) {
    let (name, lcm_name) = (camel_case(&definition.short), definition.name());
    let fingerprint = schema.fingerprint(&lcm_name).unwrap_or_default();
    let allow = if has_upper_case(definition.members()) { "#[allow(non_snake_case)]\n" } else { "" };
    let min_size = schema.min_size(&lcm_name).unwrap_or_default();
    let result = scope.known("Result", "::core::result::Result");
    let Body { writer, reader, size, encode, decode } = body;
    let _ = write!(
        out,
        "
{allow}impl codec::Type for {name} {{
    const FINGERPRINT: u64 = 0x{fingerprint:016x};
    const NAME: &'static str = \"{lcm_name}\";
    const MIN_SIZE: usize = {min_size};

    fn body_size(&self) -> usize {{
{size}    }}

    fn encode_body(&self, {writer}: &mut codec::Writer<'_>) -> {result}<(), codec::EncodeError> {{
{encode}        Ok(())
    }}

    fn decode_body({reader}: &mut codec::Reader<'_>) -> {result}<Self, codec::DecodeError> {{
{decode}    }}
}}
"
    );
}
