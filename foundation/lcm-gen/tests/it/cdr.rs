//! CDR and its texts: decoded by an independent reader, a message equals its LCM form; whatever is rejected as LCM is
//! rejected. `modules/logger/tests` uses readers of others.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::mem::discriminant;

use lcm_gen::cdr::{ConvertError, LENGTHS_MAX, Plans, Writer};
use lcm_gen::dynamic::{DecodeError, Types, Value};
use lcm_gen::{Definition, Kind, Schema, ros2 as names};
use testing::Random;

use crate::support::files::files;
use crate::support::{Vectors, hex};
use crate::{dynamic, ros2};

/// Compares the ROS 2 form of a message with its LCM form: fields in order, without names.
fn same(schema: &Schema, ty: &Definition, lcm: &Value, ros: &Value) {
    let Value::Struct(fields) = ros else { panic!("{ros:?}") };
    if let Kind::Enum { .. } = ty.kind {
        assert_eq!([("value".into(), lcm.clone())], fields[..]);
        return;
    }
    let members = ty.members();
    if members.is_empty() {
        assert_eq!([("structure_needs_at_least_one_member".into(), Value::Int(0))], fields[..]);
        return;
    }
    assert_eq!(members.len(), fields.len());
    for (member, (name, ros)) in members.iter().zip(fields) {
        let Some(lcm) = lcm.get(&member.name) else {
            // A length that is left out there is the length of an array.
            let of =
                members.iter().find(|other| other.dims.first().is_some_and(|dim| dim.text == member.name)).unwrap();
            let Some(Value::Array(array)) = lcm.get(&of.name) else { panic!("{}", of.name) };
            assert_eq!(*ros, Value::Int(array.len() as i64), "{name}");
            continue;
        };
        let mut flat = vec![lcm];
        for _ in &member.dims {
            flat = flat
                .into_iter()
                .flat_map(|row| if let Value::Array(row) = row { row } else { panic!("{row:?}") })
                .collect();
        }
        let ros = match ros {
            Value::Array(elements) if !member.dims.is_empty() => elements.iter().collect(),
            one => vec![one],
        };
        assert_eq!(flat.len(), ros.len(), "{name}");
        for (lcm, ros) in flat.into_iter().zip(ros) {
            match (&member.ty, lcm, ros) {
                (lcm_gen::MemberType::Named(ty), ..) => same(schema, schema.get(ty).unwrap(), lcm, ros),
                (_, Value::Float(lcm), Value::Float(ros)) => assert_eq!(lcm.to_bits(), ros.to_bits(), "{name}"),
                (_, Value::Single(lcm), Value::Single(ros)) => assert_eq!(lcm.to_bits(), ros.to_bits(), "{name}"),
                _ => assert_eq!(lcm, ros, "{name}"),
            }
        }
    }
}

/// LCM and ROS 2 types of a schema.
struct Both {
    schema: Schema,
    types: Types,
    plans: Plans,
    names: names::Types,
}

impl Both {
    fn new(files: &[(impl AsRef<str>, impl AsRef<str>)]) -> Self {
        let schema = Schema::new(files).unwrap();
        Self { types: Types::new(&schema), plans: Plans::new(&schema), names: names::Types::new(&schema), schema }
    }

    /// Converts the bytes; both decoders must agree on whether they are a message.
    fn check(&self, name: &str, bytes: &[u8]) -> Result<Vec<u8>, ConvertError> {
        let lcm = self.types.get(name).unwrap().decode(bytes);
        let mut out = vec![0xA5; 5]; // alignment counts from the message, not from the preceding bytes
        let done = self.plans.get(name).unwrap().convert(bytes, &mut out);
        assert_eq!(out[..5], [0xA5; 5]);
        out.drain(..5);
        match (lcm, done) {
            (Ok(lcm), Ok(())) => {
                let text = self.names.get(name).unwrap().text();
                let ros = ros2::Text::new(&text).read(&out);
                same(&self.schema, self.schema.get(name).unwrap(), &lcm.value(), &ros);
                Ok(out)
            }
            (Err(lcm), Err(ConvertError::Message(error))) => {
                assert_eq!(discriminant(&lcm), discriminant(&error), "{name}: {lcm} and {error}: {bytes:02x?}");
                assert!(out.is_empty());
                Err(error.into())
            }
            (lcm, error) => panic!("{name}: {:?} and {error:?}: {bytes:02x?}", lcm.err()),
        }
    }
}

