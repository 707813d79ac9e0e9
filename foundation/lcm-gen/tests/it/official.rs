//! Type language compared with the official lcm-gen of LCM 1.5.3 (`lcm-gen -d`): accepted and rejected texts, and the
//! base hashes of accepted ones. Needs the Python package `lcm` (`make test` installs it; `ADVEE_PYTHON` names a Python
//! that has it).
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "the tests run a program")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lcm_gen::{Kind, Schema};

/// Base hashes by name; enums have no hash there. `None`: rejected.
type Understood = Option<BTreeMap<String, Option<u64>>>;

fn official() -> Option<PathBuf> {
    let python = testing::peer_or_skip(testing::python(&["lcm"]))?;
    let found = Command::new(python).args(["-c", "import lcm; print(lcm.__path__[0])"]).output().unwrap();
    Some(Path::new(String::from_utf8(found.stdout).unwrap().trim()).join("../bin/lcm-gen"))
}

fn theirs(program: &Path, name: &str, text: &str) -> Understood {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("official_{name}.lcm"));
    fs::write(&file, text).unwrap();
    let output = Command::new(program).arg("-d").arg(&file).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let hash = |hex: &str| u64::from_str_radix(hex.trim_matches([' ', ']']), 16).unwrap(); // padded with spaces
    output.status.success().then(|| {
        let described = |line: &str| {
            if let Some((name, hex)) = line.strip_prefix("struct ").and_then(|rest| rest.split_once(" [hash=0x")) {
                return Some((name.to_owned(), Some(hash(hex))));
            }
            line.strip_prefix("enum ").map(|name| (name.to_owned(), None))
        };
        text.lines().filter_map(described).collect()
    })
}

fn ours(text: &str) -> Understood {
    let schema = Schema::new(&[("a.lcm", text)]).ok()?;
    let hash = |definition: &lcm_gen::Definition| {
        let name = definition.name();
        let hash = matches!(definition.kind, Kind::Struct { .. }).then(|| schema.base_hash(&name).unwrap());
        (name, hash)
    };
    Some(schema.definitions().iter().map(hash).collect())
}

/// Ends every text like a file; the official tokenizer needs it.
fn file(text: &str) -> String {
    format!("{text}\n")
}

/// Cases in order of the grammar: packages, structs, members, dimensions, constants, enums, comments, names.
const ALIKE: &[&str] = &[
    "package p ; struct x_t { }",
    "package a.b.c ; struct x_t { int32_t a; }",
    "struct x_t { } package p ; struct y_t { x_t a; } struct x_t { } package q.r ; struct z_t { p.y_t a; }",
    "package p",
    "package ; struct x_t { }",
    "struct x_t { int32_t a; } ;",
    "enum e_t { A } ;",
    "int32_t x;",
    "struct x_t { int8_t a; int16_t b; int32_t c; int64_t d; byte e; float f; double g; string h; boolean i; }",
    "struct x_t { double x, y[3], z[2][3]; }",
    "struct x_t { int32_t a;}",
    "struct x_t { int32_t a, a; }",
    "struct x_t { const int8_t a = 1; int32_t a; }",
    "struct x_t { int32_t a }",
    "struct x_t { int32_t ; }",
    "struct x_t { int32_t 1a; }",
    "struct x_t { int32_t _a; }",
    "struct x_t { struct y_t { int32_t a; } y; }",
    "struct x_t { enum y_t { A } y; }",
    "struct x_t { } struct x_t { }",
    "struct x_t { x_t a; int32_t b",
    // dimensions
    "struct x_t { int32_t a[]; }",
    "struct x_t { int32_t a[0]; }",
    "struct x_t { int32_t a[-1]; }",
    "struct x_t { int32_t a[3; }",
    "struct x_t { int32_t a[0x3]; }",
    "struct x_t { int32_t a[03]; }",
    "struct x_t { int32_t a[3][0x3][03]; }",
    "struct x_t { const int32_t N = 3; int32_t a[N]; }",
    "struct x_t { const int32_t N = 0x3, M = 03; int32_t a[N][M]; }",
    "struct x_t { int32_t a[N]; const int32_t N = 3; }",
    "struct x_t { const float N = 3; int32_t a[N]; }",
    "struct x_t { const double N = 3.0; int32_t a[N]; }",
    "struct x_t { int8_t n; int32_t a[n]; }",
    "struct x_t { int16_t n; int32_t m; int64_t k; string a[n][2][m][k]; }",
    "struct x_t { byte n; int32_t a[n]; }",
    "struct x_t { boolean n; int32_t a[n]; }",
    "struct x_t { double n; int32_t a[n]; }",
    "struct x_t { int8_t n[2]; int32_t a[n]; }",
    "struct x_t { int32_t a[n]; int8_t n; }",
    "struct x_t { int32_t a[n]; }",
    // nested and recursive
    "package p ; struct y_t { int32_t a; } struct x_t { y_t a; p.y_t b[2]; y_t c; }",
    "struct x_t { int8_t n; x_t a[n]; }",
    "package p ; struct x_t { int8_t n; y_t a[n]; } struct y_t { int8_t n; p.x_t a[n][2]; }",
    // constants
    "struct x_t { const int8_t A = -128, B = 127; const int16_t C = -32768, D = 32767; }",
    "struct x_t { const int32_t A = -2147483648, B = 2147483647; const int64_t C = 9223372036854775807; }",
    "struct x_t { const int8_t A = 128; }",
    "struct x_t { const int8_t A = -129; }",
    "struct x_t { const int16_t A = 32768; }",
    "struct x_t { const int32_t A = 2147483648; }",
    "struct x_t { const int8_t A = 0x7f, B = 0177; }",
    "struct x_t { const float A = 3.14159, B = -1.5e-3, C = .5, D = 1e10, E = 2; }",
    "struct x_t { const double A = 2.718281828459045, B = -1e300; }",
    "struct x_t { const float A = 1e39; }",
    "struct x_t { const float A = -1e39; }",
    "struct x_t { const byte A = 1; }",
    "struct x_t { const boolean A = 1; }",
    "struct x_t { const string A = a; }",
    "struct x_t { const int8_t A; }",
    "struct x_t { const int8_t A = ; }",
    "struct x_t { const int8_t A = 1, A = 2; }",
    "struct x_t { const int8_t A = x; }",
    "struct x_t { const int8_t A = 1 }",
    // enums
    "enum e_t { A, B, C }",
    "enum e_t { A = 3, B, C = -2, D }",
    "enum e_t { A ; B C, D }",
    "enum e_t { A, A }",
    "enum e_t { A = 3, B = 3 }",
    "enum e_t { A, B = 1 }",
    "enum e_t { A, B = 2, C }",
    "enum e_t { A = -1, B = -1 }",
    "package p ; enum e_t { A } struct x_t { e_t a; }",
    // comments
    "// c\n/* c */ struct x_t /* c */ { // c\n /* c\n * c */ int32_t /* c */ a /* c */ ; /* c */ } // c",
    "struct x_t { int32_t a; /* ; } */ }",
];

