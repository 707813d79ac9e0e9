//! The master on a wired-AND bus, level by level: transcripts after UM10204, and what goes wrong.

use super::*;
use crate::testing::{Bench, Random, bytes, transfer};
use base::i2c::{Address, Bytes};
use std::string::String;

fn row(text: &str) -> String {
    text.chars().filter(|c| !c.is_whitespace()).collect()
}

fn check_levels(bench: &Bench, scl: &str, sda: &str) {
    assert_eq!(bench.levels(), (row(scl), row(sda)), "\n{}\n{}", bench.levels().0, bench.levels().1);
}

const QUICK: Read = Read::None;

/// UM10204 figures 5 (START, STOP), 4 (bits change while SCL is low), 6 (ninth clock): address 0x18, write, ACK.
#[test]
fn start_address_acknowledge_and_stop_level_by_level() {
    let mut bench = Bench::standard();
    assert_eq!(bench.run(transfer(0x18, &[], QUICK)), Ok(bytes(&[])));
    check_levels(
        &bench,
        // free S  0  0  1   1  0   0  0  W  A  P
        "  -    -  _- _- __- _- __- _- _- _- _- __- -",
        "  -    _  __ __ _-- -- -__ __ __ __ __ -__ -",
    );
}

/// As above; nobody pulls SDA in the ninth clock.
#[test]
fn nobody_acknowledges_level_by_level() {
    let mut bench = Bench::standard();
    assert_eq!(bench.run(transfer(0x19, &[0x55], Read::None)), Err(Error::NoAddress));
    check_levels(
        &bench,
        // free S  0  0  1   1  0   0  1   W   N   P
        "  -    -  _- _- __- _- __- _- __- __- __- __- -",
        "  -    _  __ __ _-- -- -__ __ _-- -__ _-- -__ -",
    );
}

/// UM10204 figures 12 and 13: a read begins with a repeated START, and its last byte gets a NACK.
#[test]
fn a_repeated_start_and_a_read_level_by_level() {
    let mut bench = Bench::standard();
    bench.wire.slave.target.bytes[0x80] = 0x9F;
    assert_eq!(bench.run(transfer(0x18, &[0x80], Read::Exactly(1))), Ok(bytes(&[0x9F])));
    check_levels(
        &bench,
        // free S  0  0  1   1  0   0  0  W  A  1  0   0  0  0  0  0  0  A  Sr
        //         0  0  1   1  0   0  0  R    A  1  0  0  1  1  1  1  1  N  P
        "  -    -  _- _- __- _- __- _- _- _- _- _- __- _- _- _- _- _- _- _- _- -
                   _- _- __- _- __- _- _- __-  _- _- _- _- _- _- _- _- _- _- __- -",
        "  -    _  __ __ _-- -- -__ __ __ __ __ -- -__ __ __ __ __ __ __ __ -- _
                   __ __ _-- -- -__ __ __ _--  __ -- __ __ -- -- -- -- -- -- -__ -",
    );
}

#[test]
fn reads_and_writes_of_any_length_are_what_was_asked_for() {
    let mut random = Random::new(1);
    let mut bench = Bench::standard();
    for _ in 0..300 {
        let (write, read) = (random.below(36), random.below(37) as u8);
        let code = random.next() as u8;
        let data: Bytes = (0..write).map(|_| random.next() as u8).collect();
        let mut written = bytes(&[code]);
        written.extend(data.iter().copied());
        assert_eq!(bench.run(transfer(0x18, &written, Read::None)), Ok(bytes(&[])));
        let got = bench.run(transfer(0x18, &[code], Read::Exactly(read))).unwrap();
        assert_eq!(got.len(), usize::from(read));
        assert!(got.iter().zip(&data).all(|(got, data)| got == data));
    }
}

#[test]
fn each_refused_byte_is_named_and_the_bus_is_free_after_it() {
    let mut bench = Bench::standard();
    for at in 0..4 {
        bench.wire.slave.target.refuses = Some(at);
        assert_eq!(bench.run(transfer(0x18, &[1, 2, 3, 4], Read::Exactly(1))), Err(Error::NoData { at }));
        assert_eq!(bench.wire.levels(), Levels::HIGH);
        assert!(bench.symbols().ends_with("N P"), "{}", bench.symbols());
    }
}