#[test]
fn messages_of_the_official_tools_say_the_same() {
    let both = Both::new(&files("vectors/types"));
    let vectors = Vectors::load();
    let mut without = Vec::new();
    for known in &vectors.messages {
        let (name, bytes) = (known["type"].as_str().unwrap(), hex(known["hex"].as_str().unwrap()));
        match both.plans.get(name) {
            Some(_) => drop(both.check(name, &bytes).unwrap()),
            None => without.push(name),
        }
    }
    assert_eq!(
        (vectors.messages.len(), without),
        (20, vec!["vec.tree_t", "vec.tree_t", "vec.ping_t", "vec.pong_t", "vec.deep.er.wrapper_t"])
    );
}

#[test]
fn only_valid_messages_are_converted() {
    let mut random = Random::new(5);
    let (mut converted, mut refused) = (0, 0);
    for folder in ["vectors/types", "more"] {
        let both = Both::new(&files(folder));
        for definition in both.schema.definitions() {
            let name = definition.name();
            if both.plans.get(&name).is_none() {
                continue;
            }
            for round in 0..300 {
                let mut bytes = dynamic::message(&both.schema, &name, &mut random);
                if round % 3 > 0 {
                    for _ in 0..random.index(4) {
                        let at = random.index(bytes.len());
                        bytes[at] = random.edge_byte();
                    }
                    bytes.truncate(bytes.len() - random.index(bytes.len()) * usize::from(random.index(4) == 0));
                }
                let done = both.check(&name, &bytes).is_ok();
                *(if done { &mut converted } else { &mut refused }) += 1;
            }
        }
    }
    assert!(converted > 3000 && refused > 1000, "{converted}, {refused}");
}

#[test]
fn types_unknown_to_ros_have_no_plan() {
    let both = Both::new(&files("vectors/types"));
    for name in ["vec.tree_t", "vec.ping_t", "vec.pong_t", "vec.nowhere_t"] {
        assert!(both.plans.get(name).is_none() && both.names.get(name).is_none(), "{name}");
    }
    let names = |count: usize| (0..count).map(|i| format!("int8_t n{i}; byte b{i}[n{i}];")).collect::<String>();
    let text = format!("struct t {{ u u; {} }} struct u {{ {} }}", names(LENGTHS_MAX - 4), names(4));
    let both = Both::new(&[("t", text.as_str())]);
    let mut random = Random::new(8);
    both.check("t", &dynamic::message(&both.schema, "t", &mut random)).unwrap();
    let both = Both::new(&[("t", text.replace("u u;", "int8_t n; u u[n];").as_str())]);
    assert!(both.plans.get("t").is_none() && both.plans.get("u").is_some());
}

#[test]
fn lengths_of_structs_in_each_other_are_kept_apart() {
    let text = "struct t { int8_t n; u before[n]; int16_t m; u rows[m][n]; string after[n]; double last[m]; }
        struct u { int8_t n; v inner[n]; byte behind[n]; } struct v { int64_t n; float x[n]; int8_t m; string s[m][n]; }";
    let both = Both::new(&[("t.lcm", text)]);
    let mut random = Random::new(7);
    for _ in 0..200 {
        both.check("t", &dynamic::message(&both.schema, "t", &mut random)).unwrap();
    }
}

