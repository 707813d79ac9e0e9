//! Comments of a definition as documentation.

use std::fmt::Write as _;

/// Writes a comment as plain text: links, tags and code tests of rustdoc are escaped.
pub fn emit_doc<'a>(out: &mut String, indent: &str, lines: impl IntoIterator<Item = &'a str>) {
    let mut fenced = false;
    for line in lines {
        // Rust does not allow a carriage return in a comment.
        let line = &line.replace('\r', " ");
        let fence = line.starts_with("```") || line.starts_with("~~~");
        let line = match () {
            () if fence && !fenced => format!("{}text", &line[..3]),
            () if fence || fenced => line.to_owned(),
            () => escape(line),
        };
        fenced ^= fence;
        let space = if line.is_empty() { "" } else { " " };
        let _ = writeln!(out, "{indent}///{space}{line}");
    }
}

fn escape(line: &str) -> String {
    let mut code = false;
    let mut out = String::new();
    for c in line.chars() {
        code ^= c == '`';
        if !code && matches!(c, '[' | ']' | '<' | '\\') {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

/// Writes the comment of the definition, or the declaration itself without one.
pub fn emit_doc_or(out: &mut String, indent: &str, doc: &[String], declaration: &str) {
    if doc.is_empty() {
        emit_doc(out, indent, [format!("`{declaration}`").as_str()]);
    } else {
        emit_doc(out, indent, doc.iter().map(String::as_str));
    }
}