#[test]
fn a_stretched_clock_is_waited_for() {
    let mut bench = Bench::standard();
    bench.wire.slave.stretch = Duration::from_millis(20);
    let begun = bench.now;
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])));
    // Before each of three ACKs of the target's.
    assert!(bench.now.since(begun) > Duration::from_millis(60));
    assert_eq!(bench.symbols(), "S 18W A 03 A Sr 18R A 9f N P");
}

#[test]
fn a_clock_held_for_too_long_ends_the_transfer_and_the_next_one_works() {
    let mut bench = Bench::standard();
    bench.wire.slave.stretch = Duration::from_millis(40);
    let begun = bench.now;
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Err(Error::Stretched));
    let took = bench.now.since(begun);
    assert!(took >= Duration::from_millis(35) && took < Duration::from_millis(36), "{took:?}");
    bench.wire.slave.stretch = Duration::ZERO;
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])));
}

#[test]
fn clocks_held_again_and_again_end_the_transfer() {
    let mut bench = Bench::standard();
    bench.wire.slave.stretch = Duration::from_millis(20);
    let begun = bench.now;
    // Nine acknowledges would be 180 ms.
    assert_eq!(bench.run(transfer(0x18, &[0; 8], Read::None)), Err(Error::Stretched));
    let took = bench.now.since(begun);
    assert!(took >= Duration::from_millis(140) && took < Duration::from_millis(170), "{took:?}");
    bench.wire.slave.stretch = Duration::ZERO;
    assert_eq!(bench.run(transfer(0x18, &[], QUICK)), Ok(bytes(&[])));
}

#[test]
fn a_master_that_was_away_while_the_clock_was_low_gives_up() {
    let (mut kept, mut gave_up) = (0, 0);
    for steps in 1..100 {
        let mut bench = Bench::standard();
        bench.request(0, transfer(0x18, &[3], Read::Exactly(1)));
        for _ in 0..steps {
            bench.step();
        }
        let low = !bench.wire.levels().scl;
        bench.pass(Duration::from_millis(26));
        while bench.step() {}
        let outcome = bench.masters[0].poll_event().unwrap();
        assert_eq!(outcome, if low { Err(Error::Stretched) } else { Ok(bytes(&[0x9F])) }, "{steps}");
        *if low { &mut gave_up } else { &mut kept } += 1;
        assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])), "{steps}");
    }
    assert!(kept > 30 && gave_up > 30);
}

#[test]
fn a_clock_that_is_never_released_is_stuck_and_gets_no_pulse() {
    let mut bench = Bench::standard();
    bench.held = Levels { scl: false, sda: true };
    bench.apply();
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Err(Error::Stuck));
    assert_eq!(bench.wire.sets, 0);
    bench.held = Levels::HIGH;
    bench.apply();
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])));
}

#[test]
fn data_that_is_never_released_gets_nine_clocks_and_is_stuck() {
    let mut bench = Bench::standard();
    bench.held = Levels { scl: true, sda: false };
    bench.apply();
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Err(Error::Stuck));
    check_levels(&bench, "- _- _- _- _- _- _- _- _- _-", "_ __ __ __ __ __ __ __ __ __");
    bench.held = Levels::HIGH;
    bench.apply();
    assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])));
}

/// A process that drives the lines may die at any moment: wherever it was, the next one's transfer works.
#[test]
fn wherever_a_master_stopped_the_next_one_frees_the_bus() {
    let (mut cuts, mut recovered) = (0, 0);
    loop {
        let mut bench = Bench::standard();
        bench.wire.slave.target.bytes[4..7].copy_from_slice(&[0x00, 0x0F, 0xA0]);
        bench.request(0, transfer(0x18, &[4], Read::Exactly(3)));
        for _ in 0..cuts {
            bench.step();
        }
        if bench.masters[0].poll_timeout().is_none() {
            break;
        }
        bench.restart();
        recovered += u32::from(!bench.wire.levels().sda);
        bench.pass(Duration::from_millis(1));
        assert_eq!(bench.run(transfer(0x18, &[3], Read::Exactly(1))), Ok(bytes(&[0x9F])), "cut at {cuts}");
        assert_eq!(bench.wire.levels(), Levels::HIGH);
        cuts += 1;
    }
    assert!(cuts > 150 && recovered > 30, "{cuts} {recovered}");
}

