//! Comments of a definition as documentation.

use std::fmt::Write as _;

/// Comments are plain text: what rustdoc would take for a link, a tag or a test of the code is kept from being one.
pub fn emit_doc<'a>(out: &mut String, indent: &str, lines: impl IntoIterator<Item = &'a str>) {
    let mut fenced = false;
    for line in lines {
        // Rust takes no carriage return in a comment.
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

/// The comment of the definition, or else the declaration itself.
pub fn emit_doc_or(out: &mut String, indent: &str, doc: &[String], declaration: &str) {
    if doc.is_empty() {
        emit_doc(out, indent, [format!("`{declaration}`").as_str()]);
    } else {
        emit_doc(out, indent, doc.iter().map(String::as_str));
    }
}
