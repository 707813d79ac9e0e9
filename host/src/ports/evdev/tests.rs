//! Gamepads of lines from files, FIFOs and sockets, and their coming and going.

use super::*;
use crate::clock;
use base::gamepad::{ABS_Y, Axis, BTN_TL, Button};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::unistd::mkfifo;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::atomic::{AtomicU32, Ordering};

const PAD: &str = "device A pad\naxis ABS_X 0 255 0 0 128\naxis ABS_Y 0 255 0 0 128\nbutton BTN_TL 0\nfound\n";

/// A folder for one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("advee-pad-{}-{number}", std::process::id()));
        fs::create_dir(&path).unwrap();
        Self(path)
    }

    fn path(&self) -> PathBuf {
        self.0.join("pad")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn port(folder: &Folder) -> Gamepad {
    let mut port = Gamepad::new(GamepadPlace::Stream(folder.path()), false);
    port.open().unwrap();
    port
}

/// Events of a device until it is silent for a while.
fn told(device: &mut dyn Device, millis: u16) -> String {
    let mut told = Vec::new();
    loop {
        match device.receive(clock::now()).unwrap() {
            Received::Nothing => {
                let mut fds = [PollFd::new(device.fd().unwrap(), PollFlags::POLLIN)];
                if poll(&mut fds, PollTimeout::from(millis)).unwrap() == 0 {
                    return told.join(", ");
                }
            }
            Received::Input { input: Input::Gamepad(input), .. } => told.push(match input {
                gamepad::Input::Found(device) => format!("found {}", device.name()),
                gamepad::Input::Gone => "gone".into(),
                gamepad::Input::Axis { code, value } => format!("abs {code} {value}"),
                gamepad::Input::Button { code, pressed } => format!("key {code} {}", u8::from(pressed)),
                gamepad::Input::Frame => "frame".into(),
            }),
            Received::Fault(fault, why) => told.push(format!("{} {why}", fault.name())),
            Received::Note(note) => told.push(format!("note {}", note.rsplit('/').next().unwrap_or_default())),
            Received::Input { input: other, .. } => panic!("{other:?}"),
        }
        assert!(told.len() < 1000, "{told:?}");
    }
}

#[test]
fn a_file_is_played_at_its_pace() {
    let folder = Folder::new();
    fs::write(folder.path(), format!("{PAD}key BTN_TL 1\nframe\nwait 0.1\nabs ABS_Y 0\nframe\nrubbish\ngone\n"))
        .unwrap();
    let mut port = port(&folder);
    let begin = clock::now();
    assert_eq!(told(&mut port, 30), "gone, found A pad, key 310 1, frame");
    assert!(clock::now().since(begin) < Duration::from_millis(100));
    assert_eq!(told(&mut port, 80), "abs 1 0, frame, MessageMalformed not a line of a gamepad: rubbish, gone");
    assert!(clock::now().since(begin) >= Duration::from_millis(100));
    assert_eq!(told(&mut port, 250), "", "once");
}

#[test]
fn a_fifo_is_a_gamepad_while_it_has_a_writer() {
    let folder = Folder::new();
    mkfifo(&folder.path(), Mode::S_IRWXU).unwrap();
    let mut port = port(&folder);
    assert_eq!(told(&mut port, 10), "gone");
    let writer = || OpenOptions::new().write(true).open(folder.path()).unwrap();
    let mut first = writer();
    first.write_all(PAD.as_bytes()).unwrap();
    first.write_all(b"key BTN_TL 1\nfr").unwrap();
    assert_eq!(told(&mut port, 10), "found A pad, key 310 1");
    first.write_all(b"ame\n").unwrap();
    assert_eq!(told(&mut port, 10), "frame");
    drop(first);
    assert_eq!(told(&mut port, 300), "gone", "and the port is quiet");
    let mut second = writer();
    second.write_all(PAD.as_bytes()).unwrap();
    assert_eq!(told(&mut port, 10), "found A pad");
}

#[test]
fn a_device_that_appears_later_is_found() {
    let folder = Folder::new();
    let mut port = port(&folder);
    assert_eq!(told(&mut port, 10), "gone");
    File::create(folder.0.join("other")).unwrap();
    assert_eq!(told(&mut port, 10), "", "only relevant changes trigger a search");
    let early = folder.0.join("early");
    fs::write(&early, PAD).unwrap();
    fs::rename(&early, folder.path()).unwrap();
    assert_eq!(told(&mut port, 10), "found A pad, gone");
}

#[test]
fn a_folder_that_is_not_there_is_a_port_that_is_down() {
    let mut port = Gamepad::new(GamepadPlace::Stream("/nowhere/pad".into()), false);
    assert_eq!(port.open(), Err("/nowhere: No such file or directory".into()));
    assert!(port.fd().is_none());
}

#[test]
fn endless_comments_do_not_block_other_ports() {
    let folder = Folder::new();
    fs::write(folder.path(), "#\n".repeat(200_000) + PAD).unwrap();
    let mut port = port(&folder);
    assert!(matches!(
        port.receive(clock::now()),
        Ok(Received::Input { input: Input::Gamepad(gamepad::Input::Gone), .. })
    ));
    let mut turns = 0;
    while let Received::Nothing = port.receive(clock::now()).unwrap() {
        turns += 1;
        let mut fds = [PollFd::new(port.fd().unwrap(), PollFlags::POLLIN)];
        assert_eq!(poll(&mut fds, PollTimeout::from(10_000_u16)), Ok(1), "it continues without a trigger");
    }
    // 64 reads of 1024 bytes, then others are served.
    assert_eq!(turns, 400_000 / (64 * 1024));
}

#[test]
fn a_file_that_is_not_an_event_device_is_reported() {
    let folder = Folder::new();
    fs::write(folder.path(), "").unwrap();
    let mut port = Gamepad::new(GamepadPlace::Device(folder.path()), false);
    port.open().unwrap();
    assert_eq!(told(&mut port, 10), "note pad: Not a typewriter, gone");
}

/// The simulator's end, and the driver's.
fn connected(folder: &Folder) -> (Hub, Gamepad) {
    let mut hub = Hub::new(folder.path());
    hub.open().unwrap();
    let port = port(folder);
    assert_eq!(told(&mut hub, 10), "");
    (hub, port)
}

fn send(hub: &mut Hub, event: Event) {
    assert_eq!(hub.send(clock::now(), &Output::Gamepad(event)), Ok(true));
}

fn pad() -> Event {
    let mut device = gamepad::Device::new("Hub's");
    device.add_axis(Axis { code: ABS_Y, min: -1, max: 1, fuzz: 0, flat: 0, value: 0 });
    device.add_button(Button { code: BTN_TL, pressed: false });
    Event::Found(Box::new(device))
}

#[test]
fn all_clients_receive_the_simulated_gamepad() {
    let folder = Folder::new();
    let (mut hub, mut first) = connected(&folder);
    assert_eq!(told(&mut first, 10), "gone");
    send(&mut hub, pad());
    send(&mut hub, Event::Axis { code: ABS_Y, value: -1 });
    send(&mut hub, Event::Frame);
    assert_eq!(told(&mut first, 10), "found Hub's, abs 1 -1, frame");
    let mut second = port(&folder);
    assert_eq!(told(&mut hub, 10), "");
    let mut found = None;
    while found.is_none() {
        if let Received::Input { input: Input::Gamepad(gamepad::Input::Found(device)), .. } =
            second.receive(clock::now()).unwrap()
        {
            found = device.axis(ABS_Y).copied();
        }
    }
    assert_eq!(found.unwrap().value, -1, "as it is now");
    send(&mut hub, Event::Gone);
    assert_eq!((told(&mut first, 10).as_str(), told(&mut second, 10).as_str()), ("gone", "gone"));
}

#[test]
fn a_simulator_that_ends_takes_its_gamepad_with_it_and_a_new_one_is_found() {
    let folder = Folder::new();
    let (mut hub, mut port) = connected(&folder);
    told(&mut port, 10);
    send(&mut hub, pad());
    assert_eq!(told(&mut port, 10), "found Hub's");
    drop(hub);
    assert_eq!(told(&mut port, 300), "gone");
    assert!(!folder.path().exists(), "nothing is left");
    let mut hub = Hub::new(folder.path());
    hub.open().unwrap();
    assert_eq!(told(&mut port, 10), "");
    assert_eq!(told(&mut hub, 10), "");
    send(&mut hub, pad());
    assert_eq!(told(&mut port, 10), "found Hub's");
}

#[test]
fn a_client_that_writes_acts_as_the_gamepad_until_it_hangs_up() {
    let folder = Folder::new();
    let (mut hub, _port) = connected(&folder);
    let mut player = UnixStream::connect(folder.path()).unwrap();
    player.write_all(format!("{PAD}key BTN_TL 1\nframe\n").as_bytes()).unwrap();
    assert_eq!(told(&mut hub, 10), "found A pad, key 310 1, frame");
    drop(player);
    assert_eq!(told(&mut hub, 10), "gone");
}

#[test]
fn a_client_that_does_not_read_is_disconnected_and_reconnects() {
    let folder = Folder::new();
    let (mut hub, mut port) = connected(&folder);
    told(&mut port, 10);
    send(&mut hub, pad());
    for n in 0..100_000 {
        send(&mut hub, Event::Axis { code: ABS_Y, value: n % 2 });
        if hub.clients.is_empty() {
            break;
        }
    }
    assert!(hub.clients.is_empty());
    let mut last = Vec::new();
    for _ in 0..1_000_000 {
        match port.receive(clock::now()).unwrap() {
            Received::Input { input: Input::Gamepad(gamepad::Input::Axis { .. }), .. } => {}
            Received::Input { input: Input::Gamepad(input), .. } => last.push(matches!(input, gamepad::Input::Gone)),
            Received::Nothing | Received::Fault(..) => break,
            _ => panic!(),
        }
    }
    assert_eq!(last.first(), Some(&false));
    // The truncated line is reported; then it reconnects and receives the current state of the gamepad.
    let rest = told(&mut port, 200);
    assert!(last.contains(&true) || rest.contains("gone"), "{last:?} {rest}");
    assert_eq!(told(&mut hub, 10), "");
    assert_eq!(told(&mut port, 10), "found Hub's");
}
