//! The driver against the emulated chip, and against what no chip would say.

use crate::bitbang::{self, Levels, Pins};
use crate::hal::Bus;
use crate::max6615::chip::Chip;
use crate::max6615::hal::FanController;
use crate::max6615::{ADDRESS, Config, Event, Invalid, Max6615, Mode, Reading, Why};
use crate::target::answer;
use crate::testing::{Random, address};
use crate::wire::Wire;
use base::i2c::{Error, Outcome, Read, Transfer};
use base::{Duration, Instant};
use embedded_hal::delay::DelayNs;
use std::cell::RefCell;
use std::rc::Rc;
use std::vec;
use std::vec::Vec;

fn config() -> Config {
    let mut config = Config::new(address(ADDRESS));
    config.limit_c = [70, 60];
    config.fans[0].minimum_rpm = 400.0;
    config.fans[0].rate = 0;
    config
}

/// A round with a bus that answers like this; transfers counted.
fn round(driver: &mut Max6615, mut bus: impl FnMut(&Transfer) -> Outcome) -> (Vec<Event>, usize) {
    driver.begin();
    let mut count = 0;
    while let Some(transfer) = driver.poll_transfer() {
        assert!(driver.poll_transfer().is_none(), "one at a time");
        driver.handle_outcome(&bus(&transfer));
        count += 1;
        assert!(count < 200, "a round ends");
    }
    let mut events = vec![];
    while let Some(event) = driver.poll_event() {
        events.push(event);
    }
    (events, count)
}

fn with(chip: &mut Chip) -> impl FnMut(&Transfer) -> Outcome {
    |transfer| answer(&mut [chip], transfer)
}

fn reading_of(events: &[Event]) -> Reading {
    match events {
        [.., Event::Reading(reading)] => *reading,
        other => panic!("{other:?}"),
    }
}

fn pair() -> (Max6615, Chip) {
    (Max6615::new(config()).unwrap(), Chip::new(address(ADDRESS), [2400.0; 2]))
}

#[test]
fn a_chip_is_found_configured_and_read() {
    let (mut driver, mut chip) = pair();
    let (events, _) = round(&mut driver, with(&mut chip));
    assert_eq!(events[0], Event::Found { revision: 1 });
    assert!(driver.is_ready());
    // Limits, count of 400 rpm, duty 20 %.
    assert_eq!([0x03, 0x04, 0x1A, 0x1B, 0x0B].map(|at| chip.read_register(at)), [70, 60, 144, 255, 48]);
    chip.set_temperature(0, 71.25);
    chip.advance(Instant::ZERO + Duration::from_secs(20));
    let (events, transfers) = round(&mut driver, with(&mut chip));
    let reading = reading_of(&events);
    assert_eq!((reading.temperature_c, reading.over, reading.failed), ([71.25, 20.0], [true, false], [false; 2]));
    assert_eq!((reading.duty, reading.rpm), ([0.2, 0.2], [480.0, 480.0]));
    // Two checks and fourteen registers.
    assert_eq!((events.len(), transfers), (1, 16));
    // The status was read with its temperature, so that it is of this second.
    chip.set_temperature(0, 30.0);
    chip.advance(Instant::ZERO + Duration::from_secs(21));
    round(&mut driver, with(&mut chip));
    chip.advance(Instant::ZERO + Duration::from_secs(22));
    assert_eq!(reading_of(&round(&mut driver, with(&mut chip)).0).over, [false; 2]);
}

#[test]
fn a_chip_that_forgot_is_configured_anew_in_the_same_round() {
    let (mut driver, mut chip) = pair();
    round(&mut driver, with(&mut chip));
    chip.reset();
    let (events, _) = round(&mut driver, with(&mut chip));
    assert!(matches!(events[..], [Event::Reset, Event::Reading(_)]), "{events:?}");
    assert_eq!([0x03, 0x0B].map(|at| chip.read_register(at)), [70, 48]);
}

