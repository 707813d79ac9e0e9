//! Emulated devices against readers of others: SLAMTEC's own SDK (`pyrplidarsdk`), `lds2d`, `PyLidar3` and `hokuyolx`.
//! With LIDAR_SECONDS=600 each reads for ten minutes.

#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a test uses real sockets"
)]

use base::Instant;
use lidar::emulated::{DIRECTIONS, Device};
use lidar::{hokuyo, ld, rplidar, ydlidar};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant as Clock};
use testing::{peer_or_skip, python};

/// Time limit of everything besides the reading.
const PATIENCE: Duration = Duration::from_secs(120);

/// Time for which each peer reads, s: some scans.
fn seconds() -> u64 {
    std::env::var("LIDAR_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(0)
}

struct Peer(Child);

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A wall at 2 m, 4 m on the right, 1 m behind; 3 m on the left.
fn furnish(device: &mut impl Device) {
    for (n, range) in device.scene().0.iter_mut().enumerate() {
        // Eighths counter-clockwise, each around its direction.
        *range = [2.0, 3.0, 3.0, 3.0, 1.0, 2.5, 4.0, 2.5][(n + DIRECTIONS / 16) / (DIRECTIONS / 8) % 8];
    }
}

/// Runs the peer with the device at the other end; `None`: it is not installed.
fn serve(kind: &str, packages: &[&str], mut device: impl Device) -> Option<ExitStatus> {
    let python = peer_or_skip(python(packages))?;
    furnish(&mut device);
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    listener.set_nonblocking(true).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer.py");
    let port = listener.local_addr().unwrap().port().to_string();
    let arguments = [kind, &port, &seconds().to_string()];
    let mut peer = Peer(Command::new(python).arg(script).args(arguments).spawn().unwrap());
    let patience = PATIENCE + Duration::from_secs(seconds());
    let start = Clock::now();
    let mut socket = None;
    let mut bytes = [0; 4096];
    loop {
        assert!(start.elapsed() < patience, "{kind}: too long");
        if let Some(status) = peer.0.try_wait().unwrap() {
            return Some(status);
        }
        let now = Instant::ZERO + Duration::from_secs(1) + start.elapsed();
        device.handle_timeout(now);
        let Some(stream) = &mut socket else {
            if let Ok((stream, _)) = listener.accept() {
                stream.set_nonblocking(false).unwrap();
                stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
                stream.set_nodelay(true).unwrap();
                socket = Some(stream);
            }
            std::thread::yield_now();
            continue;
        };
        match stream.read(&mut bytes) {
            Ok(0) => return Some(peer.0.wait().unwrap()),
            Ok(count) => device.handle_rx(now, &bytes[..count]),
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => {}
            Err(_) => return Some(peer.0.wait().unwrap()),
        }
        let count = device.poll_tx(now, &mut bytes);
        if stream.write_all(&bytes[..count]).is_err() {
            return Some(peer.0.wait().unwrap());
        }
    }
}

/// `lds2d` reads a device.
#[track_caller]
fn lds2d(kind: &str, device: impl Device) {
    let status = serve(kind, &["lds2d"], device);
    assert!(status.is_none_or(|status| status.success()));
}

#[test]
fn lds2d_reads_packets() {
    // Its LD14P has the packets of the LD19.
    lds2d("lds2d:LD14P", ld::emulated::Device::new(ld::Model::Ld19));
}

#[test]
fn lds2d_reads_single_samples_of_an_a1() {
    lds2d("lds2d:RPLIDAR-A1", rplidar::emulated::Device::new(rplidar::Model::A1));
}

#[test]
fn lds2d_reads_single_samples_of_a_c1() {
    lds2d("lds2d:RPLIDAR-C1", rplidar::emulated::Device::new(rplidar::Model::C1));
}

#[test]
fn lds2d_reads_packets_of_a_ydlidar_x4() {
    lds2d("lds2d:YDLIDAR-X4", ydlidar::emulated::Device::new(ydlidar::Model::X4));
}

/// `PyLidar3` reads a device.
#[track_caller]
fn pylidar3(model: ydlidar::Model) {
    let kind = std::format!("pylidar3:{}", model.number());
    let status = serve(&kind, &["serial", "PyLidar3"], ydlidar::emulated::Device::new(model));
    assert!(status.is_none_or(|status| status.success()));
}

#[test]
fn pylidar3_reads_identity_health_and_packets_of_an_x4() {
    pylidar3(ydlidar::Model::X4);
}

#[test]
fn pylidar3_reads_identity_health_and_packets_of_a_g4() {
    pylidar3(ydlidar::Model::G4);
}

/// SLAMTEC's own SDK reads a device.
#[track_caller]
fn slamtec(model: rplidar::Model) {
    let kind = std::format!("slamtec:{}", model.baud());
    let status = serve(&kind, &["pyrplidarsdk"], rplidar::emulated::Device::new(model));
    assert!(status.is_none_or(|status| status.success()));
}

#[test]
fn the_sdk_of_slamtec_reads_ultra_capsules_of_an_a1() {
    slamtec(rplidar::Model::A1);
}

#[test]
fn the_sdk_of_slamtec_reads_express_capsules_of_an_a2() {
    slamtec(rplidar::Model::A2);
}

#[test]
fn the_sdk_of_slamtec_reads_ultra_capsules_of_an_a3() {
    slamtec(rplidar::Model::A3);
}

#[test]
fn the_sdk_of_slamtec_reads_dense_capsules_of_a_c1() {
    slamtec(rplidar::Model::C1);
}

#[test]
fn the_sdk_of_slamtec_reads_dense_capsules_of_an_s2() {
    slamtec(rplidar::Model::S2);
}

#[test]
fn hokuyolx_reads_identity_and_scans() {
    let device = hokuyo::emulated::Device::new(hokuyo::emulated::Model::UTM_30LX);
    let status = serve("hokuyo", &["hokuyolx"], device);
    assert!(status.is_none_or(|status| status.success()));
}
