//! Types known at run time only, compared with generated code and the official tools: same bytes, same JSON, same
//! rejections.
#![allow(clippy::unwrap_used, reason = "the test fails")]

use lcm::codec::Type;
use lcm_gen::dynamic::{DecodeError, Missing, Types, Value};
use lcm_gen::{Primitive, Schema};
use testing::Random;

use crate::dynamic;
use crate::support::files::files;
use crate::support::{self, Vectors, for_all_types, hex};

/// Result of generated code for bytes: the re-encoded bytes and JSON, or its error.
struct Generated<'a>(&'a [u8]);

impl support::Visitor for Generated<'_> {
    type Output = Result<(Vec<u8>, String), String>;

    fn visit<T: Type + serde::Serialize>(self) -> Self::Output {
        let value = T::decode(self.0).map_err(|error| error.to_string())?;
        let mut bytes = Vec::new();
        value.encode(&mut bytes).unwrap();
        Ok((bytes, serde_json::to_string(&value).unwrap()))
    }
}

/// Result of types known at run time.
fn ours(types: &Types, name: &str, bytes: &[u8]) -> Result<(Vec<u8>, String), String> {
    let message = types.get(name).unwrap().decode(bytes).map_err(|error| error.to_string())?;
    let mut again = vec![0xA5]; // preceding bytes are kept
    message.ty().encode(&message.value(), Missing::Refuse, &mut again).unwrap();
    assert_eq!(again.remove(0), 0xA5);
    Ok((again, serde_json::to_string(&message).unwrap()))
}

/// The same with the JSON of generated code, which has null for infinities.
fn derived(ours: Result<(Vec<u8>, String), String>) -> Result<(Vec<u8>, String), String> {
    ours.map(|(bytes, json)| (bytes, json.replace("\"-inf\"", "null").replace("\"inf\"", "null")))
}

fn from_json(types: &Types, name: &str, json: &str) -> Result<Vec<u8>, String> {
    let value: Value = serde_json::from_str(json).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    let done = types.get(name).unwrap().encode(&value, Missing::Refuse, &mut bytes);
    done.map(|()| bytes).map_err(|error| error.to_string())
}

#[test]
fn messages_of_the_official_tools_are_read_and_written_byte_for_byte() {
    let types = Types::new(&Schema::new(&files("vectors/types")).unwrap());
    let vectors = Vectors::load();
    assert_eq!(vectors.messages.len(), 20);
    for known in &vectors.messages {
        let (name, bytes) = (known["type"].as_str().unwrap(), hex(known["hex"].as_str().unwrap()));
        let message = types.decode(&bytes).unwrap().unwrap_or_else(|error| panic!("{name}: {error}"));
        // `vec.constants_t` and others have unique fingerprints: the name is found, too.
        assert_eq!(message.ty().name(), name);
        support::same(name, &serde_json::to_value(message).unwrap(), &known["value"]);
        assert_eq!(derived(ours(&types, name, &bytes)), for_all_types(name, Generated(&bytes)), "{name}");
        // Their JSON has lengths as members, bytes as hexadecimal digits, and texts for NaN and infinities.
        assert_eq!(from_json(&types, name, &known["value"].to_string()), Ok(bytes), "{name}");
    }
}

#[test]
fn decoding_at_run_time_equals_generated_code() {
    let mut random = Random::new(3);
    let mut accepted = 0;
    for folder in ["vectors/types", "more"] {
        let schema = Schema::new(&files(folder)).unwrap();
        let types = Types::new(&schema);
        for definition in schema.definitions() {
            let name = definition.name();
            for round in 0..600 {
                let mut bytes = dynamic::message(&schema, &name, &mut random);
                if round % 3 > 0 {
                    for _ in 0..random.index(4) {
                        let at = random.index(bytes.len());
                        bytes[at] = random.edge_byte();
                    }
                    bytes.truncate(bytes.len() - random.index(bytes.len()) * usize::from(random.index(4) == 0));
                }
                let (ours, generated) = (ours(&types, &name, &bytes), for_all_types(&name, Generated(&bytes)));
                assert_eq!(derived(ours.clone()), generated, "{name}: {bytes:02x?}");
                let Ok((_, json)) = ours else { continue };
                accepted += 1;
                // JSON loses only what it cannot represent: null is NaN.
                let again = from_json(&types, &name, &json).unwrap_or_else(|error| panic!("{name}: {error}: {json}"));
                assert_eq!(self::ours(&types, &name, &again).unwrap().1, json, "{name}");
                assert_eq!(again.len(), bytes.len(), "{name}");
            }
        }
    }
    assert!(accepted > 5000, "{accepted}");
}