#[test]
fn the_official_tool_accepts_and_rejects_the_same_texts() {
    let Some(program) = official() else { return };
    for text in ALIKE.iter().copied().map(file) {
        assert_eq!(ours(&text), theirs(&program, "alike", &text), "{text}");
    }
}

/// Random structs of everything that the grammar allows.
fn any_types(count: usize) -> String {
    let mut seed = 1_u64;
    let mut draw = move |end: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % end
    };
    const TYPES: [&str; 9] =
        ["int8_t", "int16_t", "int32_t", "int64_t", "byte", "float", "double", "string", "boolean"];
    let mut text = String::from("package drawn ;\n");
    for i in 0..count {
        text += &format!("struct s{i}_t {{ const int16_t N = {}, M = 0x{:x};\n", 1 + draw(20), 1 + draw(20));
        let mut sizes = ["N", "M", "3", "0x11", "017"].map(str::to_owned).to_vec();
        for j in 0..draw(8) {
            let ty = if i > 0 && draw(4) == 0 { format!("s{}_t", draw(i)) } else { TYPES[draw(9)].to_owned() };
            let name = format!("{}{j}", ["a", "Long_name_", "_"][draw(3)]);
            let dims: String = (0..draw(3)).map(|_| format!("[{}]", sizes[draw(sizes.len())])).collect();
            text += &format!("  {ty} {name}{dims};\n");
            if ty.starts_with("int") && dims.is_empty() {
                sizes.push(name); // a length for later members
            }
        }
        text += "}\n";
    }
    text
}

#[test]
fn random_types_have_the_same_hashes() {
    let Some(program) = official() else { return };
    let text = any_types(400);
    let parsed = lcm_gen::parse("drawn.lcm", &text).unwrap();
    let mut hashes = theirs(&program, "drawn", &text).unwrap();
    assert_eq!((parsed.definitions.len(), hashes.len()), (400, 400));
    // One at a time: together some of them exceed the size of a message.
    for definition in parsed.definitions {
        let alone = definition.members().iter().filter_map(|member| match &member.ty {
            lcm_gen::MemberType::Named(name) => name.strip_prefix("drawn."),
            lcm_gen::MemberType::Primitive(_) => None,
        });
        let others: BTreeMap<&str, String> = alone.map(|name| (name, format!("struct {name} {{ }}\n"))).collect();
        let begin = text.find(&format!("struct {} ", definition.short)).unwrap();
        let own = &text[begin..begin + text[begin..].find('}').unwrap() + 1];
        let file = format!("package drawn ;\n{}{own}\n", others.into_values().collect::<String>());
        let name = definition.name();
        assert_eq!(ours(&file).unwrap().remove(&name), hashes.remove(&name), "{own}");
    }
}

/// Accepted here and rejected there.
const LENIENT: &[&str] =
    &["struct x_t{ int32_t a; }", "struct x_t {int32_t a; }", "struct x_t { const double A = 1.5e+3; }"];

/// Rejected here and accepted there, with the reason.
const STRICT: &[(&str, &str)] = &[
    ("struct x_t { int32_t a-b; }", "breaks the compiler of every language"),
    ("struct string { int32_t a; }", "is a type already"),
    ("struct x_t { const int32_t N = -3; int32_t a[N]; }", "is no size"),
    ("struct x_t { const int64_t A = 9223372036854775808; }", "does not fit"),
    ("enum e_t { A } struct x_t { e_t a[2]; }", "C encodes the length of the last element"),
    ("struct x_t { x_t a; }", "has no end"),
    ("struct x_t { y_t a; }", "is not defined"),
    ("struct x_t { byte a[0x20000000]; }", "is more than a message can be"),
];

#[test]
fn differences_between_the_two_are_intended() {
    let Some(program) = official() else { return };
    for text in LENIENT.iter().copied().map(file) {
        assert!(ours(&text).is_some() && theirs(&program, "lenient", &text).is_none(), "{text}");
    }
    for (text, why) in STRICT {
        let text = file(text);
        assert!(ours(&text).is_none() && theirs(&program, "strict", &text).is_some(), "{text}: {why}");
    }
}
