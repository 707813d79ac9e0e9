//! Emulated devices against readers of others: SLAMTEC's own SDK (`pyrplidarsdk`), `lds2d` and `hokuyolx`. With
//! LIDAR_SECONDS=600 each reads for ten minutes.

#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a test uses real sockets"
)]

use base::Instant;
use lidar::emulated::{DIRECTIONS, Device};
use lidar::{hokuyo, ld, rplidar};
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

#[test]
fn lds2d_reads_packets_and_single_samples() {
    // The LD14P of lds2d has the packets of the LD19.
    for (kind, status) in [
        ("LD14P", serve("lds2d:LD14P", &["lds2d"], ld::emulated::Device::new(ld::Model::Ld19))),
        ("A1", serve("lds2d:RPLIDAR-A1", &["lds2d"], rplidar::emulated::Device::new(rplidar::Model::A1))),
        ("C1", serve("lds2d:RPLIDAR-C1", &["lds2d"], rplidar::emulated::Device::new(rplidar::Model::C1))),
    ] {
        assert!(status.is_none_or(|status| status.success()), "{kind}");
    }
}

#[test]
fn the_sdk_of_slamtec_reads_each_kind_of_capsule() {
    use rplidar::Model;
    // Ultra with a configuration; express without; ultra; dense; dense.
    for model in [Model::A1, Model::A2, Model::A3, Model::C1, Model::S2] {
        let kind = std::format!("slamtec:{}", model.baud());
        let status = serve(&kind, &["pyrplidarsdk"], rplidar::emulated::Device::new(model));
        assert!(status.is_none_or(|status| status.success()), "{model}");
    }
}

#[test]
fn hokuyolx_reads_identity_and_scans() {
    let device = hokuyo::emulated::Device::new(hokuyo::emulated::Model::UTM_30LX);
    let status = serve("hokuyo", &["hokuyolx"], device);
    assert!(status.is_none_or(|status| status.success()));
}
