//! Parser: accepted texts, rejected texts, and the position of the error.

use lcm_gen::rust::Options;
use lcm_gen::{Kind, Schema, Size};

/// Error of a rejected text.
fn refused(text: &str) -> String {
    Schema::new(&[("a.lcm", text)]).map_or_else(|error| error.to_string(), |_| "accepted".to_owned())
}

/// Checks that the text is accepted, as the struct `x_t` with the same fingerprint as `same`.
fn accepted(text: &str, same: &str) {
    let of = |text| Schema::new(&[("a.lcm", text)]).unwrap_or_else(|error| panic!("{error}")).fingerprint("p.x_t");
    assert_eq!(of(text), of(same), "{text}");
}

#[test]
fn mistakes_are_reported_with_file_line_and_column() {
    let cases = [
        ("int32_t x;", "1:1: expected `package`, `struct` or `enum`, found `int32_t`"),
        ("package p\nstruct x_t { }", "2:1: expected `;` after the package name, found `struct`"),
        ("package a..b;", "1:9: expected a package name, found `a..b`: a name is letters, digits and `_`"),
        ("struct x_t", "1:11: expected `{` after the name of a type, found the end of the file"),
        (
            "struct x_t {\n  int32_t a-b;\n}",
            "2:11: expected the name of a member, found `a-b`: a name is letters, digits and `_`",
        ),
        ("struct x_t {\n  int32_t a\n}", "3:1: expected `;` after the name of a member, found `}`"),
        ("struct x_t { int32_t a; };", "1:26: no `;` may follow the `}` of a struct"),
        ("struct x_t { int32_t a; int8_t a; }", "1:32: `a` is declared twice"),
        ("struct x_t { struct y_t { } }", "1:14: types cannot be defined inside a struct"),
        ("struct string { }", "1:8: `string` is a type of the language and cannot be defined"),
        ("struct x_t { }\nstruct x_t { }", "2:8: `x_t` is already defined in a.lcm:1"),
        ("struct x_t { other_t a; }", "1:14: type `other_t` is not defined"),
        ("struct x_t { double a[]; }", "1:23: expected an array dimension, found `]`"),
        ("struct x_t { double a[0]; }", "1:23: an array dimension must be an integer above 0, not `0`"),
        ("struct x_t { double a[-3]; }", "1:23: an array dimension must be an integer above 0, not `-3`"),
        (
            "struct x_t { const int8_t N = 0; double a[N]; }",
            "1:43: an array dimension must be an integer above 0, not `0`",
        ),
        ("struct x_t { double a[n]; int32_t n; }", "1:23: `n` is not a constant or member declared before"),
        ("struct x_t { double n; double a[n]; }", "1:33: `n` is not a scalar integer and cannot be an array dimension"),
        (
            "struct x_t { int8_t n[2]; double a[n]; }",
            "1:36: `n` is not a scalar integer and cannot be an array dimension",
        ),
        ("struct x_t { double a[2; }", "1:24: expected `]` after an array dimension, found `;`"),
        (
            "struct x_t { const string S = a; }",
            "1:20: a constant cannot be of type `string`, only integer, float, double",
        ),
        ("struct x_t { const int8_t N = 128; }", "1:31: `128` is out of the range of int8_t"),
        (
            "struct x_t { const int64_t N = 0x8000000000000000; }",
            "1:32: `0x8000000000000000` is out of the range of int64_t",
        ),
        ("struct x_t { const int32_t N = 1.5; }", "1:32: `1.5` is not an integer"),
        ("struct x_t { const int32_t N = 09; }", "1:32: `09` is not an integer"),
        ("struct x_t { const float F = 1e39; }", "1:30: `1e39` is out of the range of float"),
        ("struct x_t { const double D = nan; }", "1:31: `nan` is not a decimal number"),
        ("struct x_t { const int8_t N; }", "1:28: expected `=` after the name of a constant, found `;`"),
        (
            "struct x_t { const double N = 2; double a[N]; }",
            "1:43: `N` is not an integer constant and cannot be an array dimension",
        ),
        ("struct x_t { union u_t { } }", "1:14: types cannot be defined inside a struct"),
        ("struct x_t { ; }", "1:14: expected a member, `const` or `}`, found `;`"),
        (
            "struct x_t { y..z a; }",
            "1:14: expected the type of a member, found `y..z`: a name is letters, digits and `_`",
        ),
        ("struct { }", "1:8: expected the name of a type, found `{`"),
        ("enum e_t { A = 2147483647, B }", "1:28: the value is above 32 bits"),
        ("enum e_t { A = x }", "1:16: `x` is not a 32-bit integer"),
        ("enum e_t { A", "1:13: expected the name of an enum value, found the end of the file"),
        ("enum e_t { A, A }", "1:15: `A` is declared twice"),
        ("enum e_t { A = 2147483648 }", "1:16: `2147483648` is not a 32-bit integer"),
        (
            "enum e_t { A } struct x_t { e_t a[2]; }",
            "1:29: `e_t` is an enum: arrays of enums are encoded differently by C",
        ),
        ("struct a_t { b_t b; }\nstruct b_t { a_t a[2]; }", "1:8: `a_t` contains itself without end"),
        (
            "struct x_t { byte b[0x10000001]; }",
            "1:14: `b` makes messages of more than 2^28 bytes, the limit of receivers",
        ),
        ("struct x_t { }\n  /* no end", "2:3: comment without end: expected `*/`"),
        ("struct x_t { int32_t a; } @", "1:27: expected `package`, `struct` or `enum`, found `@`"),
        (
            "struct x_t { const string S = \"a\"; }",
            "1:20: a constant cannot be of type `string`, only integer, float, double",
        ),
        ("struct x_t { const int8_t A = \"a\"; }", "1:31: expected the value of a constant, found `\"`"),
        ("struct x_t { \u{7f} }", "1:14: expected a member, `const` or `}`, found `\\u{7f}`"),
        (
            "\u{feff}struct x_t { int32_t a; }",
            "1:1: the file begins with a byte order mark: save it as UTF-8 without one",
        ),
        (
            "package p; struct x_t { uint32_t a; }",
            "1:25: type `p.uint32_t` is not defined: LCM has no unsigned integers, only `int8_t` to `int64_t` and \
             `byte`",
        ),
        ("struct x_t { uint8_t a; }", "1:14: type `uint8_t` is not defined: LCM has no unsigned integers, only `byte`"),
        ("struct x_t { bool a; }", "1:14: type `bool` is not defined: the type is `boolean`"),
        ("enum e_t { A = 3, B = 0x3 }", "1:19: `B` and `A` have the same value 3"),
        (
            "struct x_t { int32_t ž; }",
            "1:22: expected the name of a member, found `ž`: a name is letters, digits and `_`",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(refused(text), format!("a.lcm:{message}"), "{text}");
    }
}

#[test]
fn a_mistake_between_files_is_reported_with_its_file() {
    let files = [("a.lcm", "package p; struct x_t { }"), ("b.lcm", "package q;\n\nstruct y_t { int8_t n; x_t x[n]; }")];
    assert_eq!(Schema::new(&files).unwrap_err().to_string(), "b.lcm:3:24: type `q.x_t` is not defined");
    let files = [("a.lcm", "package p; struct x_t { }"), ("b.lcm", "package p;\nstruct x_t { }")];
    assert_eq!(Schema::new(&files).unwrap_err().to_string(), "b.lcm:2:8: `p.x_t` is already defined in a.lcm:1");
}

#[test]
fn no_text_makes_the_parser_panic() {
    let text =
        "package p; /* c */ struct x_t { const int8_t N = 3; int8_t n; double a[n][N]; // d\n} enum e_t { A = 1, B }";
    let tokens =
        ["{", "}", "[", "]", ";", ",", "=", "struct", "-", "0x", "/*", "//", "\n", "\u{0}", "ž", "e+", "p.", "n", "9"];
    for end in 0..text.len() {
        let _ = Schema::new(&[("a.lcm", &text[..end])]);
        for token in tokens {
            let _ = Schema::new(&[("a.lcm", text[..end].to_owned() + token + &text[end..])]);
            let _ = Schema::new(&[("a.lcm", text[..end].to_owned() + token)]);
        }
    }
}

#[test]
fn white_space_and_spelling_are_free_where_the_fingerprint_is_not_concerned() {
    let plain = "package p; struct x_t { int32_t a; double b[3]; }";
    accepted("package p;struct x_t{int32_t a;double b[3];}", plain);
    accepted("package\np\n;\tstruct x_t\r\n{ int32_t a ; double b [ 3 ] ; }", plain);
    accepted("package p; struct x_t { const double D = 1.5e+3, E = -.5; int32_t a; double b[3]; }", plain);
    accepted("package p; /*/ c */ struct x_t { int32_t a; // c\n double b[/* c */3]; }", plain);
    accepted("package p; struct x_t { const int8_t N = 3; int32_t a; double b[N]; }", plain);
    accepted("package p; struct x_t { byte a, b[2], c; }", "package p; struct x_t { byte a; byte b[2]; byte c; }");
    accepted("package p; struct y_t { } struct x_t { y_t a; }", "package p; struct x_t { p.y_t a; } struct y_t { }");
}

#[test]
fn the_package_ends_with_its_file() {
    let files =
        [("a.lcm", "package p; struct x_t { }"), ("b.lcm", "struct y_t { p.x_t x; } package q; struct z_t { }")];
    let schema = Schema::new(&files).unwrap();
    let names: Vec<String> = schema.definitions().iter().map(lcm_gen::Definition::name).collect();
    assert_eq!(names, ["p.x_t", "y_t", "q.z_t"]);
}

#[test]
fn numbers_are_read_by_the_rules_of_c() {
    let schema = Schema::new(&[("a.lcm", "struct x_t { byte hex[0x1F]; byte octal[017]; byte plain[17]; }")]).unwrap();
    let sizes: Vec<Size> = schema.get("x_t").unwrap().members().iter().map(|member| member.dims[0].size).collect();
    assert_eq!(sizes, [Size::Fixed(31), Size::Fixed(15), Size::Fixed(17)]);
}

#[test]
fn comments_document_the_next_declaration_or_the_one_on_their_line() {
    let text = "
        // A remark about the file.

        /*
         * Two lines
         * about x_t.
         */
        struct x_t
        {
            // Of a and b.
            int32_t a, b;
            int32_t c; // Of c.
            int32_t d;

            // States.
            const int8_t N = 1;
        }
    ";
    let schema = Schema::new(&[("a.lcm", text)]).unwrap();
    let definition = schema.get("x_t").unwrap();
    assert_eq!(definition.doc, ["Two lines", "about x_t."]);
    let docs: Vec<String> = definition.members().iter().map(|member| member.doc.join("|")).collect();
    assert_eq!(docs, ["Of a and b.", "Of a and b.", "Of c.", ""]);
    let Kind::Struct { constants, .. } = &definition.kind else { panic!("a struct") };
    assert_eq!(constants[0].doc, ["States."]);
}

#[test]
fn the_comment_of_a_file_with_one_type_is_the_types() {
    let one = "// About the file.\npackage p;\n\n// About x_t.\nstruct x_t { }";
    let schema = Schema::new(&[("a.lcm", one)]).unwrap();
    assert_eq!(schema.get("p.x_t").unwrap().doc, ["About the file.", "", "About x_t."]);
    let two = "// About both.\npackage p;\n\n// About x_t.\nstruct x_t { }\nstruct y_t { }";
    let schema = Schema::new(&[("a.lcm", two)]).unwrap();
    assert_eq!(schema.get("p.x_t").unwrap().doc, ["About x_t."]);
    let twice = Schema::new(&[("a.lcm", two), ("b.lcm", &two.replace("_t", "_b_t"))]).unwrap();
    let code = lcm_gen::rust::generate(&twice, &Options::default()).unwrap();
    assert_eq!(code.matches("/// About both.\npub mod p {").count(), 1, "{code}");
}

#[test]
fn a_comment_is_text_to_rustdoc() {
    let text = "// See [n], <b>, `a[i]`.\n// ```\n// x[1]\n// ```\n// After [it].\nstruct x_t { }";
    let code = lcm_gen::rust::generate(&Schema::new(&[("a.lcm", text)]).unwrap(), &Options::default()).unwrap();
    let doc = "/// See \\[n\\], \\<b>, `a[i]`.\n/// ```text\n/// x[1]\n/// ```\n/// After \\[it\\].\n#[derive";
    assert!(code.contains(doc), "{code}");
}

#[test]
fn two_types_that_rust_could_not_tell_apart_are_refused() {
    let generate = |text| lcm_gen::rust::generate(&Schema::new(&[("a.lcm", text)]).unwrap(), &Options::default());
    let error = generate("struct data_x_t { }\nstruct DataX { }").unwrap_err().to_string();
    assert_eq!(error, "a.lcm:2:8: `data_x_t` and `DataX` get the same name in Rust");
    let views = Options { views: true, ..Options::default() };
    let both = Schema::new(&[("a.lcm", "struct data_t { string s; }\nstruct data_ref_t { }")]).unwrap();
    let error = lcm_gen::rust::generate(&both, &views).unwrap_err().to_string();
    assert_eq!(error, "a.lcm:2:8: `data_t` and `data_ref_t` get the same name in Rust");
    assert!(lcm_gen::rust::generate(&both, &Options::default()).is_ok());
    let error = generate("package codec; struct x_t { }").unwrap_err().to_string();
    assert_eq!(error, "a.lcm:1:23: a package cannot be named `codec` in Rust: the generated code needs the name");
    let error = generate("struct x_t { int8_t self; int8_t self_; }").unwrap_err().to_string();
    assert_eq!(error, "a.lcm:1:27: `self` and `self_` get the same name in Rust");
}

#[test]
fn neither_comments_nor_constants_break_the_code() {
    let generate = |text| lcm_gen::rust::generate(&Schema::new(&[("a.lcm", text)]).unwrap(), &Options::default());
    let code = generate("// one\rtwo\nstruct x_t { const int8_t MIN_SIZE = 1; double x; }").unwrap();
    assert!(code.contains("/// one two\n"), "{code}");
    // A constant of the type must not be mistaken for one of the codec.
    assert!(code.contains("<Self as codec::Type>::MIN_SIZE"), "{code}");
}

#[test]
fn fingerprints_and_sizes_of_deep_types_take_no_time() {
    let mut text = String::from("struct t0_t { byte b; }\n");
    for i in 1..32 {
        text += &format!("struct t{i}_t {{ t{}_t a; t{0}_t b; int8_t n; t{i}_t c[n]; }}\n", i - 1);
    }
    let error = refused(&text);
    assert!(error.ends_with("makes messages of more than 2^28 bytes, the limit of receivers"), "{error}");
    let text = text.replace("_t a; ", "_t a; int8_t m; ").replace("_t b; int8_t n;", "_t b[m]; int8_t n;");
    assert!(Schema::new(&[("a.lcm", &text)]).unwrap().fingerprint("t31_t").is_some());
}

#[test]
fn types_nest_as_deep_as_decoders_can_follow() {
    let chain = |count: usize| -> Vec<String> {
        let line = |i| format!("struct t{i}_t {{ t{}_t a; }}", i + 1);
        (0..count - 1).map(line).chain([format!("struct t{}_t {{ }}", count - 1)]).collect()
    };
    assert!(Schema::new(&[("a.lcm", chain(64).join("\n"))]).is_ok());
    let upwards = |count| chain(count).into_iter().rev().collect::<Vec<_>>().join("\n");
    assert!(Schema::new(&[("a.lcm", upwards(64))]).is_ok());
    assert_eq!(refused(&chain(65).join("\n")), "a.lcm:1:15: `a` nests deeper than 64 types and dimensions");
    assert_eq!(refused(&upwards(65)), "a.lcm:65:15: `a` nests deeper than 64 types and dimensions");
    for text in [chain(10_000).join("\n"), upwards(10_000)] {
        assert!(refused(&text).ends_with("`a` nests deeper than 64 types and dimensions"));
    }
    let array = |dims| format!("struct x_t {{ string s{}; }}", "[1]".repeat(dims));
    assert!(Schema::new(&[("a.lcm", array(63))]).is_ok());
    assert_eq!(refused(&array(64)), "a.lcm:1:14: `s` nests deeper than 64 types and dimensions");
    assert_eq!(refused(&array(100_000)), "a.lcm:1:14: `s` nests deeper than 64 types and dimensions");
}

#[test]
fn mutually_recursive_types_are_bounded() {
    let each = |count: usize| -> String {
        let members: String = (0..count).map(|i| format!(" t{i}_t m{i}[n];")).collect();
        (0..count).map(|i| format!("struct t{i}_t {{ int8_t n;{members} }}\n")).collect()
    };
    assert!(Schema::new(&[("a.lcm", each(7))]).is_ok());
    let error = refused(&each(20));
    assert!(error.ends_with("is one of too many mutually recursive types"), "{error}");
}

#[test]
fn an_element_of_a_variable_array_can_be_received() {
    let nobody = "`x` makes messages of more than 2^28 bytes, the limit of receivers";
    for dims in ["[n][99999999999][99999999999]", "[99999999999][n]", "[n][16385][16384]"] {
        let text = format!("struct x_t {{ int32_t n; byte x{dims}; }}");
        assert_eq!(refused(&text), format!("a.lcm:1:25: {nobody}"), "{dims}");
    }
    let most = Schema::new(&[("a.lcm", "struct x_t { int32_t n; byte x[n][16384][16384]; }")]).unwrap();
    assert!(lcm_gen::rust::generate(&most, &Options::default()).is_ok());
}
