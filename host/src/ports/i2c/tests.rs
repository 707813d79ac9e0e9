//! Both ends of the simulator's socket; transfers in a thread.

use super::*;
use base::i2c::{Address, Bytes, Error, Read};
use nix::sys::socket::{AddressFamily, SockFlag, SockType, UnixAddr, connect, socket};
use std::fs;
use std::os::fd::AsRawFd;

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("advee-i2c-{}-{name}", std::process::id()))
}

fn read_register(register: u8) -> Transfer {
    let write = Bytes::from_slice(&[register]).unwrap();
    Transfer { address: Address::new(0x18).unwrap(), write, read: Read::Exactly(1) }
}

fn asked(server: &mut Server) -> Option<Transfer> {
    match server.receive(Instant::ZERO).unwrap() {
        Received::Input { input: Input::I2cRequested(transfer), .. } => Some(transfer.clone()),
        Received::Nothing => None,
        _ => panic!(),
    }
}

fn answer(server: &mut Server, outcome: Outcome) {
    assert_eq!(server.send(Instant::ZERO, &Output::I2cAnswer(outcome)), Ok(true));
}

fn came(master: &mut Socket) -> Option<Outcome> {
    match master.receive(Instant::ZERO).unwrap() {
        Received::Input { input: Input::I2c(outcome), .. } => Some(outcome.clone()),
        Received::Nothing => None,
        _ => panic!(),
    }
}

fn opened(path: &std::path::Path) -> (Server, Socket) {
    let (mut server, mut master) = (Server::new(path.into()), Socket::new(path.into()));
    server.open().unwrap();
    master.open().unwrap();
    (server, master)
}

#[test]
fn each_master_gets_its_own_outcomes_in_order() {
    let path = path("two");
    let (mut server, mut one) = opened(&path);
    let mut two = Socket::new(path.clone());
    two.open().unwrap();
    let ask = |master: &mut Socket, register| {
        assert_eq!(master.send(Instant::ZERO, &Output::I2c(read_register(register))), Ok(true));
    };
    ask(&mut one, 1);
    ask(&mut one, 2);
    ask(&mut two, 3);
    let all: Vec<Transfer> = std::iter::from_fn(|| asked(&mut server)).collect();
    let mut registers: Vec<u8> = all.iter().map(|transfer| transfer.write[0]).collect();
    for register in &registers {
        answer(&mut server, Ok(Bytes::from_slice(&[register + 0x10]).unwrap()));
    }
    registers.sort_unstable();
    assert_eq!(registers, [1, 2, 3]);
    let said = |master: &mut Socket| came(master).map(|outcome| outcome.unwrap()[0]);
    assert_eq!((said(&mut one), said(&mut one), said(&mut one)), (Some(0x11), Some(0x12), None));
    assert_eq!((said(&mut two), said(&mut two)), (Some(0x13), None));
    drop(server);
    assert!(one.receive(Instant::ZERO).is_err() && !path.exists());
    assert!(one.open().unwrap_err().contains("advee-i2c-"), "no server any more");
}

#[test]
fn a_master_that_disconnects_does_not_take_the_outcomes_of_others() {
    let path = path("gone");
    let (mut server, mut one) = opened(&path);
    let mut two = Socket::new(path);
    two.open().unwrap();
    one.send(Instant::ZERO, &Output::I2c(read_register(1))).unwrap();
    assert_eq!(asked(&mut server), Some(read_register(1)));
    two.send(Instant::ZERO, &Output::I2c(read_register(2))).unwrap();
    one.close();
    assert_eq!(asked(&mut server), Some(read_register(2)));
    answer(&mut server, Err(Error::Stuck));
    answer(&mut server, Err(Error::NoAddress));
    assert_eq!((came(&mut two), came(&mut two)), (Some(Err(Error::NoAddress)), None));
    answer(&mut server, Err(Error::Other));
}

#[test]
fn a_master_that_sends_an_invalid_transfer_is_disconnected_alone() {
    let path = path("bad");
    let (mut server, mut good) = opened(&path);
    let bad = socket(AddressFamily::Unix, SockType::SeqPacket, SockFlag::empty(), None).unwrap();
    connect(bad.as_raw_fd(), &UnixAddr::new(&path).unwrap()).unwrap();
    socket::write(&bad, &[0xFF; 300]).unwrap();
    assert!(matches!(server.receive(Instant::ZERO), Ok(Received::Fault(..))));
    assert!(socket::read(&bad).is_err());
    good.send(Instant::ZERO, &Output::I2c(read_register(7))).unwrap();
    assert_eq!(asked(&mut server), Some(read_register(7)));
}

#[test]
fn few_transfers_wait_and_few_masters_are_served() {
    let path = path("many");
    let (mut server, mut master) = opened(&path);
    let sent = (0..20).filter(|n| master.send(Instant::ZERO, &Output::I2c(read_register(*n))) == Ok(true)).count();
    assert_eq!(sent, module::OUTSTANDING);
    let mut more: Vec<Socket> = (0..20).map(|_| Socket::new(path.clone())).collect();
    more.iter_mut().for_each(|master| master.open().unwrap());
    assert_eq!(std::iter::from_fn(|| asked(&mut server)).count(), module::OUTSTANDING);
    let refused = more.iter_mut().map(|master| master.receive(Instant::ZERO)).filter(Result::is_err).count();
    assert_eq!(refused, 20 - 7);
}

#[test]
fn a_path_may_be_longer_than_the_address_of_a_socket() {
    let folder = path("long").join("x".repeat(120));
    fs::create_dir_all(&folder).unwrap();
    let (mut server, mut master) = opened(&folder.join("i2c-aux"));
    master.send(Instant::ZERO, &Output::I2c(read_register(7))).unwrap();
    assert_eq!(asked(&mut server), Some(read_register(7)));
    drop(server);
    fs::remove_dir_all(folder.parent().unwrap()).unwrap();
}

#[test]
fn the_note_about_a_refusal_precedes_the_outcome() {
    let mut bus = I2c::dev("/dev/i2c-none".into());
    let work = |_: Transfer| Ok((Err(Error::Other), Some("the adapter cannot".to_string())));
    bus.worker = Some(Worker::start("i2c", &mut bus.life, work).unwrap());
    assert_eq!(bus.send(Instant::ZERO, &Output::I2c(read_register(1))), Ok(true));
    let mut heard = Vec::new();
    while heard.len() < 2 {
        match bus.receive(Instant::ZERO).unwrap() {
            Received::Note(note) => heard.push(note),
            Received::Input { input: Input::I2c(outcome), .. } => heard.push(format!("{outcome:?}")),
            Received::Nothing => std::thread::yield_now(),
            _ => panic!(),
        }
    }
    assert_eq!(heard, ["the adapter cannot", "Err(Other)"]);
    assert!(matches!(bus.receive(Instant::ZERO), Ok(Received::Nothing)));
}
