//! Thermometers in a folder for one test.

use super::*;
use crate::ports::threaded::Threaded;
use crate::ports::{Device, Received};
use base::Instant;
use base::w1::{Error, Rom};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::fs;
use std::path::Path;

/// A folder for one test, removed at its end.
struct Made(PathBuf);

impl Made {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-w1-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        Self(path)
    }

    fn file(&self, name: &str, text: &[u8]) {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn temperature(&self) -> Result<i32, Error> {
        match read::answer(&self.0, Request::Temperature(rom())) {
            Answer::Temperature(of, said) if of == rom() => said,
            other => panic!("{other:?}"),
        }
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn rom() -> Rom {
    Rom::parse("28-0316a2795bff").unwrap()
}

fn ask(device: &mut dyn Device, request: Request) -> Answer {
    assert_eq!(device.send(Instant::ZERO, &Output::OneWire(request)), Ok(true));
    loop {
        if let Received::Input { input: Input::OneWire(answer), .. } = device.receive(Instant::ZERO).unwrap() {
            return answer.clone();
        }
        poll(&mut [PollFd::new(device.fd().unwrap(), PollFlags::POLLIN)], PollTimeout::NONE).unwrap();
    }
}

const GOOD: &[u8] = b"72 01 4b 46 7f ff 0e 10 57 : crc=57 YES\n72 01 4b 46 7f ff 0e 10 57 t=23125\n";

#[test]
fn temperatures_are_parsed_from_the_kernel_s_files() {
    let made = Made::new("good");
    made.file("28-0316a2795bff/w1_slave", GOOD);
    assert_eq!(made.temperature(), Ok(23_125));
    fs::remove_file(made.0.join("28-0316a2795bff/w1_slave")).unwrap();
    made.file("28-0316a2795bff/temperature", b"-10125\n");
    assert_eq!(made.temperature(), Ok(-10_125));
}

#[test]
fn damaged_missing_and_invalid_values_are_distinguished() {
    let made = Made::new("bad");
    assert_eq!(made.temperature(), Err(Error::Absent));
    for (text, error) in [
        (&b"72 01 4b 46 7f ff 0e 10 57 : crc=58 NO\n72 01 4b 46 7f ff 0e 10 57 t=23125\n"[..], Error::Crc),
        (b"", Error::Absent),
        (b"YES", Error::Nonsense),
        (b"YES\nt=", Error::Nonsense),
        (b"YES\nt=125001\n", Error::Nonsense),
        (b"YES\nt=99999999999999\n", Error::Nonsense),
        (b"\xFF\xFE", Error::Nonsense),
        (&[b'x'; 9999], Error::Nonsense),
    ] {
        made.file("28-0316a2795bff/w1_slave", text);
        assert_eq!(made.temperature(), Err(error), "{:?}", String::from_utf8_lossy(text));
    }
    // A folder in place of a file.
    fs::remove_file(made.0.join("28-0316a2795bff/w1_slave")).unwrap();
    fs::create_dir(made.0.join("28-0316a2795bff/w1_slave")).unwrap();
    assert_eq!(made.temperature(), Err(Error::Other));
}

#[test]
fn only_thermometers_are_listed_in_order_and_bounded() {
    let made = Made::new("list");
    let list = |made: &Made| match read::answer(&made.0, Request::List) {
        Answer::List(list) => list.iter().map(ToString::to_string).collect::<Vec<_>>(),
        other => panic!("{other:?}"),
    };
    assert!(list(&made).is_empty(), "no bus at all");
    for name in ["w1_bus_master1", "28-00000000000b", "26-000000000001", "10-000000000001", "28-00000000000A"] {
        made.file(&format!("{name}/id"), b"");
    }
    assert_eq!(list(&made), ["10-000000000001", "28-00000000000b"]);
    (0..40).for_each(|n| made.file(&format!("28-{n:012x}/id"), b""));
    assert_eq!(list(&made).len(), base::w1::MAX);
}

/// Waits until the folder's thread has written everything.
fn settle(folder: &mut Folder) {
    while folder.is_writing() {
        poll(&mut [PollFd::new(folder.fd().unwrap(), PollFlags::POLLIN)], PollTimeout::NONE).unwrap();
        assert!(matches!(folder.receive(Instant::ZERO), Ok(Received::Nothing)));
    }
}

#[test]
fn the_simulator_s_folder_is_read_like_the_kernel_s() {
    let made = Made::new("both");
    made.file("28-00000000000b/w1_slave", GOOD);
    let (mut folder, mut port) = (Folder::new(made.0.clone()), Threaded::new(Thermometers(made.0.clone())));
    folder.open().unwrap();
    port.open().unwrap();
    settle(&mut folder);
    assert_eq!(ask(&mut port, Request::List), Answer::List([].into_iter().collect()));
    let is = |folder: &mut Folder, answer| {
        assert_eq!(folder.send(Instant::ZERO, &Output::OneWireState(answer)), Ok(true));
        settle(folder);
    };
    is(&mut folder, Answer::List([rom()].into_iter().collect()));
    assert_eq!(ask(&mut port, Request::List), Answer::List([rom()].into_iter().collect()));
    for said in [Ok(21_500), Ok(85_000), Ok(-55_000), Err(Error::Crc), Err(Error::Nonsense), Err(Error::Absent)] {
        is(&mut folder, Answer::Temperature(rom(), said));
        assert_eq!(ask(&mut port, Request::Temperature(rom())), Answer::Temperature(rom(), said));
    }
    is(&mut folder, Answer::List([].into_iter().collect()));
    assert_eq!(ask(&mut port, Request::Temperature(rom())), Answer::Temperature(rom(), Err(Error::Absent)));
    drop(folder);
    assert!(!Path::new(&made.0).exists());
}

#[test]
fn superseded_values_are_not_written() {
    let made = Made::new("fast");
    let mut folder = Folder::new(made.0.clone());
    folder.open().unwrap();
    folder.send(Instant::ZERO, &Output::OneWireState(Answer::List([rom()].into_iter().collect()))).unwrap();
    for value in 0..1000 {
        let is = Output::OneWireState(Answer::Temperature(rom(), Ok(value)));
        assert_eq!(folder.send(Instant::ZERO, &is), Ok(true));
    }
    settle(&mut folder);
    assert_eq!(made.temperature(), Ok(999));
}
