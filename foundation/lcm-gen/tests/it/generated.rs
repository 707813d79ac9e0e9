//! Generated code against the official tools: fingerprints, bytes, and what hostile bytes do.
#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "the test fails; it reads its own files")]

use std::fs;

use lcm::codec::{DecodeError, EncodeError, Type};
use lcm_gen::Schema;
use serde_json::Value;
use testing::Random;

use crate::dynamic;
use crate::own::more::{Lengths, r#mod};
use crate::support::files::{self, files};
use crate::support::{self, Vectors, for_all_types, hex};
use crate::vectors::vec;

#[test]
fn fingerprints_are_those_of_the_official_tools() {
    let schema = Schema::new(&files("vectors/types")).unwrap();
    let vectors = Vectors::load();
    assert_eq!(vectors.types.len(), 20);
    for known in &vectors.types {
        let name = known["type"].as_str().unwrap();
        let as_hex = |hash: Option<u64>| Value::String(format!("{:016x}", hash.unwrap()));
        assert_eq!(as_hex(schema.fingerprint(name)), known["fingerprint"], "{name}");
        if known["kind"] == "struct" {
            assert_eq!(as_hex(schema.base_hash(name)), known["base_hash"], "{name}");
        }
    }
    assert_eq!(schema.definitions().len(), 20);
}

#[test]
fn messages_are_byte_for_byte_those_of_the_official_tools() {
    let vectors = Vectors::load();
    assert_eq!(vectors.messages.len(), 20);
    for known in &vectors.messages {
        let (name, bytes) = (known["type"].as_str().unwrap(), hex(known["hex"].as_str().unwrap()));
        let ours = for_all_types(name, Both(&bytes)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(ours.bytes, bytes, "{name}");
        support::same(name, &ours.json, &known["value"]);
    }
}

/// Decodes a message and encodes it again.
struct Both<'a>(&'a [u8]);

/// A message as we understand it.
struct Ours {
    json: Value,
    bytes: Vec<u8>,
}

impl support::Visitor for Both<'_> {
    type Output = Result<Ours, DecodeError>;

    fn visit<T: Type + serde::Serialize + serde::de::DeserializeOwned>(self) -> Self::Output {
        let value = T::decode(self.0)?;
        let mut bytes = vec![0xA5]; // what stands before stays
        value.encode(&mut bytes).unwrap();
        assert_eq!(bytes.remove(0), 0xA5);
        into_a_slice(&value, &bytes);
        let json = serde_json::to_value(&value).unwrap();
        // JSON has no infinities: they become null, which is no number.
        if let Ok(again) = T::deserialize(&json) {
            assert_eq!(serde_json::to_value(&again).unwrap(), json);
        } else {
            assert!(json.to_string().contains("null"), "{json}");
        }
        Ok(Ours { json, bytes })
    }
}

/// Encodes into slices of all lengths, with bytes in them that must not matter.
fn into_a_slice<T: Type>(value: &T, bytes: &[u8]) {
    let needed = value.encoded_size();
    assert_eq!(needed, bytes.len());
    let mut out = vec![0xA5; needed + 3];
    assert_eq!(value.encode_into(&mut out), Ok(needed));
    assert_eq!((&out[..needed], &out[needed..]), (bytes, &[0xA5; 3][..]));
    for room in [0, 7, 8, needed - 1] {
        assert_eq!(value.encode_into(&mut out[..room.min(needed - 1)]).unwrap_err().to_string(), {
            let room = room.min(needed - 1);
            format!("{needed} bytes needed, room for {room}")
        });
    }
}

/// Both kinds of decoding read the same, also when they refuse.
fn views_agree(name: &str, bytes: &[u8]) {
    if let Some((owned, view)) = support::readings(name, bytes) {
        assert_eq!(owned, view, "{name}");
    }
}

#[test]
fn every_type_that_can_borrow_has_a_view_and_no_other() {
    let of = |folder: &str| fs::read_to_string(files::folder(folder).join("generated.rs")).unwrap();
    let code = of("vectors") + &of("more");
    let views = code.lines().filter(|line| line.contains("codec::View<'a> for")).count();
    let mut known = 0;
    for folder in ["vectors/types", "more"] {
        for definition in Schema::new(&files(folder)).unwrap().definitions() {
            known += usize::from(support::readings(&definition.name(), &[]).is_some());
        }
    }
    assert_eq!((views, known), (13, 13));
}

