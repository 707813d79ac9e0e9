//! Random messages from the definitions: a second encoder, independent of the generated code.

use std::collections::BTreeMap;

use lcm_gen::{Dim, Kind, MemberType, Primitive, Schema, Size};

use testing::Random;

/// Valid message of the type, in the form of the encoder (booleans 0 or 1).
pub fn message(schema: &Schema, name: &str, random: &mut Random) -> Vec<u8> {
    let mut out = schema.fingerprint(name).unwrap().to_be_bytes().to_vec();
    body(schema, name, random, 0, &mut out);
    out
}

fn body(schema: &Schema, name: &str, random: &mut Random, depth: usize, out: &mut Vec<u8>) {
    let definition = schema.get(name).unwrap();
    if matches!(definition.kind, Kind::Enum { .. }) {
        return out.extend(&random.next().to_be_bytes()[..4]);
    }
    let members = definition.members();
    let mut lengths = BTreeMap::new();
    for member in members {
        let is_length = members
            .iter()
            .flat_map(|other| &other.dims)
            .any(|dim| dim.size == Size::Variable && dim.text == member.name);
        if is_length {
            let length = if depth > 3 { 0 } else { random.index(4) };
            lengths.insert(member.name.as_str(), length);
            let MemberType::Primitive(ty) = member.ty else { panic!("a length is an integer") };
            out.extend(&(length as u64).to_be_bytes()[8 - ty.min_size()..]);
        } else {
            array(schema, &member.ty, &member.dims, &lengths, random, depth, out);
        }
    }
}

fn array(
    schema: &Schema,
    ty: &MemberType,
    dims: &[Dim],
    lengths: &BTreeMap<&str, usize>,
    random: &mut Random,
    depth: usize,
    out: &mut Vec<u8>,
) {
    match (dims, ty) {
        ([dim, inner @ ..], _) => {
            let count = match dim.size {
                Size::Fixed(count) => count,
                Size::Variable => lengths[dim.text.as_str()],
            };
            (0..count).for_each(|_| array(schema, ty, inner, lengths, random, depth, out));
        }
        ([], MemberType::Named(name)) => body(schema, name, random, depth + 1, out),
        ([], MemberType::Primitive(Primitive::String)) => {
            let text: String = (0..random.index(4)).map(|_| ['a', 'Z', ' ', 'ž', '漢'][random.index(5)]).collect();
            out.extend((text.len() as i32 + 1).to_be_bytes());
            out.extend(text.bytes().chain([0]));
        }
        ([], MemberType::Primitive(Primitive::Boolean)) => out.push(random.index(2) as u8),
        ([], MemberType::Primitive(Primitive::Float)) => {
            out.extend((random.next() as i32 as f32).to_be_bytes());
        }
        ([], MemberType::Primitive(ty)) => {
            out.extend(&random.next().to_be_bytes()[..ty.min_size()]);
        }
    }
}
