//! SICK's lidars.

use crate::lidars;
use lidar::probe::Kind;
use lidar::sick::{Config, Dialect, Family, Sick, emulated::Device, wire};

/// A telegram of CoLa A or B.
fn telegram(dialect: Dialect, bytes: &[u8]) -> Vec<u8> {
    match dialect {
        Dialect::Text => [&[wire::STX], bytes, &[wire::ETX]].concat(),
        Dialect::Binary => {
            let length = (bytes.len() as u32).to_be_bytes();
            [&[wire::STX; 4], length.as_slice(), bytes, &[wire::checksum(bytes)]].concat()
        }
    }
}

/// The engine of SICK's lidars, in both dialects of CoLa, disturbed as `lidars` says.
pub fn lidar_sick(data: &[u8]) {
    let Some((kind, steps)) = lidars::input(data) else { return };
    let dialect = [Dialect::Binary, Dialect::Text][kind % 2];
    let family = [Family::Tim5xx, Family::Lms1xx, Family::Tim7xx][kind / 2 % 3];
    let framed = |bytes: &[u8]| telegram(dialect, bytes);
    lidars::probe(&steps, Kind::Cola(dialect), framed);
    let engine = Sick::new(Config { fields: true, outputs: true, ..Config::new(family, dialect) });
    lidars::run(&steps, engine, || Device::new(family, dialect), framed);
}
