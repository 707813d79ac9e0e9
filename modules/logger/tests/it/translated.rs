//! Messages to translate, the results, and both as JSON.
#![allow(dead_code, reason = "each test has use for a part")]

use std::collections::BTreeMap;

use lcm_gen::dynamic::{Types, Value};
use lcm_gen::{Definition, Kind, Schema};
use logger::ros::{Beacon, RobotScene, Sensor, Topic, Translator, Untranslated};
use messages::{Channel, LCM_FILES, Message};
use serde_json::{Value as Json, json};

use testing::Random;

/// Translator of a robot with an outline and a beacon.
pub fn translator() -> Translator {
    Translator::new(scene())
}

pub fn scene() -> RobotScene {
    RobotScene {
        name: "advee".into(),
        outline: vec![[0.75, 0.3], [-0.15, 0.3], [-0.15, -0.3], [0.75, -0.3]],
        beacons: vec![Beacon { id: 4, x: 19.9, y: 11.9 }],
        sonar: Sensor::srf08(0.96),
        infrared: Sensor::GP2Y0A41,
    }
}

/// Translation of a message: topics and CDR.
pub fn translate(
    translator: &mut Translator,
    channel: &str,
    data: &[u8],
) -> Result<Vec<(Topic, Vec<u8>)>, Untranslated> {
    let mut all = Vec::new();
    translator.translate(channel, data, &mut |topic, cdr| all.push((topic.clone(), cdr.to_vec())))?;
    Ok(all)
}

/// Translation of one of the robot's messages, by topic, decoded by this project's reader.
pub fn told(translator: &mut Translator, message: impl Into<Message>) -> BTreeMap<String, Json> {
    let message = message.into();
    let mut data = Vec::new();
    message.encode(&mut data).unwrap();
    let all = translate(translator, &message.channel_name(), &data).unwrap();
    let told: BTreeMap<_, _> =
        all.iter().map(|(topic, cdr)| (topic.name.to_string(), named(&read(topic, cdr)))).collect();
    assert_eq!(told.len(), all.len(), "a topic twice");
    told
}

/// Message decoded by this project's reader, from the topic's schema alone.
pub fn read(topic: &Topic, cdr: &[u8]) -> Value<'static> {
    crate::reader::Text::new(&topic.schema_text).read(cdr)
}

/// As JSON with names.
pub fn named(value: &Value) -> Json {
    match value {
        Value::Struct(members) => members.iter().map(|(name, value)| (name.to_string(), named(value))).collect(),
        Value::Array(elements) => elements.iter().map(named).collect(),
        one => scalar(one),
    }
}

/// As JSON in which a struct is the list of its members, name and value, in order.
pub fn pairs(value: &Value) -> Json {
    match value {
        Value::Struct(members) => members.iter().map(|(name, value)| json!([name, pairs(value)])).collect(),
        Value::Array(elements) => elements.iter().map(pairs).collect(),
        one => scalar(one),
    }
}

fn scalar(value: &Value) -> Json {
    let number =
        |number: f64| if number.is_finite() { json!(number) } else { json!(number.to_string().to_lowercase()) };
    match value {
        Value::Bool(truth) => json!(truth),
        Value::Int(whole) => json!(whole),
        Value::Single(single) => number(f64::from(*single)),
        Value::Float(double) => number(*double),
        Value::Text(text) => json!(text),
        Value::Null | Value::Array(_) | Value::Struct(_) => panic!("{value:?}"),
    }
}

/// LCM message in the form of [`pairs`]: arrays flat, with their lengths.
pub fn lcm_pairs(schema: &Schema, ty: &Definition, value: &Value) -> Json {
    if let Kind::Enum { .. } = ty.kind {
        return json!([["value", scalar(value)]]);
    }
    let members = ty.members();
    if members.is_empty() {
        return json!([["structure_needs_at_least_one_member", 0]]);
    }
    let one = |member: &lcm_gen::Member| {
        let Some(value) = value.get(&member.name) else {
            let of =
                members.iter().find(|other| other.dims.first().is_some_and(|dim| dim.text == member.name)).unwrap();
            let Some(Value::Array(array)) = value.get(&of.name) else { panic!("{}", of.name) };
            return json!([member.name, array.len()]);
        };
        let mut flat = vec![value];
        for _ in &member.dims {
            let rows = flat.into_iter().map(|row| if let Value::Array(row) = row { row } else { panic!("{row:?}") });
            flat = rows.flatten().collect();
        }
        let element = |value: &Value| match &member.ty {
            lcm_gen::MemberType::Named(name) => lcm_pairs(schema, schema.get(name).unwrap(), value),
            lcm_gen::MemberType::Primitive(_) => scalar(value),
        };
        let flat: Vec<Json> = flat.into_iter().map(element).collect();
        json!([member.name.trim_matches('_'), if member.dims.is_empty() { flat[0].clone() } else { json!(flat) }])
    };
    members.iter().map(one).collect()
}

/// Types of the robot.
pub fn schema() -> Schema {
    Schema::new(LCM_FILES).unwrap()
}

/// Random messages on each of the robot's channels.
pub fn samples(seed: u64, each: usize) -> Vec<(String, Vec<u8>)> {
    let (schema, mut random) = (schema(), Random::new(seed));
    let mut samples = Vec::new();
    for channel in Channel::ALL {
        let name = if *channel == Channel::LlDataRaw { "LL_DATA_RAW_MAIN" } else { channel.name() };
        for _ in 0..each {
            samples.push((name.to_owned(), crate::dynamic::message(&schema, channel.type_name(), &mut random)));
        }
    }
    samples
}

/// LCM message of any type as JSON.
pub fn lcm_json(schema: &Schema, types: &Types, data: &[u8]) -> Json {
    let message = types.decode(data).unwrap().unwrap();
    lcm_pairs(schema, schema.get(message.ty().name()).unwrap(), &message.value())
}