#[test]
fn recovery_is_clocks_until_sda_is_free_then_start_and_stop() {
    let mut bench = Bench::standard();
    bench.wire.slave.target.bytes[4] = 0x07;
    bench.request(0, transfer(0x18, &[4], Read::Exactly(1)));
    // Up to the ACK: the target holds SDA for it, and then for five zeros.
    while !bench.symbols().ends_with("18R A") {
        bench.step();
    }
    bench.restart();
    assert_eq!(bench.wire.levels(), Levels { scl: true, sda: false });
    assert_eq!(bench.run(transfer(0x18, &[], QUICK)), Ok(bytes(&[])));
    let (scl, sda) = bench.levels();
    // Six clocks, of which the last finds SDA high; START, STOP; then the transfer.
    let (clocks, data) = (row("- _- _- _- _- _- _- - _- -"), row("_ __ __ __ __ __ -- _ __ -"));
    assert!(scl.starts_with(&clocks) && sda.starts_with(&data), "\n{scl}\n{sda}");
    assert!(bench.symbols().ends_with("S P S 18W A P"), "{}", bench.symbols());
}

/// UM10204 3.1.8: two masters, bit by bit; who sends a one and sees a zero has lost, and the other does not notice.
#[test]
fn arbitration_is_lost_by_the_first_one_against_a_zero() {
    let cases: [(Transfer, Transfer); 4] = [
        (transfer(0x18, &[1, 0x10], Read::None), transfer(0x18, &[1, 0x11], Read::None)),
        (transfer(0x18, &[1], Read::None), transfer(0x1A, &[1], Read::None)),
        // The first goes on to write; the second wants a repeated START.
        (transfer(0x18, &[1, 0x00], Read::None), transfer(0x18, &[1], Read::Exactly(1))),
        // The first wants a second byte, the second has had enough.
        (transfer(0x18, &[1], Read::Exactly(2)), transfer(0x18, &[1], Read::Exactly(1))),
    ];
    for (wins, loses) in cases {
        for (first, second) in [(&wins, &loses), (&loses, &wins)] {
            let mut bench = Bench::new(&[Config::default(); 2]);
            bench.request(0, first.clone());
            bench.request(1, second.clone());
            while bench.step() {}
            let outcomes = [0, 1].map(|n| bench.masters[n].poll_event().unwrap());
            let lost = usize::from(*second == loses);
            assert_eq!(outcomes[lost], Err(Error::Arbitration), "{first:?} {second:?}");
            assert!(outcomes[1 - lost].is_ok(), "{first:?} {second:?}: {outcomes:?}");
            assert!(bench.symbols().ends_with('P') && !bench.symbols().contains('!'), "{}", bench.symbols());
        }
    }
}

#[test]
fn the_same_transfer_of_two_masters_is_one_on_the_bus() {
    let mut bench = Bench::new(&[Config::default(); 2]);
    for n in 0..2 {
        bench.request(n, transfer(0x18, &[3], Read::Exactly(1)));
    }
    while bench.step() {}
    assert_eq!([0, 1].map(|n| bench.masters[n].poll_event().unwrap()), [Ok(bytes(&[0x9F])), Ok(bytes(&[0x9F]))]);
    assert_eq!(bench.symbols(), "S 18W A 03 A Sr 18R A 9f N P");
}

#[test]
fn among_several_masters_one_waits_until_the_bus_is_free() {
    let config = Config { idle: Duration::from_micros(50), ..Config::default() };
    for steps in 1..120 {
        let mut bench = Bench::new(&[config; 2]);
        bench.request(0, transfer(0x18, &[0x20, 0x00, 0xFF, 0x55], Read::None));
        for _ in 0..steps {
            bench.step();
        }
        bench.request(1, transfer(0x18, &[0x21], Read::Exactly(1)));
        while bench.step() {}
        let outcomes = [0, 1].map(|n| bench.masters[n].poll_event().unwrap());
        assert_eq!(outcomes[0], Ok(bytes(&[])), "{steps}");
        assert_eq!(bench.wire.slave.target.bytes[0x20..0x23], [0x00, 0xFF, 0x55]);
        // Asked for within the 50 us before the first one's START, the second begins with it, and loses.
        let together = steps < 15 && outcomes[1] == Err(Error::Arbitration);
        assert!(together || outcomes[1] == Ok(bytes(&[0xFF])), "{steps}: {outcomes:?}");
    }
}

