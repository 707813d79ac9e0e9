//! The fan controller and the thermometers as the simulator has them.

use super::*;
use base::i2c::{Bytes, Read};
use i2c::max6615::register;

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn rom(serial: u64) -> Rom {
    Rom::new(0x28, serial).unwrap()
}

fn address() -> Address {
    Address::new(0x18).unwrap()
}

fn made() -> Auxiliary {
    let i2c = [I2cConfig { bus: "i2c.aux".into(), hz: 100_000, fans: vec![("fan1".into(), address())] }];
    let thermometers = vec![(rom(1), "battery".into()), (rom(2), "cabin".into())];
    Auxiliary::new(&i2c, Some(&W1Config { bus: "w1".into(), thermometers, switches: Vec::new() }), None, Instant::ZERO)
}

fn transfer(write: &[u8], read: Read) -> Transfer {
    Transfer { address: address(), write: Bytes::from_slice(write).unwrap(), read }
}

fn read(all: &mut Auxiliary, now: Instant, register: u8) -> Outcome {
    all.on_asked(now, 0, &transfer(&[register], Read::Exactly(1)), None, false);
    all.poll_outcome(now).unwrap().1
}

fn said(all: &mut Auxiliary) -> Vec<Answer> {
    std::iter::from_fn(|| all.poll_w1()).collect()
}

#[test]
fn the_chip_answers_and_others_do_not() {
    let mut all = made();
    assert_eq!(read(&mut all, at(0), register::MANUFACTURER).unwrap()[..], [0x4D]);
    let other = Transfer { address: Address::new(0x19).unwrap(), ..transfer(&[0], Read::Exactly(1)) };
    all.on_asked(at(0), 0, &other, None, false);
    assert_eq!(all.poll_outcome(at(0)), Some((0, Err(Error::NoAddress))));
}

#[test]
fn where_there_is_no_wire_its_time_is_played_one_transfer_after_the_other() {
    let mut all = made();
    all.on_asked(at(0), 0, &transfer(&[0], Read::Exactly(1)), None, true);
    all.on_asked(at(0), 0, &transfer(&[0], Read::Exactly(1)), None, true);
    assert_eq!(all.poll_outcome(at(0)), None);
    assert_eq!(all.poll_timeout(), Instant::ZERO + Duration::from_micros(400));
    assert!(all.poll_outcome(all.poll_timeout()).is_some());
    assert_eq!(all.poll_timeout(), Instant::ZERO + Duration::from_micros(800));
    all.forget(0);
    assert_eq!(all.poll_timeout(), at(1000));
}

#[test]
fn faults_of_chips_and_thermometers_are_injected_and_end() {
    let mut all = made();
    let inject = |all: &mut Auxiliary, injected| assert!(all.inject(at(0), "fan1", injected, at(100)), "{injected:?}");
    inject(&mut all, InjectedFault::Hold);
    assert_eq!(read(&mut all, at(50), 0), Err(Error::Stuck));
    inject(&mut all, InjectedFault::None);
    inject(&mut all, InjectedFault::Silent);
    assert_eq!(read(&mut all, at(50), 0), Err(Error::NoAddress));
    inject(&mut all, InjectedFault::None);
    inject(&mut all, InjectedFault::Wrong);
    assert_eq!(read(&mut all, at(50), 0).unwrap()[..], [0xFF]);
    assert_eq!(read(&mut all, at(101), register::DEVICE).unwrap()[..], [0x68]);
    assert!(
        !all.inject(at(0), "fan1", InjectedFault::Clash, at(1))
            && !all.inject(at(0), "fan9", InjectedFault::Silent, at(1))
    );
    assert!(all.inject(at(200), "fan1", InjectedFault::Hot(95.0), at(9000)));
    assert_eq!(read(&mut all, at(1200), register::TEMPERATURE).unwrap()[..], [95]);
    assert_eq!(read(&mut all, at(9600), register::TEMPERATURE).unwrap()[..], [36]);
}

#[test]
fn thermometers_tell_what_changes_and_who_is_gone() {
    let mut all = made();
    all.on_w1_up(at(0));
    let both = Answer::List([rom(1), rom(2)].into_iter().collect());
    let first = [both.clone(), Answer::Temperature(rom(1), Ok(23_000)), Answer::Temperature(rom(2), Ok(36_000))];
    assert_eq!(said(&mut all), first);
    assert!(all.inject(at(100), "battery", InjectedFault::Silent, at(3000)));
    assert_eq!(said(&mut all)[..1], [Answer::List([rom(2)].into_iter().collect())]);
    all.handle_timeout(at(1000), 0.0);
    all.handle_timeout(at(2000), 0.0);
    assert!(!said(&mut all).iter().any(|answer| matches!(answer, Answer::List(_))));
    all.handle_timeout(at(3000), 0.0);
    let back = said(&mut all);
    assert!(back[0] == both && back[1..].contains(&Answer::Temperature(rom(1), Ok(23_000))), "{back:?}");
    assert!(all.inject(at(3000), "cabin", InjectedFault::Wrong, Instant::NEVER));
    assert!(said(&mut all).contains(&Answer::Temperature(rom(2), Err(w1::Error::Crc))));
}
