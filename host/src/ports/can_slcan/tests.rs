//! The device on a pseudo-terminal whose other end acts as the adapter.

use super::*;
use crate::ports::{Port, PortConfig, PortState};
use nix::pty::{grantpt, posix_openpt, ptsname_r, unlockpt};

const OPENING: &str = "\rC\rS8\rO\r";

/// The adapter's end, and the port with its channel open.
fn joined() -> (OwnedFd, Port) {
    let (adapter, mut port) = plugged();
    open_within(&mut port).unwrap();
    assert_eq!(on_line(&adapter, OPENING), OPENING);
    (adapter, port)
}

fn plugged() -> (OwnedFd, Port) {
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname_r(&master).unwrap().into();
    let port = Port::new("can.main".into(), PortConfig::CanSlcan { path, bitrate: 1_000_000 });
    (master.into(), port)
}

fn open_within(port: &mut Port) -> Result<(), Lost> {
    let until = clock::now() + Duration::from_secs(5);
    while clock::now() < until {
        if let Some(opened) = port.try_open(clock::now()) {
            return opened;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Err("never".into())
}

/// Output of the port, up to the length of the expected text: a terminal delivers with delay.
fn on_line(adapter: &OwnedFd, expected: &str) -> String {
    let until = clock::now() + Duration::from_secs(2);
    let mut text = String::new();
    while text.len() < expected.len() && clock::now() < until {
        let mut bytes = [0; 4096];
        match read(adapter, &mut bytes) {
            Ok(length) => text += std::str::from_utf8(&bytes[..length]).unwrap(),
            Err(_) => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    text
}

/// All output of the port within some time.
fn all(adapter: &OwnedFd) -> String {
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    loop {
        std::thread::sleep(Duration::from_millis(20));
        let before = text.len();
        while let Ok(length) = read(adapter, &mut bytes) {
            text += std::str::from_utf8(&bytes[..length]).unwrap();
        }
        if text.len() == before {
            return text;
        }
    }
}

fn say(adapter: &OwnedFd, text: &str) {
    assert_eq!(write(adapter, text.as_bytes()), Ok(text.len()));
}

/// Results of reading the port now and shortly after, as text.
fn drain(port: &mut Port, now: Instant) -> Vec<String> {
    let mut told = Vec::new();
    let until = clock::now() + Duration::from_millis(50);
    loop {
        told.push(match port.device.receive(now) {
            Ok(Received::Nothing) if clock::now() > until => return told,
            Ok(Received::Nothing) => {
                std::thread::sleep(Duration::from_millis(1));
                continue;
            }
            Ok(Received::Input { input: Input::Can { frame, .. }, .. }) => {
                format!("{:?} {:?}", frame.id(), frame.data())
            }
            Ok(Received::Input { input: Input::CanNotice(notice), .. }) => format!("{notice:?}"),
            Ok(Received::Fault(fault, _)) => format!("{fault:?}"),
            Ok(Received::Note(note)) => note,
            Ok(Received::Input { .. }) => panic!(),
            Err(why) => {
                port.lose(now);
                let (_, why) = why.split_once(": ").unwrap();
                return [told, vec![format!("down: {why}")]].concat();
            }
        });
    }
}

#[test]
fn it_joins_the_bus_and_frames_cross() {
    let (adapter, mut port) = joined();
    let now = clock::now();
    say(&adapter, "\r\rt1812AB");
    assert_eq!(drain(&mut port, now), [""; 0]);
    say(&adapter, "CD\rT1234567800000\rz\r");
    assert_eq!(drain(&mut port, now), ["Standard(385) [171, 205]", "Extended(305419896) []"]);
    let frame = Frame::standard(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
    assert_eq!(port.device.send(now, &Output::Can(frame)), Ok(true));
    let line = "t60184041600000000000\r";
    assert_eq!(on_line(&adapter, line), line);
    say(&adapter, "z\rrubbish\r??\r\x07");
    assert_eq!(drain(&mut port, now), ["MessageMalformed", "MessageMalformed", "PortOverrun"]);
    port.lose(now);
    assert_eq!(on_line(&adapter, "\rC\r"), "\rC\r");
}

#[test]
fn extended_frames_are_skipped_unless_wanted() {
    let (adapter, port) = plugged();
    let mut port = port.expecting(Line::Can { bitrate: 1_000_000 }, false);
    open_within(&mut port).unwrap();
    say(&adapter, "\r\rT123456780\rt1810\r");
    assert_eq!(drain(&mut port, clock::now()), ["Standard(385) []"]);
}

#[test]
fn flags_are_polled_and_become_notices() {
    let (adapter, mut port) = joined();
    let now = clock::now();
    let later = |n| now + n * Duration::from_millis(1100);
    say(&adapter, "\r\r");
    assert_eq!(drain(&mut port, now), [""; 0]);
    assert_eq!((drain(&mut port, later(1)), all(&adapter)), (vec![], "F\r".into()));
    say(&adapter, "FA1\r");
    let passive = "Health(Health { state: Passive, transmit_errors: 0, receive_errors: 0 })";
    assert_eq!(drain(&mut port, later(1)), [passive, "Errors(1)", "Lost(1)"]);
    drain(&mut port, later(2));
    say(&adapter, "F20\r");
    assert_eq!(drain(&mut port, later(2)), [""; 0], "no news");
    assert_eq!((drain(&mut port, later(3)), all(&adapter)), (vec![], "F\rF\r".into()));
    // Without an answer no further polling; a rejection ends it.
    assert_eq!((drain(&mut port, later(5)), all(&adapter)), (vec![], String::new()));
    say(&adapter, "\x07");
    assert_eq!(drain(&mut port, later(5)), ["the adapter does not report the state of its controller"]);
    assert_eq!((drain(&mut port, later(9)), all(&adapter)), (vec![], String::new()));
}

#[test]
fn an_adapter_that_refuses_vanishes_or_is_bus_off_is_reported_and_reopened() {
    let (adapter, mut port) = joined();
    say(&adapter, "\x07");
    assert_eq!(drain(&mut port, clock::now()), ["down: the adapter refuses 1000000 bit/s"]);
    assert_eq!(all(&adapter), "\rC\r");
    open_within(&mut port).unwrap();
    assert_eq!(on_line(&adapter, OPENING), OPENING);
    say(&adapter, "\r\x07");
    assert_eq!(drain(&mut port, clock::now()), ["down: the adapter does not open its channel"]);
    assert_eq!(all(&adapter), "\rC\r");
    open_within(&mut port).unwrap();
    say(&adapter, "\r\rsb000255\r");
    let off = "Health(Health { state: Off, transmit_errors: 255, receive_errors: 0 })";
    assert_eq!(drain(&mut port, clock::now()), [off, "down: bus-off"]);
    let went_off = clock::now();
    assert!(open_within(&mut port).unwrap_err().ends_with(": bus-off"));
    open_within(&mut port).unwrap();
    assert!(clock::now().since(went_off) >= Duration::from_millis(95), "restarted with a pause");
    drop(adapter);
    assert!(drain(&mut port, clock::now())[0].starts_with("down: "));
    assert!(matches!(port.state, PortState::Down { .. }));
    assert!(open_within(&mut port).unwrap_err().contains("/dev/pts/"));
}

#[test]
fn an_unsupported_bit_rate_is_rejected() {
    let why = CanSlcan::new("/dev/null".into(), 83_333).open().unwrap_err();
    assert_eq!(why, "/dev/null: the slcan protocol has no 83333 bit/s");
}

#[test]
fn unsent_frames_wait_in_order_for_a_limited_time() {
    let (adapter, mut port) = joined();
    let now = clock::now();
    let frame = |n: u16| Output::Can(Frame::standard(n, &[0; 8]));
    let mut n = 0;
    while !port.device.wants_to_write() {
        assert_eq!(port.device.send(now, &frame(n)), Ok(true));
        n += 1;
    }
    for _ in 0..3 {
        assert_eq!(port.device.send(now, &frame(n)), Ok(true));
        n += 1;
    }
    let mut text = String::new();
    while port.device.wants_to_write() {
        text += &all(&adapter);
        port.device.on_writable(now).unwrap();
    }
    text += &all(&adapter);
    let ids: Vec<u16> = text.split_terminator('\r').map(|line| u16::from_str_radix(&line[1..4], 16).unwrap()).collect();
    assert_eq!(ids, (0..n).collect::<Vec<_>>());
    while !port.device.wants_to_write() {
        assert_eq!(port.device.send(now, &frame(7)), Ok(true));
    }
    assert_eq!(port.device.send(now, &frame(8)), Ok(true));
    let later = now + Duration::from_millis(51);
    while port.device.wants_to_write() {
        all(&adapter);
        port.device.on_writable(later).unwrap();
    }
    assert!(!all(&adapter).contains("t008"));
}
