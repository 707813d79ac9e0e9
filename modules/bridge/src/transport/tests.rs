//! Two transports of one process, each with a bus of its own, joined by a TCP connection on the loopback interface.

use super::*;
use messages::{Message, lowlevel};
use std::fs;
use std::io::{ErrorKind, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Long enough for a loaded machine.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(20);

/// Two computers, without their modules.
struct Rig {
    folder: PathBuf,
    address: SocketAddr,
    urls: [String; 2],
}

impl Rig {
    fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("advee-bridge-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        for name in ["key", "other"] {
            key_file::create(&folder.join(name)).unwrap();
        }
        let address = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
        // Held together, so that they differ.
        let sockets = [(); 2].map(|()| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap());
        let urls = sockets.map(|socket| {
            let port = socket.local_addr().unwrap().port();
            format!("udpm://239.255.76.67:{port}?ttl=0&shm=auto")
        });
        Self { folder, address, urls }
    }

    /// The end of a computer: 0 listens, 1 connects.
    fn end(&self, n: usize, key: &str, send: &[&str], receive: &[&str]) -> Transport {
        self.end_at(n, self.address, key, send, receive)
    }

    fn end_at(&self, n: usize, address: SocketAddr, key: &str, send: &[&str], receive: &[&str]) -> Transport {
        let text = match n {
            0 => format!("listen = \"{address}\"\nkey_file = {key:?}"),
            _ => format!("connect = \"{address}\"\nkey_file = {key:?}"),
        };
        let node = ::settings::Node::parse(Path::new("robot.toml"), &text).unwrap();
        let list = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
        let link = settings::Link {
            name: format!("link{n}"),
            send: list(send),
            receive: list(receive),
            modules: vec!["camera".into()],
            ..::settings::read_as(&node).unwrap()
        };
        Transport::start(&[link], &self.folder, &self.urls[n], &[format!("module{n}")], Passes::All).unwrap()
    }

    fn bus(&self, n: usize) -> Bus {
        Bus::open(&self.urls[n], &["HL_.*", "LL_CMD_MOTION"]).unwrap()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

impl Drop for Transport {
    fn drop(&mut self) {
        self.end();
    }
}

#[track_caller]
fn until(what: &str, mut step: impl FnMut() -> bool) {
    let end = std::time::Instant::now() + PATIENCE;
    while !step() {
        assert!(std::time::Instant::now() < end, "not within {} s: {what}", PATIENCE.as_secs());
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

/// Channels of what has arrived.
fn arrived(bus: &mut Bus, seen: &mut Vec<String>) {
    while let Ok(Some(raw)) = bus.receive_raw() {
        seen.push(raw.channel.to_owned());
    }
}

fn status(transport: &Transport) -> Status {
    transport.shared().status().remove(0)
}

#[test]
fn what_both_ends_allow_crosses_and_a_lost_end_is_noticed_and_connects_again() {
    let rig = Rig::new("crosses");
    let near = rig.end(0, "key", &[], &["HL_DATA_FACES", "LL_CMD_MOTION"]);
    let sends = ["HL_DATA_*", "LL_CMD_MOTION", "LL_CMD_VELOCITY"];
    let far = rig.end(1, "key", &sends, &[]);
    let (mut here, mut there, mut seen) = (rig.bus(0), rig.bus(1), Vec::new());
    let command = Message::from(lowlevel::CmdMotion { source: "far".into(), ..Default::default() });
    let mut payload = Vec::new();
    command.encode(&mut payload).unwrap();
    let push = |channel: &str| {
        let (at, payload) = (clock::now(), payload.clone());
        far.shared().push(Outgoing { at, channel: channel.into(), module: None, stops: false, payload });
    };
    far.shared().set_modules(clock::now(), vec![("camera".into(), true)]);
    let count = |seen: &[String], channel: &str| seen.iter().filter(|other| *other == channel).count();
    until("messages cross", || {
        far.shared().set_modules(clock::now(), vec![("camera".into(), true)]);
        there.publish_raw("HL_DATA_SECRET", b"not accepted").unwrap();
        there.publish_raw("HL_DATA_FACES", b"faces").unwrap();
        push("LL_CMD_VELOCITY");
        push("LL_CMD_MOTION");
        push("LL_CMD_POWER");
        arrived(&mut here, &mut seen);
        count(&seen, "HL_DATA_FACES") > 5 && count(&seen, "LL_CMD_MOTION") > 5
    });
    assert!(seen.iter().all(|channel| ["HL_DATA_FACES", "LL_CMD_MOTION"].contains(&channel.as_str())), "{seen:?}");
    until("the module beyond the cable works", || {
        far.shared().set_modules(clock::now(), vec![("camera".into(), true)]);
        status(&near).up && status(&near).missing.is_empty()
    });
    let shown = status(&near);
    assert!(shown.counters.received > 5 && shown.counters.dropped > 0 && shown.counters.refused == 0, "{shown:?}");
    let clocks = shown.clocks.unwrap();
    assert!(clocks.offset_s.abs() <= clocks.round_trip_s, "one clock: {clocks:?}");

    // A list that is not renewed is void.
    until("the modules are not known", || status(&near).missing == ["camera"]);
    drop(far);
    until("the connection is lost", || !status(&near).up);
    let again = rig.end(1, "key", &["HL_DATA_*"], &[]);
    until("it is there again", || status(&near).up && status(&again).up);
}

#[test]
fn another_key_a_stranger_and_a_key_that_others_may_read_are_refused() {
    let rig = Rig::new("refuses");
    let near = rig.end(0, "key", &[], &["HL_DATA_FACES"]);
    let far = rig.end(1, "other", &["HL_DATA_FACES"], &[]);
    until("the other key is refused", || status(&far).counters.refused > 0);
    until("a stranger is refused", || {
        if let Ok(mut stranger) = TcpStream::connect(rig.address) {
            let _ = stranger.write_all(&[0x41; 100]);
        }
        status(&near).counters.refused > 0
    });
    assert!(!status(&near).up && !status(&far).up && status(&near).counters.received == 0);
    assert!(near.shared().take_notes().iter().any(|note| matches!(note, Note::Refused(..))));

    let path = rig.folder.join("key");
    fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o644)).unwrap();
    let link = settings::Link { key_file: "key".into(), ..link() };
    let refused = Transport::start(&[link], &rig.folder, &rig.urls[0], &[], Passes::All);
    assert!(refused.is_err_and(|why| why.contains("mode 0644")));
}

fn link() -> settings::Link {
    let node = ::settings::Node::parse(Path::new("robot.toml"), "connect = \"127.0.0.1:1\"\nkey_file = \"k\"");
    ::settings::read_as(&node.unwrap()).unwrap()
}

/// A cable: passes connections on to an address, until it is pulled. Then nothing crosses, and nothing is closed.
struct Cable {
    address: SocketAddr,
    pulled: Arc<AtomicBool>,
}

impl Cable {
    fn to(far: SocketAddr) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let (address, pulled) = (listener.local_addr().unwrap(), Arc::new(AtomicBool::new(false)));
        let is_pulled = pulled.clone();
        std::thread::spawn(move || {
            for near in listener.incoming() {
                let Ok((near, far)) = near.and_then(|near| Ok((near, TcpStream::connect(far)?))) else { continue };
                for (from, to) in [(near.try_clone(), far.try_clone()), (Ok(far), Ok(near))] {
                    let (from, to, is_pulled) = (from.unwrap(), to.unwrap(), is_pulled.clone());
                    std::thread::spawn(move || carry(from, to, &is_pulled));
                }
            }
        });
        Self { address, pulled }
    }
}

/// Carries bytes in one direction; what arrives while the cable is pulled is lost.
fn carry(mut from: TcpStream, mut to: TcpStream, is_pulled: &AtomicBool) {
    let mut bytes = [0; 4096];
    from.set_read_timeout(Some(std::time::Duration::from_millis(20))).unwrap();
    loop {
        match from.read(&mut bytes) {
            Ok(0) => break,
            Ok(_) if is_pulled.load(Relaxed) => {}
            Ok(count) if to.write_all(&bytes[..count]).is_ok() => {}
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => {}
            _ => break,
        }
    }
    if !is_pulled.load(Relaxed) {
        let _ = to.shutdown(std::net::Shutdown::Both);
    }
}

#[test]
fn a_pulled_cable_is_noticed_at_both_ends_and_messages_cross_when_it_is_back() {
    let rig = Rig::new("cable");
    let near = rig.end(0, "key", &[], &["HL_DATA_FACES"]);
    let cable = Cable::to(rig.address);
    let far = rig.end_at(1, cable.address, "key", &["HL_DATA_FACES"], &[]);
    let (mut here, mut there, mut seen) = (rig.bus(0), rig.bus(1), Vec::new());
    let mut cross = |seen: &mut Vec<String>, least: usize| {
        until("messages cross", || {
            there.publish_raw("HL_DATA_FACES", b"faces").unwrap();
            arrived(&mut here, seen);
            seen.len() > least
        });
    };
    cross(&mut seen, 5);

    cable.pulled.store(true, Relaxed);
    let pulled = clock::now();
    until("both ends notice it", || !status(&near).up && !status(&far).up);
    println!("a pulled cable was noticed within {} ms", clock::now().since(pulled).as_millis());
    cable.pulled.store(false, Relaxed);
    let before = seen.len();
    cross(&mut seen, before + 5);
    // A loss is no attack.
    assert_eq!(status(&far).counters.refused, 0);
}
