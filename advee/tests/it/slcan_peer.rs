//! slcan device against that of python-can, each on a pseudo-terminal with a cable between them.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support;
use base::can::{Frame, Id};
use base::{Duration, Instant};
use host::clock;
use host::ports::{Port, PortConfig, PortState, Received};
use module::{Input, Output};
use nix::fcntl::OFlag;
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::{read, write};
use std::process::Command;
use std::thread;

/// Returns each received frame with its identifier plus one and its data reversed; ends with the first extended one.
const ECHO: &str = "
import can, sys
bus = can.Bus(interface='slcan', channel=sys.argv[1], bitrate=1000000, sleep_after_open=0)
while True:
    heard = bus.recv(20)
    back = can.Message(arbitration_id=heard.arbitration_id + 1, is_extended_id=heard.is_extended_id,
                       is_remote_frame=heard.is_remote_frame, dlc=heard.dlc, data=heard.data[::-1] if heard.data else None)
    bus.send(back)
    if heard.is_extended_id:
        break
bus.shutdown()
";

fn terminal() -> (PtyMaster, String) {
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let mut settings = tcgetattr(&master).unwrap();
    cfmakeraw(&mut settings);
    tcsetattr(&master, SetArg::TCSANOW, &settings).unwrap();
    let name = ptsname_r(&master).unwrap();
    (master, name)
}

/// Transfers the output of one side to the other.
fn pass(from: &PtyMaster, to: &PtyMaster) {
    let mut bytes = [0; 4096];
    if let Ok(length) = read(from, &mut bytes) {
        assert_eq!(write(to, &bytes[..length]), Ok(length));
    }
}

#[test]
fn python_can_receives_our_frames_and_we_receive_its() {
    let Some(python) = support::python() else { return };
    let ((left, path), (right, channel)) = (terminal(), terminal());
    let mut port = Port::new("can.main".into(), PortConfig::CanSlcan { path: path.into(), bitrate: 1_000_000 });
    let mut echo = Command::new(&python).args(["-c", ECHO, &channel]).spawn().unwrap();
    let sent = [
        Frame::standard(0x181, &[1, 2, 3]),
        Frame::remote(Id::Standard(0x701), 1).unwrap(),
        Frame::new(Id::Extended(0x1234_5678), &[0xFF, 0, 1, 2, 3, 4, 5, 6]).unwrap(),
    ];
    let expected = [
        Frame::standard(0x182, &[3, 2, 1]),
        Frame::remote(Id::Standard(0x702), 1).unwrap(),
        Frame::new(Id::Extended(0x1234_5679), &[6, 5, 4, 3, 2, 1, 0, 0xFF]).unwrap(),
    ];
    let (mut next, mut back) = (Instant::ZERO, Vec::new());
    let until = clock::now() + Duration::from_secs(30);
    while back.len() < sent.len() && clock::now() < until {
        let now = clock::now();
        if let Some(opened) = port.try_open(now) {
            assert_eq!(opened, Ok(()));
        }
        // A side that is not open yet receives nothing: sent again until it is answered.
        if port.state == PortState::Up && now >= next {
            next = now + Duration::from_millis(500);
            assert_eq!(port.device.send(now, &Output::Can(sent[back.len()])), Ok(true));
        }
        pass(&left, &right);
        pass(&right, &left);
        if port.state == PortState::Up
            && let Received::Input { input: Input::Can { frame, .. }, .. } = port.device.receive(now).unwrap()
        {
            // A repeated frame is answered again.
            if back.last() != Some(&frame) {
                back.push(frame);
                next = now;
            }
        }
        thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(back, expected);
    assert!(echo.wait().unwrap().success());
}