#[test]
fn any_register_that_changes_is_found_within_as_many_rounds_as_there_are() {
    for at in [0x02, 0x03, 0x04, 0x0B, 0x0C, 0x0F, 0x11, 0x12, 0x13, 0x14, 0x17, 0x1A, 0x1B, 0x1C] {
        let (mut driver, mut chip) = pair();
        round(&mut driver, with(&mut chip));
        let was = chip.read_register(at);
        chip.write_register(at, was ^ 0x20);
        let told = (0..20).filter(|_| round(&mut driver, with(&mut chip)).0.contains(&Event::Reset)).count();
        assert_eq!((told, chip.read_register(at)), (1, was), "{at:02x}");
    }
}

#[test]
fn a_lost_chip_is_tried_three_times_told_once_and_found_again() {
    let (mut driver, mut chip) = pair();
    round(&mut driver, with(&mut chip));
    let gone = |_: &Transfer| Err(Error::NoAddress);
    assert_eq!(round(&mut driver, gone), (vec![Event::Lost(Why::Bus(Error::NoAddress))], 3));
    assert_eq!(round(&mut driver, gone), (vec![], 3));
    assert_eq!(driver.lost_by(), Some(Why::Bus(Error::NoAddress)));
    // Another reason is told.
    assert_eq!(round(&mut driver, |_| Err(Error::Stuck)).0, [Event::Lost(Why::Bus(Error::Stuck))]);
    let (events, _) = round(&mut driver, with(&mut chip));
    assert!(matches!(events[..], [Event::Found { .. }, Event::Reading(_)]), "{events:?}");
}

#[test]
fn one_or_two_failed_transfers_are_tried_again() {
    let (mut driver, mut chip) = pair();
    let mut turn = 0;
    let (events, _) = round(&mut driver, |transfer| {
        turn += 1;
        if turn % 3 == 0 { answer(&mut [&mut chip], transfer) } else { Err(Error::Arbitration) }
    });
    assert!(matches!(events[..], [Event::Found { .. }, Event::Reading(_)]), "{events:?}");
}

/// What an open bus reads: every bit one, and nobody refuses a byte where the adapter does not say so.
fn ones(transfer: &Transfer) -> Outcome {
    let count = if let Read::Exactly(count) = transfer.read { count } else { 0 };
    Ok((0..count).map(|_| 0xFF).collect())
}

#[test]
fn a_chip_that_answers_ff_is_lost() {
    let (mut driver, mut chip) = pair();
    assert_eq!(round(&mut driver, ones).0, [Event::Lost(Why::AllOnes)]);
    round(&mut driver, with(&mut chip));
    assert!(driver.is_ready());
    assert_eq!(round(&mut driver, ones).0, [Event::Lost(Why::AllOnes)]);
    assert!(round(&mut driver, ones).0.is_empty());
}

#[test]
fn another_chip_is_not_written_to() {
    let (mut driver, _) = pair();
    let (events, _) = round(&mut driver, |transfer| {
        assert_eq!(transfer.write.len(), 1, "nothing but a register's address");
        Ok([if transfer.write[0] == 0xFF { 0x41 } else { 0x20 }].into_iter().collect())
    });
    assert_eq!(events, [Event::Lost(Why::Foreign { manufacturer: 0x41, device: 0x20 })]);
}

#[test]
fn a_register_that_does_not_keep_its_value_is_named() {
    let (mut driver, mut chip) = pair();
    let (events, _) = round(&mut driver, |transfer| {
        if transfer.write[0] == 0x03 && transfer.write.len() == 2 {
            return Ok([].into_iter().collect());
        }
        answer(&mut [&mut chip], transfer)
    });
    assert_eq!(events, [Event::Lost(Why::Forgets { register: 0x03, wrote: 70, read: 0x6E })]);
}

#[test]
fn a_chip_that_is_now_one_and_now_another_ends_the_round() {
    let (mut driver, mut chip) = pair();
    let mut asked = 0;
    let (events, _) = round(&mut driver, |transfer| {
        // Right behind the manufacturer, wrong when it polls.
        asked += u32::from(transfer.write[..] == [0xFE]);
        if transfer.write[..] == [0xFE] && asked.is_multiple_of(2) {
            return Ok([0x69].into_iter().collect());
        }
        answer(&mut [&mut chip], transfer)
    });
    assert_eq!(events, [Event::Lost(Why::Foreign { manufacturer: 0x4D, device: 0x69 })]);
}

