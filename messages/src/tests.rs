//! Table of channels: every type once, all distinct.

use std::collections::BTreeMap;

use super::*;

/// Empty message of a channel.
fn empty(channel: Channel) -> Message {
    let mut bytes = channel.fingerprint().to_be_bytes().to_vec();
    loop {
        match Message::decode(channel, &bytes) {
            Ok(message) => return message,
            // An empty string is a length of 1 and its NUL; everything else may be zeros.
            Err(DecodeError::StringLength { len: 0, .. }) => {
                let end = bytes.len();
                bytes[end - 1] = 1;
                bytes.push(0);
            }
            Err(DecodeError::Truncated { .. } | DecodeError::StringLength { .. }) => bytes.push(0),
            Err(error) => panic!("{}: {error}", channel.name()),
        }
    }
}

#[test]
fn no_two_types_can_be_mistaken_for_each_other() {
    let files: Vec<(&str, &str)> = LCM_FILES.to_vec();
    let schema = lcm_gen::Schema::new(&files).unwrap();
    let mut known = BTreeMap::new();
    for definition in schema.definitions() {
        let name = definition.name();
        if let Some(other) = known.insert(schema.fingerprint(&name), name.clone()) {
            panic!("{name} and {other} have the same members");
        }
    }
    assert_eq!(known.len(), 87);
}

#[test]
fn a_list_is_the_watchdog_s_when_it_has_module_down_about_the_module_itself() {
    let fault = |number, subject: &str| common::Fault { number, subject: subject.into(), ..Default::default() };
    let list =
        |faults: &[common::Fault]| common::DataFaults { timestamp: 0, module: "eye".into(), faults: faults.into() };
    assert!(list(&[fault(0x0307, "eye")]).is_down());
    assert!(!list(&[fault(0x0307, "ear"), fault(0x0102, "eye")]).is_down());
    assert_eq!(["BoardLost sd1", "BoardLost"], [fault(0x0102, "sd1"), fault(0x0102, "")].map(|fault| fault.about()));
    assert_eq!([fault_name(0x8001), fault_name(-1)], ["0x8001", "0xFFFFFFFF"]);
}

#[test]
fn every_channel_carries_the_type_that_its_name_says() {
    let level = BTreeMap::from([
        ("CM", "common"),
        ("LL", "lowlevel"),
        ("ML", "middlelevel"),
        ("HL", "highlevel"),
        ("SIM", "simulation"),
    ]);
    for &channel in Channel::ALL {
        let (prefix, rest) = channel.name().split_once('_').unwrap();
        let short = rest.trim_end_matches('_').to_lowercase();
        let short = if channel == Channel::CmEventError { "error" } else { &short };
        assert_eq!(channel.type_name(), format!("{}.{short}_t", level[prefix]));
    }
}

#[test]
fn every_channel_is_found_by_its_name_and_by_nothing_else() {
    for &channel in Channel::ALL.iter().filter(|&&channel| channel != Channel::LlDataRaw) {
        assert_eq!(Channel::from_name(channel.name()), Some(channel));
        assert_eq!(Channel::from_name(&format!("{}X", channel.name())), None);
    }
    assert_eq!(Channel::from_name("LL_DATA_RAW_CAN_MAIN"), Some(Channel::LlDataRaw));
    assert_eq!(Channel::from_name("LL_DATA_RAW_"), None);
    assert_eq!(Channel::from_name("LL_DATA_RAW"), None);
    assert_eq!(Channel::from_name(""), None);
}

#[test]
fn every_message_comes_back_from_its_channel() {
    for &channel in Channel::ALL {
        let message = empty(channel);
        let mut bytes = Vec::new();
        message.encode(&mut bytes).unwrap();
        assert_eq!((message.channel(), message.timestamp()), (channel, 0));
        assert_eq!(Message::decode(channel, &bytes), Ok(message));
    }
}

#[test]
fn a_raw_frame_knows_its_bus_from_the_name_of_the_channel() {
    let frame = lowlevel::DataRaw { timestamp: 7, data: vec![1, 2], ..Default::default() };
    let message = Message::from(Raw { bus: "A".into(), frame });
    assert_eq!(message.channel_name(), "LL_DATA_RAW_A");
    let mut bytes = Vec::new();
    message.encode(&mut bytes).unwrap();
    assert_eq!(Message::receive("LL_DATA_RAW_A", &bytes), Some(Ok(message)));
    assert_eq!(Message::receive("SOMETHING_ELSE", &bytes), None);
}

#[test]
fn serialized_it_is_the_message_alone_and_nan_is_null() {
    let power = lowlevel::DataPower { charge: 0.5, remaining: f64::NAN, ..Default::default() };
    let json = serde_json::to_string(&Message::from(power)).unwrap();
    assert_eq!(json, r#"{"timestamp":0,"voltage":0.0,"charge":0.5,"remaining":null,"channels":[]}"#);
    let raw = Raw { bus: "A".into(), frame: lowlevel::DataRaw { data: vec![255], ..Default::default() } };
    let json = serde_json::to_string(&Message::from(raw)).unwrap();
    assert_eq!(json, r#"{"timestamp":0,"direction":0,"id":0,"flags":0,"data":[255]}"#);
}

#[test]
fn a_message_on_the_wrong_channel_is_detected_by_its_fingerprint() {
    let mut bytes = Vec::new();
    empty(Channel::LlDataSrfs).encode(&mut bytes).unwrap();
    let (expected, found) = (Channel::LlDataIrs.fingerprint(), Channel::LlDataSrfs.fingerprint());
    let error = DecodeError::Fingerprint { expected, found };
    assert_eq!(Message::decode(Channel::LlDataIrs, &bytes), Err(error));
}

#[test]
fn the_definitions_are_those_of_the_folder() {
    let paths: Vec<&str> = LCM_FILES.iter().map(|&(path, _)| path).collect();
    assert!(paths.is_sorted() && paths.contains(&"common/data_state_t.lcm"), "{paths:?}");
}