#[test]
fn every_value_is_restored_after_encoding() {
    let mut random = Random::new(1);
    for folder in ["vectors/types", "more"] {
        let schema = Schema::new(&files(folder)).unwrap();
        for definition in schema.definitions() {
            let name = definition.name();
            for _ in 0..200 {
                let bytes = dynamic::message(&schema, &name, &mut random);
                views_agree(&name, &bytes);
                let ours = for_all_types(&name, Both(&bytes));
                assert_eq!(ours.unwrap_or_else(|error| panic!("{name}: {error}")).bytes, bytes, "{name}");
            }
        }
    }
}

#[test]
fn a_message_cut_anywhere_is_refused() {
    for known in &Vectors::load().messages {
        let (name, bytes) = (known["type"].as_str().unwrap(), hex(known["hex"].as_str().unwrap()));
        for end in 0..bytes.len() {
            assert!(for_all_types(name, Both(&bytes[..end])).is_err(), "{name} cut after {end} bytes");
            views_agree(name, &bytes[..end]);
        }
        let longer = [&bytes[..], &[0]].concat();
        views_agree(name, &longer);
        assert_eq!(for_all_types(name, Both(&longer)).err(), Some(DecodeError::LeftOver { extra: 1 }), "{name}");
    }
}

/// Whatever is accepted encodes to as many bytes, which are the same message (not the same bytes: a boolean of 2
/// becomes 1).
#[test]
fn no_bytes_make_the_decoder_panic() {
    let mut random = Random::new(2);
    let mut accepted = 0;
    for folder in ["vectors/types", "more"] {
        let schema = Schema::new(&files(folder)).unwrap();
        for definition in schema.definitions() {
            let name = definition.name();
            for _ in 0..1000 {
                let mut bytes = dynamic::message(&schema, &name, &mut random);
                for _ in 0..random.index(4) {
                    let at = 8 + random.index(bytes.len().saturating_sub(8).max(1));
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte = random.edge_byte();
                    }
                }
                bytes.truncate(bytes.len() - random.index(bytes.len()) * usize::from(random.index(4) == 0));
                views_agree(&name, &bytes);
                if let Ok(first) = for_all_types(&name, Both(&bytes)) {
                    accepted += 1;
                    assert_eq!(first.bytes.len(), bytes.len(), "{name}");
                    let second =
                        for_all_types(&name, Both(&first.bytes)).unwrap_or_else(|error| panic!("{name}: {error}"));
                    assert_eq!(second.bytes, first.bytes, "{name}");
                }
            }
        }
    }
    assert!(accepted > 1000, "{accepted}");
}

fn refused<T: Type>(body: &str) -> String {
    let bytes = [&T::FINGERPRINT.to_be_bytes()[..], &hex(&body.replace(' ', ""))].concat();
    T::decode(&bytes).err().map_or_else(|| "accepted".to_owned(), |error| error.to_string())
}

#[test]
fn every_reason_to_refuse_bytes_has_its_error() {
    use vec::{EnumUser, Nested, Ping, Tree};
    let other = [&Tree::FINGERPRINT.to_be_bytes()[..], &[0; 20]].concat();
    let (expected, found) = (EnumUser::FINGERPRINT, Tree::FINGERPRINT);
    assert_eq!(EnumUser::decode(&other).err(), Some(DecodeError::Fingerprint { expected, found }));
    assert_eq!(EnumUser::decode(&other[..7]).err(), Some(DecodeError::Truncated { needed: 8, left: 7 }));
    assert_eq!(refused::<EnumUser>("00000000"), "truncated: 12 bytes needed, 4 left");
    assert_eq!(refused::<Tree>("00000000 00000000"), "string length 0 with 4 bytes left");
    assert_eq!(refused::<Tree>("ffffffff 00000000"), "string length -1 with 4 bytes left");
    assert_eq!(refused::<Tree>("7fffffff 00000000"), "string length 2147483647 with 4 bytes left");
    assert_eq!(refused::<Tree>("00000002 6161 00000000"), "string without a final NUL");
    assert_eq!(refused::<Tree>("00000003 610000 00000000"), "string with a NUL inside");
    assert_eq!(refused::<Tree>("00000003 61ff00 00000000"), "string is not UTF-8 after 1 bytes");
    assert_eq!(refused::<Tree>("00000002 6100 7fffffff"), "array length 2147483647 where 0 to 0 are possible");
    assert_eq!(refused::<Ping>("00000000 ff"), "array length -1 where 0 to 0 are possible");
    assert_eq!(refused::<Tree>("00000002 6100 00000000 00"), "1 bytes left over");
    let nested = format!("{} 7fff", "00".repeat(8 + 9 * 8));
    assert_eq!(refused::<Nested>(&nested), "array length 32767 where 0 to 0 are possible");
}