#[test]
fn recursion_and_elements_without_bytes_are_bounded() {
    let types = Types::new(&Schema::new(&files("vectors/types")).unwrap());
    let tree = types.get("vec.tree_t").unwrap();
    let leaf =
        || Value::Struct(vec![("name".into(), Value::Text("".into())), ("children".into(), Value::Array(vec![]))]);
    let node = |child| {
        Value::Struct(vec![("name".into(), Value::Text("".into())), ("children".into(), Value::Array(vec![child]))])
    };
    let deep = |levels: usize| (1..levels).fold(leaf(), |tree, _| node(tree));
    let mut bytes = Vec::new();
    tree.encode(&deep(65), Missing::Refuse, &mut bytes).unwrap();
    assert_eq!(tree.decode(&bytes).unwrap().value(), deep(65));
    bytes.clear();
    let error = tree.encode(&deep(66), Missing::Refuse, &mut bytes).unwrap_err();
    assert!(error.to_string().ends_with("children[0]: nested deeper than 64"), "{error}");
    assert!(bytes.is_empty());
    bytes.extend(tree.fingerprint().to_be_bytes());
    (0..100_000).for_each(|_| bytes.extend(hex("000000010000000001")));
    assert_eq!(tree.decode(&bytes).unwrap_err(), DecodeError::Depth { max: 64 });

    // A type whose values, without a single byte, would fill a disk as text.
    let text =
        "struct e { } struct many { e x[60000]; } struct more { many x[60000]; } struct n { int8_t n; many x[n]; }";
    let types = Types::new(&Schema::new(&[("hostile.lcm", text)]).unwrap());
    let message = |name: &str, body: &[u8]| [&types.get(name).unwrap().fingerprint().to_be_bytes(), body].concat();
    let refused =
        |name: &str, body: &[u8]| types.decode(&message(name, body)).unwrap().err().map(|error| error.to_string());
    assert_eq!(refused("many", &[]), None);
    assert!(refused("more", &[]).unwrap().starts_with("array length 3600060000 where 0 to 65536"));
    assert_eq!(refused("n", &[1]), None);
    assert_eq!(refused("n", &[2]).unwrap(), "array length 2 where 0 to 1 are possible");
}

#[test]
fn types_are_found_by_fingerprint_and_by_name() {
    let schema =
        Schema::new(&[("t.lcm", "package p; struct a { int64_t timestamp; } struct b { int64_t timestamp; }")]);
    let types = Types::new(&schema.unwrap());
    let (a, b) = (types.get("p.a").unwrap(), types.get("p.b").unwrap());
    assert_eq!(a.fingerprint(), b.fingerprint(), "members alone make a fingerprint");
    assert_eq!(types.by_fingerprint(a.fingerprint()).unwrap().name(), "p.a");
    assert_eq!(types.iter().map(lcm_gen::dynamic::Type::name).collect::<Vec<_>>(), ["p.a", "p.b"]);
    assert!(a.has("timestamp", Primitive::Int64) && !a.has("timestamp", Primitive::Double));
    assert!(types.decode(&[1; 8]).is_none() && types.decode(&[1; 7]).is_none());
    assert_eq!(a.decode(&[1; 7]).err(), Some(DecodeError::Truncated { needed: 8, left: 7 }));
    assert_eq!(a.decode(&[1; 16]).unwrap_err().to_string(), {
        format!("another type: fingerprint 0101010101010101 where {:016x} is expected", a.fingerprint())
    });
}