#[test]
fn the_output_of_small_messages_is_bounded() {
    // Lengths shared by many arrays, elements without bytes, elements that each expand to many.
    let arrays: String = (0..1000).map(|i| format!("double a{i}[n];")).collect();
    let text = format!("struct t {{ int32_t m; u u[m]; }} struct u {{ int8_t n; {arrays} }}");
    let plans = Plans::new(&Schema::new(&[("t", text.as_str())]).unwrap());
    let plan = plans.get("t").unwrap();
    let mut message = plan.fingerprint().to_be_bytes().to_vec();
    message.extend(100_000_i32.to_be_bytes());
    message.resize(message.len() + 100_000, 0);
    let mut out = vec![7];
    assert_eq!(plan.convert(&message, &mut out), Err(ConvertError::TooLong));
    assert_eq!(out, [7]);

    let text =
        "struct e { } struct many { e x[60000]; } struct more { many x[60000]; } struct n { int8_t n; many x[n]; }";
    let both = Both::new(&[("hostile.lcm", text)]);
    let check = |name: &str, body: &[u8]| {
        let message = [&both.types.get(name).unwrap().fingerprint().to_be_bytes(), body].concat();
        both.check(name, &message).map(|cdr| cdr.len()).map_err(|error| error.to_string())
    };
    assert_eq!(check("many", &[]), Ok(60_004));
    assert_eq!(check("more", &[]).unwrap_err(), "array length 3600060000 where 0 to 65536 are possible");
    assert_eq!(check("n", &[1]), Ok(60_012));
    assert_eq!(check("n", &[2]).unwrap_err(), "array length 2 where 0 to 1 are possible");
}

#[test]
fn names_follow_the_rules_of_ros_and_stay_distinct() {
    let text = "package a__B.c;
        struct _the_t { const int8_t lower = 1, LOWER = -2; const double Tiny = 1e-9; int8_t self; int8_t Self; byte _; byte __9; }
        struct the { the_T x[2][3]; } struct the_T { boolean b; } enum e { RED = 4, red } struct nothing { }";
    let types = names::Types::new(
        &Schema::new(&[("t.lcm", text), ("u", "struct u { } package x_msgs; struct u_t { int64_t i; }")]).unwrap(),
    );
    let get = |name: &str| types.get(name).map(|ty| (ty.name(), ty.text())).unwrap();
    let expect = |name: &str, text: &str| (name.to_owned(), text.to_owned());
    let (rule, the) = ("=".repeat(80), "int8 LOWER=1\nint8 LOWER_2=-2\nfloat64 TINY=1e-9\n");
    assert_eq!(
        get("a__B.c._the_t"),
        expect("a_b_c/msg/The", &format!("{the}int8 self\nint8 self_2\nuint8 x\nuint8 x9\n"))
    );
    let nested = format!("a_b_c/TheT[6] x\n{rule}\nMSG: a_b_c/TheT\nbool b\n");
    assert_eq!(get("a__B.c.the"), expect("a_b_c/msg/The2", &nested));
    assert_eq!(get("a__B.c.e"), expect("a_b_c/msg/E", "int32 RED=4\nint32 RED_2=5\nint32 value\n"));
    assert_eq!(get("a__B.c.nothing").1, "uint8 structure_needs_at_least_one_member\n");
    assert_eq!((get("u").0, get("x_msgs.u_t").0), ("lcm/msg/U".to_owned(), "lcm_x_msgs/msg/U".to_owned()));
}

#[test]
fn a_message_by_hand_is_aligned_as_one_by_plan() {
    let mut out = vec![1, 2, 3];
    let mut to = Writer::new(&mut out);
    assert!(to.is_empty());
    to.bool(true);
    to.f64(1.0);
    to.string("a\0b");
    to.i8(-1);
    to.count(2);
    assert_eq!(to.len(), 28);
    let expected = "010203 00010000 0100000000000000 000000000000f03f 02000000 6100 ff00 02000000";
    assert_eq!(out, hex(&expected.replace(' ', "")));
}

#[test]
fn errors_are_lines_for_people() {
    let text = ConvertError::from(DecodeError::Unterminated).to_string();
    assert_eq!(
        (text.as_str(), ConvertError::TooLong.to_string()),
        ("string without a final NUL", "longer than 256 MiB as CDR".into())
    );
}