/// UM10204 table 10, per mode: t_HD;STA, t_LOW, t_HIGH, t_SU;STA, t_SU;DAT, t_SU;STO, t_BUF in ns. t_HD;DAT is 0 there,
/// and 300 ns in SMBus up to 2.0, which has 100 kHz.
#[test]
fn the_times_of_the_table_are_kept() {
    let modes = [
        (100_000, [4000, 4700, 4000, 4700, 250, 4000, 4700], 300),
        (400_000, [600, 1300, 600, 600, 100, 600, 1300], 300),
        (1_000_000, [260, 500, 260, 260, 50, 260, 500], 0),
    ];
    for (hz, [hd_sta, low, high, su_sta, su_dat, su_sto, buf], hd_dat) in modes {
        // Stretched clocks end anywhere between two looks.
        for stretch in (0..20_000).step_by(170) {
            let mut bench = Bench::new(&[Config { hz, ..Config::default() }]);
            bench.wire.slave.stretch = Duration::from_nanos(stretch);
            bench.request(0, transfer(0x18, &[0xA5, 0x5A], Read::Exactly(2)));
            while bench.step() {}
            bench.masters[0].poll_event().unwrap().unwrap();
            bench.request(0, transfer(0x18, &[], QUICK));
            while bench.step() {}
            let ns = Duration::from_nanos;
            // When each line last moved, and what the last edge of SDA with SCL high was.
            let (mut scl_at, mut sda_at) = (Instant::ZERO, Instant::ZERO);
            let mut stopped = None;
            for pair in bench.history.windows(2) {
                let ((_, old), (at, new)) = (pair[0], pair[1]);
                let (since_scl, since_sda) = (at.since(scl_at), at.since(sda_at));
                match (old.scl, new.scl) {
                    (true, false) => {
                        assert!(since_scl >= ns(high) || scl_at == Instant::ZERO, "{hz} high {since_scl:?}");
                    }
                    (false, true) => {
                        assert!(since_scl >= ns(low), "{hz} low {since_scl:?}");
                        assert!(since_sda >= ns(su_dat), "{hz} su;dat {since_sda:?}");
                    }
                    // SDA moves. What the target does happens in the moment of the edge, and is not ours.
                    (false, false) => {
                        assert!(since_scl.is_zero() || since_scl >= ns(hd_dat), "{hz} hd;dat {since_scl:?}");
                    }
                    (true, true) if !new.sda => {
                        let free = stopped.take().map_or(Duration::MAX, |stop| at.since(stop));
                        assert!(free >= ns(buf), "{hz} buf {free:?}");
                        assert!(since_scl >= ns(su_sta) || scl_at == Instant::ZERO, "{hz} su;sta {since_scl:?}");
                    }
                    (true, true) => {
                        assert!(since_scl >= ns(su_sto), "{hz} su;sto {since_scl:?}");
                        stopped = Some(at);
                    }
                }
                if (old.scl, new.scl, old.sda, old.sda != new.sda) == (true, false, false, false) && sda_at > scl_at {
                    assert!(since_sda >= ns(hd_sta), "{hz} hd;sta {since_sda:?}");
                }
                if old.scl != new.scl {
                    scl_at = at;
                }
                if old.sda != new.sda {
                    sda_at = at;
                }
            }
            assert!(stopped.is_some());
        }
    }
}

/// What no master can do without (docs/i2c.md): of each of nine clocks two edges and a look, and each change of SDA.
fn minimum(before: bool, bits: &[bool]) -> (u32, u32) {
    let mut sda = before;
    let changes = bits.iter().filter(|bit| core::mem::replace(&mut sda, **bit) != **bit).count() as u32;
    (bits.len() as u32 * 2 + changes, bits.len() as u32)
}

fn bits(byte: u8) -> impl Iterator<Item = bool> {
    (0..8).map(move |bit| byte << bit & 0x80 != 0)
}