#[test]
fn a_length_that_stands_for_no_bytes_is_bounded_too() {
    // inner 0, both 0, outer 2^30: rows without columns, and structs without members.
    let body = "00000000 00 0000000040000000";
    assert_eq!(refused::<Lengths>(body), "array length 1073741824 where 0 to 65536 are possible");
    // Of 2^62 a size of 32 bits does not tell how many are possible.
    let body = "00000000 00 4000000000000000";
    let possible = if cfg!(target_pointer_width = "64") { 65536 } else { 0 };
    assert_eq!(
        refused::<Lengths>(body),
        format!("array length 4611686018427387904 where 0 to {possible} are possible")
    );
    // 30000 rows and 30000 lists of items fit, 30000 empty structs behind them do not any more.
    let body = "00000000 00 0000000000007530 0000";
    assert_eq!(refused::<Lengths>(body), "array length 30000 where 0 to 5536 are possible");
    // The inner length is looked at even where the outer one is 0.
    assert_eq!(refused::<Lengths>("ffffffff 00 0000000000000000 0000"), "array length -1 where 0 to 11 are possible");
}

#[test]
fn recursion_ends_at_64_levels_in_both_directions() {
    let leaf = || vec::Tree::default();
    let deep = |levels: usize| (1..levels).fold(leaf(), |tree, _| vec::Tree { children: vec![tree], ..leaf() });
    let mut bytes = Vec::new();
    deep(65).encode(&mut bytes).unwrap();
    assert_eq!(vec::Tree::decode(&bytes), Ok(deep(65)));

    bytes.truncate(8);
    assert_eq!(deep(66).encode(&mut bytes), Err(EncodeError::Depth { max: 64 }));
    assert_eq!(bytes.len(), 8);
    for _ in 0..100_000 {
        bytes.extend(hex("000000010000000001"));
    }
    assert_eq!(vec::Tree::decode(&bytes), Err(DecodeError::Depth { max: 64 }));
}

#[test]
fn values_that_lcm_cannot_express_are_refused_and_nothing_is_written() {
    let refused = |change: fn(&mut Lengths)| {
        let mut value = Lengths { inner: 1, fixed_first: [vec![0.0], vec![0.0]], ..Lengths::default() };
        let mut out = vec![1, 2, 3];
        value.encode(&mut out).unwrap();
        out.truncate(3);
        change(&mut value);
        let error = value.encode(&mut out).unwrap_err();
        assert_eq!(out, [1, 2, 3]);
        error.to_string()
    };
    assert_eq!(refused(|v| v.inner = -1), "length `inner` is negative: -1");
    assert_eq!(refused(|v| v.inner = 2), "`fixed_first` has 1 elements where 2 are expected");
    assert_eq!(refused(|v| v.rows.push(vec![])), "`rows` has 0 elements where 1 are expected");
    assert_eq!(refused(|v| v.rows.push(vec![0.0])), "`items` has 0 elements where 1 are expected");
    assert_eq!(refused(|v| v.words = vec![String::new(); 128]), "`both`: length 128 is above 127");
    assert_eq!(
        refused(|v| v.words.push("a\0b".into())),
        "`words` contains a NUL character, the end of a string in LCM"
    );
}

#[test]
fn awkward_names_keep_their_meaning() {
    use r#mod::r#type::{Default as Enum, Self_};
    assert_eq!((Self_::lower, Self_::Self_, Self_::r#fn), (1, 2, 3));
    assert_eq!((Enum::None, Enum::some, Enum::r#type), (Enum(1), Enum(-4), Enum(2)));
    let json = serde_json::to_value(Self_::default()).unwrap();
    let names: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names, ["CamelCase", "_", "item", "match", "self", "text", "type", "w", "x"]);
    assert_eq!(json["_"]["Value"].as_array().unwrap().len(), 34);
}

#[test]
fn constants_are_those_of_the_definition() {
    use vec::{Color, Constants};
    let integers = [i64::from(Constants::SMALL), Constants::SMALL_MAX.into(), Constants::MEDIUM.into()];
    assert_eq!(integers, [-128, 127, 0x7fff]);
    assert_eq!((Constants::ROWS, Constants::COLS, Constants::BIG), (2, 3, 9_007_199_254_740_993));
    assert_eq!(Constants::PI_F.to_bits(), 0x4049_0fd0);
    assert_eq!((Constants::E_D.to_bits(), Constants::NEG), (0x4005_bf0a_8b14_5769, -1.5e-3));
    assert_eq!([Color::RED, Color::GREEN, Color::BLUE, Color::NEXT], [1, 2, 7, 8].map(Color));
}