#[test]
fn a_duty_set_by_hand_reaches_the_fan_in_the_next_round() {
    let (mut driver, mut chip) = pair();
    round(&mut driver, with(&mut chip));
    driver.set_duty(1, 0.75).unwrap();
    let (events, _) = round(&mut driver, with(&mut chip));
    assert!(matches!(events[..], [Event::Reading(_)]), "{events:?}");
    assert_eq!([0x0B, 0x0C].map(|at| chip.read_register(at)), [48, 180]);
    assert_eq!(driver.set_duty(0, 1.5), Err(Invalid::Duty));
    assert_eq!(driver.set_duty(2, 0.5), Err(Invalid::Duty));
}

#[test]
fn an_automatic_fan_is_configured_and_follows() {
    let mut config = config();
    config.start_c = [30, 0];
    config.fans[0].mode = Mode::Automatic { follows: [true, false], start_duty: 0.4, maximum_duty: 0.75, step: 10 };
    let (mut driver, mut chip) = (Max6615::new(config).unwrap(), Chip::new(address(ADDRESS), [2400.0; 2]));
    chip.set_temperature(0, 34.0);
    let mut now = Instant::ZERO;
    let mut seconds = |driver: &mut Max6615, chip: &mut Chip, count: u64| {
        now += Duration::from_secs(count);
        chip.advance(now);
        round(driver, with(chip)).0
    };
    seconds(&mut driver, &mut chip, 0);
    let events = seconds(&mut driver, &mut chip, 5);
    // 96 + 4 x 10 of 240.
    assert_eq!(reading_of(&events).duty[0], 136.0 / 240.0);
    chip.set_temperature(0, 60.0);
    let events = seconds(&mut driver, &mut chip, 5);
    assert_eq!(reading_of(&events).duty[0], 0.75);
    assert!(!events.contains(&Event::Reset), "the chip's own target is not compared");
    chip.set_stalled(0, true);
    let events = seconds(&mut driver, &mut chip, 10);
    assert_eq!((reading_of(&events).failed, reading_of(&events).rpm[0]), ([true, false], 0.0));
}

#[test]
fn what_the_chip_cannot_do_is_refused() {
    let refused = |change: fn(&mut Config)| {
        let mut config = Config::new(address(ADDRESS));
        change(&mut config);
        Max6615::new(config).map(|_| ()).unwrap_err()
    };
    assert_eq!(refused(|c| c.fans[0].mode = Mode::Manual { duty: f64::NAN }), Invalid::Duty);
    fn automatic(follows: [bool; 2], step: u8) -> Mode {
        Mode::Automatic { follows, start_duty: 0.4, maximum_duty: 1.0, step }
    }
    assert_eq!(refused(|c| c.fans[1].mode = automatic([false; 2], 1)), Invalid::Follows);
    assert_eq!(refused(|c| c.fans[1].mode = automatic([true; 2], 16)), Invalid::Step);
    assert_eq!(refused(|c| c.fans[1].rate = 8), Invalid::Rate);
    assert_eq!(refused(|c| c.fans[1].minimum_rpm = 200.0), Invalid::MinimumRpm);
    assert_eq!(refused(|c| c.offset[0] = 8), Invalid::Offset);
}

/// Outcomes that nobody meant: no panic, and a round ends.
#[test]
fn whatever_comes_of_transfers_a_round_ends() {
    let mut random = Random::new(9);
    let (mut driver, mut chip) = pair();
    for _ in 0..3000 {
        let wild = 1 + random.below(60);
        round(&mut driver, |transfer| match random.below(wild) {
            0 => match random.below(3) {
                0 => Err(Error::Stretched),
                _ => Ok((0..random.below(37)).map(|_| random.next() as u8).collect()),
            },
            _ => answer(&mut [&mut chip], transfer),
        });
        // Outcomes without a transfer.
        driver.handle_outcome(&Err(Error::Other));
        if random.below(20) == 0 {
            chip.reset();
        }
    }
}

/// A wire that the pins and the delay of a blocking bus share.
#[derive(Clone)]
struct Shared(Rc<RefCell<Wire<Chip>>>);

impl Pins for Shared {
    fn set(&mut self, lines: Levels) -> Result<(), Error> {
        self.0.borrow_mut().set(lines)
    }