#[test]
fn an_invalid_value_is_reported_with_its_path() {
    let text = "package p;
        enum e { RED = 1, BLUE }
        struct in_t { float x; boolean b; }
        struct t { int8_t n; int16_t m; in_t list[n]; byte raw[m]; byte grid[n][m]; string s; e e; int64_t i; double d; }";
    let types = Types::new(&Schema::new(&[("t.lcm", text)]).unwrap());
    let good = r#"{"list":[{"x":1.5,"b":true}],"raw":[1,2],"grid":["0aff"],"s":"","e":"BLUE","i":-9223372036854775808,"d":null}"#;
    let said = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        from_json(&types, "p.t", &good.replace(from, to))
    };
    let bytes = said("", "").unwrap();
    let value = types.decode(&bytes).unwrap().unwrap().value();
    assert_eq!(value.get("i"), Some(&Value::Int(i64::MIN)));
    assert_eq!(value.get("e"), Some(&Value::Int(2)));
    assert!(matches!(value.get("d"), Some(Value::Float(nan)) if nan.is_nan()));
    assert_eq!(value.get("grid"), Some(&Value::Array(vec![Value::Array(vec![Value::Int(10), Value::Int(255)])])));
    // Lengths may be given if they are right; numbers may be texts, booleans numbers, integers floats.
    for (from, to) in [
        (r#"{"list""#, r#"{"m":2,"n":1,"list""#),
        (r#""d":null"#, r#""d":"-inf""#),
        (r#""d":null"#, r#""d":1"#),
        ("true", "1"),
        ("-9223372036854775808", "-4.0"),
        ("BLUE\"", "BLUE\" "),
        (r#""BLUE""#, "-7"),
    ] {
        said(from, to).unwrap_or_else(|error| panic!("{to}: {error}"));
    }
    for (from, to, error) in [
        ("1.5", "\"fast\"", "list[0].x: expected a number, found a text"),
        ("1.5", "1e39", "list[0].x: out of the range of float"),
        ("true", "2", "list[0].b: expected a boolean, found a number"),
        (r#","b":true"#, "", "list[0].b: missing"),
        (r#""b":true"#, r#""b":true,"c":0"#, "list[0].c: no such member"),
        (r#""b":true"#, r#""b":true,"b":true"#, "list[0].b: given twice"),
        ("[1,2]", "[1,256]", "raw[1]: out of the range of byte"),
        ("[1,2]", "[1]", "grid[0]: 2 elements where 1 are expected"),
        (r#"["0aff"]"#, r#"["0af"]"#, "grid[0]: expected an array or hexadecimal digits, found a text"),
        (r#"["0aff"]"#, "[]", "grid: 0 elements where 1 are expected"),
        (r#"{"list""#, r#"{"n":2,"list""#, "list: 1 elements where 2 are expected"),
        (r#"{"list""#, r#"{"n":-1,"list""#, "n: -1 is not a possible length"),
        (r#"{"list""#, r#"{"n":128,"list""#, "n: 128 is not a possible length"),
        (r#""s":"""#, r#""s":"a\u0000""#, "s: contains a NUL character, the end of a string in LCM"),
        (r#""s":"""#, r#""s":1"#, "s: expected a text, found a number"),
        (r#""BLUE""#, r#""GREEN""#, "e: \"GREEN\" is not a value of the enum"),
        (r#""BLUE""#, "2147483648", "e: out of the range of int32_t"),
        ("-9223372036854775808", "-9223372036854775809", "i: out of the range of int64_t"),
        ("-9223372036854775808", "18446744073709551615", "i: out of the range of int64_t"),
        ("-9223372036854775808", "0.5", "i: expected a whole number, found a number"),
        (r#""d":null"#, r#""d":[]"#, "d: expected a number, found an array"),
    ] {
        assert_eq!(said(from, to).unwrap_err(), error, "{to}");
    }
    assert_eq!(from_json(&types, "p.t", "[]").unwrap_err(), "expected an object, found an array");
}

#[test]
fn infinities_are_the_same_in_json_and_back() {
    let text = "struct t { int8_t n; float f; double d; float fs[n]; double ds[2][n]; }";
    let types = Types::new(&Schema::new(&[("t.lcm", text)]).unwrap());
    let json = r#"{"f":"-inf","d":"inf","fs":[1.5,"inf"],"ds":[["-inf",null],["inf",-0.0]]}"#;
    let bytes = from_json(&types, "t", json).unwrap();
    assert_eq!(bytes[8..13], [2, 0xff, 0x80, 0, 0]);
    assert_eq!(ours(&types, "t", &bytes), Ok((bytes.clone(), json.to_owned())));
    assert_eq!(from_json(&types, "t", json), Ok(bytes));
}

#[test]
fn missing_members_are_zero_on_request() {
    let text = "struct in_t { string s; double d[2]; }
        struct t { int32_t n; int32_t m; in_t list[n]; boolean b[3]; byte grid[n][m]; in_t one; }";
    let types = Types::new(&Schema::new(&[("t.lcm", text)]).unwrap());
    let json = |json: &str| {
        let value: Value = serde_json::from_str(json).unwrap();
        let mut bytes = Vec::new();
        types.get("t").unwrap().encode(&value, Missing::Zero, &mut bytes).map_err(|error| error.to_string())?;
        Ok::<_, String>(serde_json::to_string(&types.decode(&bytes).unwrap().unwrap()).unwrap())
    };
    let zero = r#"{"s":"","d":[0.0,0.0]}"#;
    let expected = |list: &str, grid: &str, m: i32| {
        Ok(format!(r#"{{"m":{m},"list":[{list}],"b":[false,false,false],"grid":[{grid}],"one":{zero}}}"#))
    };
    assert_eq!(json("{}"), expected("", "", 0));
    assert_eq!(json(r#"{"n":1,"m":2}"#), expected(zero, "[0,0]", 2));
    assert_eq!(json(r#"{"list":[{}]}"#), expected(zero, "[]", 0));
    assert_eq!(json(r#"{"list":[{"q":1}]}"#), Err("list[0].q: no such member".into()));
    // Bounded time and memory.
    assert_eq!(json(r#"{"n":2147483647}"#), Err("list.s: the message would be longer than 256 MiB".into()));
}