#[test]
fn no_pin_is_touched_that_need_not_be() {
    let mut random = Random::new(5);
    for _ in 0..200 {
        let data: Bytes = (0..1 + random.below(20)).map(|_| random.next() as u8).collect();
        let read = random.below(6) as u8;
        let mut bench = Bench::standard();
        let transfer = transfer(0x18, &data, if read == 0 { Read::None } else { Read::Exactly(read) });
        bench.run(transfer).unwrap();
        // START: a look at the free bus, and an edge. SDA is low then.
        let (mut sets, mut gets) = (1, 1);
        let mut count = |(s, g): (u32, u32)| (sets, gets) = (sets + s, gets + g);
        let mut written = std::vec![];
        for byte in [0x30].iter().chain(&data) {
            // The ninth bit is the target's: released.
            written.extend(bits(*byte).chain([true]));
        }
        count(minimum(false, &written));
        if read > 0 {
            // Repeated START: SDA is released already; a clock, and an edge.
            count((3, 1));
            let mut asked: std::vec::Vec<bool> = bits(0x31).chain([true]).collect();
            for n in 1..=read {
                asked.extend([true; 8].into_iter().chain([n == read]));
            }
            count(minimum(false, &asked));
        }
        // STOP: SDA is high; it falls, a clock, it rises.
        count((4, 1));
        assert_eq!((bench.wire.sets, bench.wire.gets), (sets, gets));
    }
}

#[test]
fn what_the_caller_does_wrong_changes_nothing() {
    let mut master = Master::new(Config::default());
    let quick = transfer(0x18, &[], QUICK);
    assert_eq!(master.request(Instant::ZERO, transfer(0x18, &[], Read::Exactly(37))), Err(RequestError::TooLong));
    assert_eq!(
        master.request(Instant::ZERO, transfer(0x18, &[], Read::Block { extra: 4 })),
        Err(RequestError::TooLong)
    );
    assert_eq!(master.poll_timeout(), None);
    assert_eq!(master.request(Instant::ZERO, quick.clone()), Ok(()));
    assert_eq!(master.request(Instant::ZERO, quick), Err(RequestError::Busy));
}

#[test]
fn an_early_call_does_nothing() {
    let mut bench = Bench::standard();
    bench.request(0, transfer(0x18, &[1], Read::None));
    bench.step();
    let due = bench.masters[0].poll_timeout();
    for levels in [Levels::HIGH, Levels { scl: false, sda: false }] {
        assert_eq!(bench.masters[0].handle_timeout(bench.now, levels), None);
        assert_eq!(bench.masters[0].poll_timeout(), due);
    }
}

/// Lines that do what they like: no panic, one line at a time, an outcome in bounded time, and bounded work.
#[test]
fn whatever_the_lines_do_a_transfer_ends() {
    let mut random = Random::new(11);
    for round in 0..400 {
        let config = Config {
            hz: 1 + random.below(1_200_000) as u32,
            timeout: Duration::from_millis(random.below(40)),
            ..Config::default()
        };
        let mut master = Master::new(config);
        let seven = random.below(128) as u8;
        let read = match random.below(3) {
            0 => Read::None,
            1 => Read::Exactly(random.below(37) as u8),
            _ => Read::Block { extra: random.below(4) as u8 },
        };
        let write: Bytes = (0..random.below(37)).map(|_| random.next() as u8).collect();
        master.request(Instant::ZERO, Transfer { address: Address::new(seven).unwrap(), write, read }).unwrap();
        let (mut lines, mut steps) = (Levels::HIGH, 0u64);
        // Mostly obedient lines come further into a transfer than wild ones.
        let wild = 1 + random.below(300);
        while let Some(at) = master.poll_timeout() {
            let noise = random.below(wild) == 0;
            let levels = if noise { Levels { scl: random.below(2) == 0, sda: random.below(2) == 0 } } else { lines };
            if let Some(next) = master.handle_timeout(at, levels) {
                assert!(next.scl == lines.scl || next.sda == lines.sda, "one line at a time");
                lines = next;
            }
            steps += 1;
            assert!(steps < 2_000_000, "round {round}");
        }
        assert!(master.poll_event().is_some());
        assert_eq!((lines, master.poll_event()), (Levels::HIGH, None));
    }
}