    fn get(&mut self) -> Result<Levels, Error> {
        self.0.borrow_mut().get()
    }
}

impl DelayNs for Shared {
    fn delay_ns(&mut self, ns: u32) {
        let mut wire = self.0.borrow_mut();
        let at = wire.now() + Duration::from_nanos(ns.into());
        wire.advance(at);
        wire.slave.target.advance(at);
    }
}

fn blocking() -> (Shared, Bus<Shared, Shared>) {
    let wire = Shared(Rc::new(RefCell::new(Wire::new(Chip::new(address(ADDRESS), [2400.0; 2])))));
    (wire.clone(), Bus::new(bitbang::Config::default(), wire.clone(), wire))
}

#[test]
fn the_embedded_hal_driver_reads_the_chip_over_two_pins() {
    let (mut wire, bus) = blocking();
    let mut fans = FanController::new(bus, config()).unwrap();
    fans.set_duty(1, 1.0).unwrap();
    fans.poll().unwrap();
    wire.delay_ms(5000);
    let reading = fans.poll().unwrap();
    assert_eq!((reading.temperature_c, reading.duty, reading.rpm[1]), ([20.0; 2], [0.2, 1.0], 2400.0));
    wire.0.borrow_mut().disturb(Levels { scl: true, sda: false });
    assert_eq!(fans.poll(), Err(Why::Bus(Error::Stuck)));
    wire.0.borrow_mut().disturb(Levels::HIGH);
    assert!(fans.poll().is_ok());
}

#[test]
fn the_blocking_bus_is_a_bus_of_embedded_hal() {
    use embedded_hal::i2c::{Error as _, ErrorKind, I2c, NoAcknowledgeSource, Operation};
    let (_, mut bus) = blocking();
    let mut read = [0; 2];
    bus.write_read(ADDRESS, &[0xFE], &mut read[..1]).unwrap();
    assert_eq!(read[0], 0x68);
    bus.write(ADDRESS, &[0x03, 0x21]).unwrap();
    let (mut first, mut second) = ([0], [0]);
    let operations = &mut [Operation::Write(&[0x03]), Operation::Read(&mut first), Operation::Read(&mut second)];
    bus.transaction(ADDRESS, operations).unwrap();
    assert_eq!((first, second), ([0x21], [0x21]));
    let nobody = bus.read(0x50, &mut read).unwrap_err();
    assert_eq!(nobody.kind(), ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
    let unsupported = [
        bus.write(ADDRESS, &[0; 37]).unwrap_err(),
        bus.read(ADDRESS, &mut [0; 37]).unwrap_err(),
        bus.transaction(ADDRESS, &mut [Operation::Read(&mut first), Operation::Write(&[1])]).unwrap_err(),
        bus.write(0x80, &[]).unwrap_err(),
    ];
    assert!(unsupported.iter().all(|error| *error == crate::hal::Error::Unsupported));
}

/// Pins of a kernel may fail, or a line may be gone.
#[test]
fn pins_that_fail_end_the_transfer_and_the_next_one_works() {
    struct Failing(Shared, u32);
    impl Pins for Failing {
        fn set(&mut self, lines: Levels) -> Result<(), Error> {
            self.0.set(lines)
        }
        fn get(&mut self) -> Result<Levels, Error> {
            self.1 = self.1.saturating_sub(1);
            if self.1 == 0 { Err(Error::Other) } else { self.0.get() }
        }
    }
    for fails in 1..40 {
        let (mut wire, _) = blocking();
        let mut master = bitbang::Master::new(bitbang::Config::default());
        let ask = Transfer { address: address(ADDRESS), write: [0xFF].into_iter().collect(), read: Read::Exactly(1) };
        let mut pins = Failing(wire.clone(), fails);
        let outcome = bitbang::perform(&mut master, ask.clone(), &mut pins, &mut wire);
        if outcome.is_ok() {
            assert!(fails > 36);
            continue;
        }
        assert_eq!(outcome, Err(Error::Other));
        pins.1 = u32::MAX;
        let outcome = bitbang::perform(&mut master, ask, &mut pins, &mut wire);
        assert_eq!(outcome.map(|read| read[0]), Ok(0x4D), "{fails}");
    }
}
