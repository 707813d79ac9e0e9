//! SLAMTEC's lidars.

use crate::lidars;
use lidar::probe::Kind;
use lidar::rplidar::{self, Mode, Model};

/// A capsule of 84 bytes, or a descriptor and an answer.
fn capsule(bytes: &[u8]) -> Vec<u8> {
    if let [0xA5, rest @ ..] = bytes {
        return [&[0xA5, 0x5A], rest].concat();
    }
    let mut capsule: Vec<u8> = bytes.iter().copied().chain(std::iter::repeat(0)).take(84).collect();
    let sum = capsule[2..].iter().fold(0, |sum, byte| sum ^ byte);
    (capsule[0], capsule[1]) = (0xA0 | sum & 0xF, 0x50 | sum >> 4);
    capsule
}

/// The engine of SLAMTEC's lidars, disturbed as `lidars` says.
pub fn lidar_rplidar(data: &[u8]) {
    let Some((kind, steps)) = lidars::input(data) else { return };
    let (model, mode) = [
        (Model::A1, Mode::Standard),
        (Model::A1, Mode::Ultra),
        (Model::A2, Mode::Express),
        (Model::A3, Mode::Ultra),
        (Model::C1, Mode::Dense),
        (Model::S2, Mode::Dense),
    ][kind % 6];
    lidars::probe(&steps, Kind::Rplidar, capsule);
    let engine = rplidar::Rplidar::new(rplidar::Config { mode, ..rplidar::Config::new(model) });
    lidars::run(&steps, engine, || rplidar::emulated::Device::new(model), capsule);
}
