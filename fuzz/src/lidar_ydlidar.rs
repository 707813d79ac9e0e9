//! YDLIDAR's lidars.

use crate::lidars;
use lidar::ld::NoEcho;
use lidar::probe::Kind;
use lidar::ydlidar::wire::{HEAD, HEADER, SAMPLES_MAX};
use lidar::ydlidar::{self, Config, Model};

/// A packet with a right checksum of kind, number of samples, angles and samples, or a descriptor and an answer.
fn packet(bytes: &[u8]) -> Vec<u8> {
    let [kind, count, first, second, third, fourth, samples @ ..] = bytes else { return bytes.to_vec() };
    if *kind == 0xA5 {
        return [&[0xA5, 0x5A], &bytes[1..]].concat();
    }
    let count = usize::from(*count) % SAMPLES_MAX + 1;
    let mut packet = vec![HEADER[0], HEADER[1], *kind, count as u8, first | 1, *second, third | 1, *fourth, 0, 0];
    packet.extend(samples.iter().copied().chain(std::iter::repeat(0)).take(2 * count));
    let sum = packet.chunks_exact(2).fold(0, |sum, word| sum ^ u16::from_le_bytes([word[0], word[1]]));
    packet[8..HEAD].copy_from_slice(&sum.to_le_bytes());
    packet
}

/// The engine of YDLIDAR's lidars, disturbed as `lidars` says.
pub fn lidar_ydlidar(data: &[u8]) {
    let Some((kind, steps)) = lidars::input(data) else { return };
    let model = [Model::X4, Model::G4][kind % 2];
    let no_echo = [NoEcho::Unknown, NoEcho::Nothing][kind / 2 % 2];
    let rate = (kind / 4 % 3) as u8;
    lidars::probe(&steps, Kind::Ydlidar, packet);
    let new = || {
        let mut device = ydlidar::emulated::Device::new(model);
        device.rate = rate;
        device
    };
    lidars::run(&steps, ydlidar::Ydlidar::new(Config { model, no_echo }), new, packet);
}
