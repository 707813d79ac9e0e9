//! Types of all that the node announces.

use super::*;
use crate::type_hashes::user_data;
use messages::common::{DataFaults, DataProcesses, DataState, EventText};
use messages::highlevel::DataAction;
use messages::lowlevel::{
    DataAxes, DataGuard, DataHold, DataImu, DataPower, DataRanges, DataScan, DataTemperature, EventStop, Reading,
    Temperature,
};
use messages::middlelevel::{DataEstimate, DataGoal, DataPlan};
use planner::map::{Frame, Map};
use std::collections::BTreeSet;

/// A node of a simulated robot, managed and with leave to command, that has published something of each type.
fn talkative() -> Bench {
    let usual = config(true, true);
    let frame = Frame { x: 0.0, y: 0.0, resolution: 0.5, width: 2, height: 2 };
    let map = outgoing::map(&Map::new(frame).unwrap(), 0);
    let mut bench = Bench::of(Config {
        outgoing: outgoing::Config { simulated: true, ..usual.outgoing },
        fixed: vec![map, (Description::topic(), vec![0, 1, 0, 0])],
        ..usual
    });
    bench.run(300);
    for timestamp in [1, 50_001] {
        bench.bus(DataVelocity { timestamp, ..Default::default() });
    }
    for revolution in [1, 2] {
        let (name, ranges) = ("top".into(), vec![1.0; 4]);
        bench.bus(DataScan { revolution, name, angle_step: 1.5, ranges, ..Default::default() });
    }
    bench.bus(DataRanges { timestamp: 1, readings: vec![Reading::default()] });
    bench.bus(DataTemperature { temperatures: vec![Temperature::default()], ..Default::default() });
    let rest: [Message; 14] = [
        DataAction::default().into(),
        DataAxes::default().into(),
        DataEstimate::default().into(),
        DataFaults::default().into(),
        DataGoal::default().into(),
        DataGuard::default().into(),
        DataHold::default().into(),
        DataImu::default().into(),
        DataPlan::default().into(),
        DataPower::default().into(),
        DataProcesses::default().into(),
        DataState::default().into(),
        EventStop::default().into(),
        EventText::default().into(),
    ];
    rest.into_iter().for_each(|message| bench.bus(message));
    bench.run(300);
    bench
}

#[test]
fn every_endpoint_is_announced_with_the_hash_of_its_type_and_the_table_has_no_other_types() {
    let bench = talkative();
    let is_text = |byte: &u8| byte.is_ascii_alphanumeric() || b"_:/=;".contains(byte);
    let texts = bench.sent.split(|byte| !is_text(byte)).filter_map(|text| std::str::from_utf8(text).ok());
    let is_type = |text: &&str| text.contains("::dds_::");
    let (types, hashes): (Vec<&str>, Vec<&str>) =
        texts.filter(|text| is_type(text) || text.starts_with("typehash=")).partition(is_type);
    // In the data of an endpoint the hash comes behind the type.
    for (n, name) in types.iter().enumerate() {
        assert_eq!(hashes.get(n).map(|text| text.as_bytes()), Some(&user_data(name)[..]), "{name}");
    }
    let types: BTreeSet<&str> = types.into_iter().collect();
    let table = include_str!("../../type_hashes.txt").lines().filter(|line| !line.starts_with('#'));
    assert_eq!(types.len(), table.count(), "{types:?}");
}
