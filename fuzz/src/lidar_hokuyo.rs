//! Hokuyo's lidars.

use crate::lidars;
use lidar::hokuyo::{self, emulated::Model};
use lidar::probe::Kind;

/// Lines with their checksums.
fn lines(bytes: &[u8]) -> Vec<u8> {
    let line = |line: &[u8]| match line {
        [] => vec![b'\n'],
        _ => [line, &[hokuyo::wire::checksum(line), b'\n']].concat(),
    };
    bytes.split(|byte| *byte == b'\n').flat_map(line).collect()
}

/// The engine of Hokuyo's lidars, disturbed as `lidars` says.
pub fn lidar_hokuyo(data: &[u8]) {
    let Some((kind, steps)) = lidars::input(data) else { return };
    let (name, model) = [("URG-04LX", Model::URG_04LX), ("UTM-30LX", Model::UTM_30LX)][kind % 2];
    lidars::probe(&steps, Kind::Scip, lines);
    let engine = hokuyo::Hokuyo::new(hokuyo::Config::new(name));
    lidars::run(&steps, engine, || hokuyo::emulated::Device::new(model), lines);
}
