//! LDROBOT's lidars.

use crate::lidars;
use lidar::ld;
use lidar::probe::Kind;

/// A packet of LDROBOT with these bytes.
fn packet(bytes: &[u8]) -> Vec<u8> {
    let mut packet = vec![ld::wire::HEADER, ld::wire::TYPE_AND_COUNT];
    packet.extend(bytes.iter().copied().chain(std::iter::repeat(0)).take(ld::wire::LENGTH - 3));
    packet.push(ld::wire::crc(&packet));
    packet
}

/// The engine of LDROBOT's lidars, disturbed as `lidars` says.
pub fn lidar_ld(data: &[u8]) {
    let Some((kind, steps)) = lidars::input(data) else { return };
    let model = [ld::Model::Ld19, ld::Model::Ld06, ld::Model::Stl19p][kind % 3];
    let no_echo = [ld::NoEcho::Unknown, ld::NoEcho::Nothing][kind / 3 % 2];
    lidars::probe(&steps, Kind::Ld, packet);
    let engine = ld::LdLidar::new(ld::Config { model, no_echo });
    lidars::run(&steps, engine, || ld::emulated::Device::new(model), packet);
}
