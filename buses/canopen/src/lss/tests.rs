//! Frames typed from CiA 305's diagrams as manuals and other stacks show them; the master against slaves on a wire that
//! loses what it is told to.

use super::wire::{Bound, Confirm, FastScan, Request, Response};
use super::*;
use crate::testing::Random;
use base::can::Frame;
use base::{Duration, Instant};
use std::string::ToString;
use std::vec::Vec;
use std::{assert_eq, format, panic, vec};

const ALL_RATES: &[BitRate] = &BitRate::ALL;

fn config(address: Address) -> SlaveConfig {
    SlaveConfig { address, node_id: None, bit_rate: BitRate::Kbit1000, bit_rates: ALL_RATES, stores: true }
}

fn address(vendor: u32, product: u32, revision: u32, serial: u32) -> Address {
    Address { vendor, product, revision, serial }
}

#[test]
fn requests_and_responses_stand_on_the_wire_as_the_standard_says() {
    let number = 0x0403_0201;
    let scan = FastScan { number, bit_check: 31, sub: 1, next: 2 };
    for (request, data) in [
        (Request::SwitchGlobal(Mode::Configuration), [0x04, 1, 0, 0, 0, 0, 0, 0]),
        (Request::Select { part: Part::Vendor, number }, [0x40, 1, 2, 3, 4, 0, 0, 0]),
        (Request::Select { part: Part::Serial, number }, [0x43, 1, 2, 3, 4, 0, 0, 0]),
        (Request::SetNodeId(5), [0x11, 5, 0, 0, 0, 0, 0, 0]),
        (Request::SetBitTiming { table: 0, index: 4 }, [0x13, 0, 4, 0, 0, 0, 0, 0]),
        (Request::Activate { delay_ms: 1000 }, [0x15, 0xE8, 3, 0, 0, 0, 0, 0]),
        (Request::Store, [0x17, 0, 0, 0, 0, 0, 0, 0]),
        (Request::Inquire(Part::Vendor), [0x5A, 0, 0, 0, 0, 0, 0, 0]),
        (Request::Inquire(Part::Serial), [0x5D, 0, 0, 0, 0, 0, 0, 0]),
        (Request::InquireNodeId, [0x5E, 0, 0, 0, 0, 0, 0, 0]),
        (Request::Identify { bound: Bound::Vendor, number }, [0x46, 1, 2, 3, 4, 0, 0, 0]),
        (Request::Identify { bound: Bound::SerialHigh, number }, [0x4B, 1, 2, 3, 4, 0, 0, 0]),
        (Request::IdentifyNonConfigured, [0x4C, 0, 0, 0, 0, 0, 0, 0]),
        (Request::FastScan(scan), [0x51, 1, 2, 3, 4, 31, 1, 2]),
    ] {
        assert_eq!((request.encode(), Request::decode(&data)), (data, Some(request)));
    }
    let confirm = Confirm { error: 0xFF, specific: 7 };
    for (response, data) in [
        (Response::Selected, [0x44, 0, 0, 0, 0, 0, 0, 0]),
        (Response::NodeIdSet(confirm), [0x11, 0xFF, 7, 0, 0, 0, 0, 0]),
        (Response::BitTimingSet(confirm), [0x13, 0xFF, 7, 0, 0, 0, 0, 0]),
        (Response::Stored(confirm), [0x17, 0xFF, 7, 0, 0, 0, 0, 0]),
        (Response::Inquired { part: Part::Product, number }, [0x5B, 1, 2, 3, 4, 0, 0, 0]),
        (Response::NodeId(0xFF), [0x5E, 0xFF, 0, 0, 0, 0, 0, 0]),
        (Response::Identified, [0x4F, 0, 0, 0, 0, 0, 0, 0]),
        (Response::NonConfigured, [0x50, 0, 0, 0, 0, 0, 0, 0]),
    ] {
        assert_eq!((response.encode(), Response::decode(&data)), (data, Some(response)));
    }
    assert_eq!((Request::Store.frame().id(), Response::Selected.frame().id()), (id(0x7E5), id(0x7E4)));
    assert_eq!(Request::decode(&[0x17; 7]), None);
    assert_eq!(Request::decode(&[0x04, 2, 0, 0, 0, 0, 0, 0]), None);
    for specifier in [0x00, 0x05, 0x44, 0x45, 0x4D, 0x52, 0x5F, 0xFF] {
        assert_eq!(Request::decode(&[specifier; 8]), None);
    }
    assert_eq!(address(0xFB, 1, 2, 0x1234_5678).to_string(), "000000FB:00000001:00000002:12345678");
    assert_eq!(BitRate::ALL.map(|rate| BitRate::from_index(rate as u8)), BitRate::ALL.map(Some));
    assert_eq!([5, 10].map(BitRate::from_index), [None; 2]);
    assert_eq!(BitRate::from_kbits(125), Some(BitRate::Kbit125));
}

fn id(id: u16) -> base::can::Id {
    base::can::Id::Standard(id)
}

/// What a slave answers to each request.
fn ask(slave: &mut Slave, now: Instant, request: Request) -> Option<Response> {
    slave.handle_rx(now, &request.frame());
    let answer = slave.poll_tx().map(|frame| Response::decode(frame.data()).unwrap());
    assert_eq!(slave.poll_tx(), None);
    answer
}

#[test]
fn a_slave_hears_in_each_state_what_belongs_there() {
    let now = Instant::ZERO;
    let me = address(1, 2, 3, 4);
    let choose = Part::ALL.map(|part| Request::Select { part, number: me.words()[part as usize] });
    let range = [1, 2, 0, 9, 4, 4];
    let identify = Bound::ALL.map(|bound| Request::Identify { bound, number: range[bound as usize] });
    let [scan, bits] = [FastScan::RESET, 0].map(|bit_check| FastScan { number: 1, bit_check, sub: 0, next: 0 });
    let table: Vec<_> = [Mode::Waiting, Mode::Configuration]
        .into_iter()
        .map(|mode| {
            let mut heard = Vec::new();
            let mut probe = |name, requests: &[Request]| {
                let mut slave = Slave::new(config(me));
                ask(&mut slave, now, Request::SwitchGlobal(mode));
                let mut answers = Vec::new();
                for request in requests {
                    answers.extend(ask(&mut slave, now, *request));
                    while slave.poll_event().is_some() {
                        slave.stored(true);
                        answers.extend(slave.poll_tx().map(|frame| Response::decode(frame.data()).unwrap()));
                    }
                }
                assert!(answers.len() <= 2);
                if !answers.is_empty() {
                    heard.push(name);
                }
            };
            probe("select", &choose);
            probe("fastscan", &[Request::FastScan(scan), Request::FastScan(bits)]);
            probe("identify", &identify);
            probe("non-configured", &[Request::IdentifyNonConfigured]);
            probe("inquire", &[Request::Inquire(Part::Revision)]);
            probe("node-id?", &[Request::InquireNodeId]);
            probe("node-id", &[Request::SetNodeId(9)]);
            probe("rate", &[Request::SetBitTiming { table: 0, index: 2 }]);
            probe("store", &[Request::Store]);
            heard.join(" ")
        })
        .collect();
    assert_eq!(
        table,
        ["select fastscan identify non-configured", "identify non-configured inquire node-id? node-id rate store"]
    );
}

#[test]
fn a_slave_is_chosen_by_its_whole_address_in_order() {
    let now = Instant::ZERO;
    let me = address(1, 2, 3, 4);
    let select = |part: Part, number| Request::Select { part, number };
    let [v, p, r, s] = Part::ALL;
    for (steps, chosen) in [
        (vec![(v, 1), (p, 2), (r, 3), (s, 4)], true),
        (vec![(v, 1), (p, 2), (r, 3), (s, 5)], false),
        (vec![(v, 9), (p, 2), (r, 3), (s, 4)], false),
        (vec![(v, 1), (r, 3), (p, 2), (s, 4)], false),
        (vec![(s, 4)], false),
        (vec![(v, 1), (p, 9), (v, 1), (p, 2), (r, 3), (s, 4)], true),
        (vec![(v, 1), (v, 1), (p, 2), (r, 3), (s, 4)], true),
    ] {
        let mut slave = Slave::new(config(me));
        let answers: Vec<_> =
            steps.iter().filter_map(|(part, number)| ask(&mut slave, now, select(*part, *number))).collect();
        let (expected, mode): (&[_], _) =
            if chosen { (&[Response::Selected], Mode::Configuration) } else { (&[], Mode::Waiting) };
        assert_eq!((&answers[..], slave.mode()), (expected, mode), "{steps:?}");
    }
}

#[test]
fn each_setting_that_a_slave_refuses_has_its_code() {
    let now = Instant::ZERO;
    let rates = &[BitRate::Kbit500];
    let mut slave = Slave::new(SlaveConfig { bit_rates: rates, stores: false, ..config(address(1, 2, 3, 4)) });
    ask(&mut slave, now, Request::SwitchGlobal(Mode::Configuration));
    let mut error = |request| match ask(&mut slave, now, request) {
        Some(Response::NodeIdSet(how) | Response::BitTimingSet(how) | Response::Stored(how)) => how.error,
        other => panic!("{other:?}"),
    };
    assert_eq!([0, 1, 127, 128, 254, 255].map(|id| error(Request::SetNodeId(id))), [1, 0, 0, 1, 1, 0]);
    for (table, index, code) in [(0, 2, 0), (0, 0, 1), (0, 5, 1), (0, 10, 1), (1, 2, 1), (128, 2, 1)] {
        assert_eq!(error(Request::SetBitTiming { table, index }), code, "{table} {index}");
    }
    assert_eq!(error(Request::Store), 1);
}

#[test]
fn what_is_stored_survives_power_off_and_what_is_not_does_not() {
    let now = Instant::ZERO;
    let mut slave = Slave::new(config(address(1, 2, 3, 4)));
    let set = |slave: &mut Slave, id, index| {
        ask(slave, now, Request::SwitchGlobal(Mode::Configuration));
        ask(slave, now, Request::SetNodeId(id));
        ask(slave, now, Request::SetBitTiming { table: 0, index });
    };
    set(&mut slave, 7, 2);
    assert_eq!(ask(&mut slave, now, Request::Store), None);
    assert_eq!(slave.poll_event(), Some(SlaveEvent::Store { node_id: Some(7), bit_rate: BitRate::Kbit500 }));
    slave.stored(true);
    assert_eq!(slave.poll_tx(), Some(Response::Stored(Confirm::default()).frame()));
    slave.stored(true);
    assert_eq!(slave.poll_tx(), None);
    // The node id in use is still none; it changes when the slave is let go.
    assert_eq!(ask(&mut slave, now, Request::InquireNodeId), Some(Response::NodeId(0xFF)));
    ask(&mut slave, now, Request::SwitchGlobal(Mode::Waiting));
    assert_eq!((slave.poll_event(), slave.node_id()), (Some(SlaveEvent::NodeIdAssigned), None));
    assert_eq!((slave.activate_node_id(), slave.node_id()), (Some(7), Some(7)));
    set(&mut slave, 8, 3);
    slave.power_on();
    assert_eq!((slave.node_id(), slave.mode()), (Some(7), Mode::Waiting));
    // A medium that does not answer has failed, one that fails too.
    set(&mut slave, 8, 3);
    ask(&mut slave, now, Request::Store);
    let due = slave.poll_timeout().unwrap();
    slave.handle_timeout(due);
    let failed = Response::Stored(Confirm { error: 2, specific: 0 }).frame();
    assert_eq!((slave.poll_tx(), slave.poll_timeout()), (Some(failed), None));
    slave.power_on();
    assert_eq!(slave.node_id(), Some(7));
}

#[test]
fn a_slave_is_silent_before_and_after_it_switches_its_bit_rate() {
    let at = Instant::from_millis;
    let mut slave = Slave::new(config(address(1, 2, 3, 4)));
    ask(&mut slave, at(0), Request::SwitchGlobal(Mode::Configuration));
    ask(&mut slave, at(0), Request::SetBitTiming { table: 0, index: 4 });
    assert_eq!(ask(&mut slave, at(10), Request::Activate { delay_ms: 50 }), None);
    assert_eq!(slave.poll_event(), None);
    assert_eq!(ask(&mut slave, at(59), Request::InquireNodeId), None);
    assert_eq!(slave.poll_timeout(), Some(at(60)));
    slave.handle_timeout(at(60));
    assert_eq!((slave.poll_event(), slave.poll_timeout()), (Some(SlaveEvent::BitRate(BitRate::Kbit125)), None));
    assert!(slave.is_quiet(at(109)) && !slave.is_quiet(at(110)));
    assert_eq!(ask(&mut slave, at(109), Request::InquireNodeId), None);
    assert_eq!(ask(&mut slave, at(110), Request::InquireNodeId), Some(Response::NodeId(0xFF)));
}

/// A master and slaves on one wire. Identical frames of one moment are one frame: arbitration does not tell them apart.
struct Wire {
    now: Instant,
    master: Master,
    slaves: Vec<Slave>,
    /// Answers every request with "identified".
    hostile: bool,
    /// Number of frames crossed, and which of them is lost.
    frames: u32,
    lost: Option<u32>,
    events: Vec<Event>,
    /// How far the search was at each change, per mille.
    scanned: Vec<u32>,
}

impl Wire {
    fn new(addresses: &[Address]) -> Self {
        Self {
            now: Instant::from_millis(5),
            master: Master::new(Timing::default()),
            slaves: addresses.iter().map(|address| Slave::new(config(*address))).collect(),
            hostile: false,
            frames: 0,
            lost: None,
            events: Vec::new(),
            scanned: Vec::new(),
        }
    }

    fn arrives(&mut self) -> bool {
        self.frames += 1;
        self.lost != Some(self.frames - 1)
    }

    /// Runs a command to its end; gives its events, the last of which ends it.
    fn run(&mut self, command: Command) -> Vec<Event> {
        self.master.start(self.now, command).unwrap();
        let end = self.now + Duration::from_secs(120);
        while !self.master.is_idle() {
            assert!(self.now < end, "{command:?} does not end");
            if let Some(share) = self.master.scan_share() {
                self.scanned.push((share * 1000.0) as u32);
                self.scanned.dedup();
            }
            if let Some(request) = self.master.poll_tx() {
                if self.arrives() {
                    self.answer(&request);
                }
            } else if let Some(next) = self.master.poll_timeout() {
                self.now = self.now.max(next);
                self.master.handle_timeout(self.now);
            }
        }
        assert_eq!(self.master.poll_timeout(), None);
        while let Some(event) = self.master.poll_event() {
            self.events.push(event);
        }
        std::mem::take(&mut self.events)
    }

    fn answer(&mut self, request: &Frame) {
        let mut answers: Vec<Frame> = Vec::new();
        for slave in &mut self.slaves {
            slave.handle_rx(self.now, request);
            while let Some(event) = slave.poll_event() {
                match event {
                    SlaveEvent::NodeIdAssigned => drop(slave.activate_node_id()),
                    SlaveEvent::Store { .. } => slave.stored(true),
                    SlaveEvent::BitRate(_) => {}
                }
            }
            answers.extend(core::iter::from_fn(|| slave.poll_tx()));
        }
        if self.hostile {
            answers.push(Response::Identified.frame());
        }
        answers.dedup();
        for answer in answers {
            if self.arrives() {
                self.master.handle_rx(self.now, &answer);
            }
            while let Some(event) = self.master.poll_event() {
                self.events.push(event);
            }
        }
    }

    fn in_configuration(&self) -> Vec<usize> {
        (0..self.slaves.len()).filter(|at| self.slaves[*at].mode() == Mode::Configuration).collect()
    }
}

/// Slaves that differ much, little, and only in single bits at either end of a word.
fn crowds() -> Vec<Vec<Address>> {
    let same = |serial| address(0xFB, 0x7010, 0x2032_0000, serial);
    vec![
        vec![same(0x1234_5678)],
        vec![same(1), same(0)],
        vec![same(0x8000_0000), same(0x7FFF_FFFF)],
        vec![address(0, 0, 0, 0), address(u32::MAX, u32::MAX, u32::MAX, u32::MAX)],
        vec![same(5), same(4), same(7), address(0xFA, 0x7010, 0x2032_0000, 5), address(0xFB, 0x7010, 0x2032_0001, 5)],
    ]
}

#[test]
fn a_scan_finds_the_lowest_address_and_chooses_that_slave_only() {
    for addresses in crowds() {
        let mut wire = Wire::new(&addresses);
        let lowest = *addresses.iter().min().unwrap();
        assert_eq!(wire.run(Command::Find), [Event::Found(lowest), Event::Done(Command::Find)]);
        let chosen: Vec<_> = wire.in_configuration().into_iter().map(|at| addresses[at]).collect();
        assert_eq!(chosen, [lowest]);
        assert!(wire.now <= Instant::from_millis(5 + 2 + 133 * 20), "{:?}", wire.now);
        // It is seen to advance by each request, and is over at the last.
        assert_eq!((wire.scanned.len(), wire.scanned[0], wire.scanned[132]), (133, 0, 992));
        assert!(wire.scanned.is_sorted());
        assert_eq!(wire.master.scan_share(), None);
    }
}

#[test]
fn all_are_found_one_after_another_and_wait_again() {
    for mut addresses in crowds() {
        let mut wire = Wire::new(&addresses);
        addresses.sort();
        let mut expected: Vec<_> = addresses.into_iter().map(Event::Found).collect();
        expected.push(Event::Done(Command::FindAll));
        assert_eq!(wire.run(Command::FindAll), expected);
        assert_eq!(wire.in_configuration(), []);
        // And again: nobody was left unable to answer.
        assert_eq!(wire.run(Command::FindAll), expected);
    }
}

#[test]
fn whichever_frame_of_a_scan_is_lost_it_finds_who_is_there() {
    for addresses in crowds() {
        let mut undisturbed = Wire::new(&addresses);
        undisturbed.run(Command::Find);
        for lost in 0..undisturbed.frames {
            let mut wire = Wire::new(&addresses);
            wire.lost = Some(lost);
            let events = wire.run(Command::Find);
            let [Event::Found(found), Event::Done(_)] = events[..] else { panic!("frame {lost}: {events:?}") };
            // With one answer lost another slave may be found than the lowest, but never one that is not there.
            let chosen: Vec<_> = wire.in_configuration().into_iter().map(|at| addresses[at]).collect();
            assert_eq!(chosen, [found], "frame {lost}");
        }
    }
}

#[test]
fn whichever_frame_of_finding_all_is_lost_all_are_found() {
    let mut addresses = crowds().remove(4);
    addresses.truncate(3);
    let mut undisturbed = Wire::new(&addresses);
    undisturbed.run(Command::FindAll);
    for lost in 0..undisturbed.frames - 1 {
        let mut wire = Wire::new(&addresses);
        wire.lost = Some(lost);
        let events = wire.run(Command::FindAll);
        let found = |address| events.iter().filter(|event| **event == Event::Found(address)).count();
        assert_eq!(addresses.iter().map(|address| found(*address)).collect::<Vec<_>>(), [1; 3], "frame {lost}");
        assert_eq!((events.len(), events.last()), (4, Some(&Event::Done(Command::FindAll))), "frame {lost}");
        assert_eq!(wire.in_configuration(), [], "frame {lost}");
    }
}

#[test]
fn a_scan_ends_whoever_answers_or_does_not() {
    let mut empty = Wire::new(&[]);
    assert_eq!(empty.run(Command::Find), [Event::Failed(Command::Find, Failure::NoAnswer)]);
    assert_eq!(empty.run(Command::FindAll), [Event::Done(Command::FindAll)]);
    // One that answers everything has no bits; it cannot be two slaves.
    let mut wire = Wire::new(&[]);
    wire.hostile = true;
    let nothing = Address::default();
    assert_eq!(wire.run(Command::Find), [Event::Found(nothing), Event::Done(Command::Find)]);
    let failed = Event::Failed(Command::FindAll, Failure::Contradiction);
    assert_eq!(wire.run(Command::FindAll), [Event::Found(nothing), failed]);
    let mut crowd = Wire::new(&[address(1, 2, 3, 4)]);
    crowd.hostile = true;
    assert_eq!(crowd.run(Command::FindAll).last(), Some(&failed));
}

#[test]
fn answers_at_random_end_every_command() {
    let mut random = Random::new(7);
    let range = Range { vendor: 1, product: 2, revision: (0, 9), serial: (4, 4) };
    for round in 0..300_u64 {
        let command = [
            Command::FindAll,
            Command::Find,
            Command::Select(address(1, 2, 3, 4)),
            Command::Identify(range),
            Command::InquireAddress,
            Command::Store,
        ][random.below(6) as usize];
        let mut master = Master::new(Timing::default());
        let mut now = Instant::from_millis(round);
        master.start(now, command).unwrap();
        let mut ends = 0;
        let mut asked = 0;
        while let Some(next) = master.poll_timeout() {
            asked += core::iter::from_fn(|| master.poll_tx()).count();
            assert!(asked < 400_000, "{command:?}");
            if random.below(2) == 0 {
                let specifier = [0x4F, 0x4F, 0x44, 0x17, 0x5A, 0x5C, 0x50][random.below(7) as usize];
                let [_, b, c, d, e, f, g, h] = random.next().to_le_bytes();
                master.handle_rx(now, &Frame::standard(0x7E4, &[specifier, b & 1, c, d, e, f, g, h]));
            }
            now = now.max(next);
            master.handle_timeout(now);
            while let Some(event) = master.poll_event() {
                ends += u32::from(matches!(event, Event::Done(_) | Event::Failed(..)));
            }
            assert!(master.poll_timeout().is_none_or(|next| next > now));
        }
        while let Some(event) = master.poll_event() {
            ends += u32::from(matches!(event, Event::Done(_) | Event::Failed(..)));
        }
        assert_eq!(ends, 1, "{command:?}");
    }
}

#[test]
fn a_slave_is_chosen_asked_configured_and_kept() {
    let (me, other) = (address(1, 2, 3, 4), address(1, 2, 3, 5));
    let mut wire = Wire::new(&[other, me]);
    let done = |command| vec![Event::Done(command)];
    assert_eq!(wire.run(Command::IdentifyNonConfigured)[0], Event::Present(true));
    let range = |serial| Command::Identify(Range { vendor: 1, product: 2, revision: (3, 3), serial });
    assert_eq!(wire.run(range((4, 5)))[0], Event::Present(true));
    assert_eq!(wire.run(range((6, 9)))[0], Event::Present(false));
    let absent = Command::Select(address(9, 2, 3, 4));
    assert_eq!(wire.run(absent), [Event::Failed(absent, Failure::NoAnswer)]);
    assert_eq!(wire.run(Command::Select(me)), done(Command::Select(me)));
    assert_eq!(wire.in_configuration(), [1]);
    assert_eq!(wire.run(Command::InquireAddress), [Event::Address(me), Event::Done(Command::InquireAddress)]);
    assert_eq!(wire.run(Command::InquireNodeId), [Event::NodeId(None), Event::Done(Command::InquireNodeId)]);
    for command in [Command::SetNodeId(7), Command::SetBitRate(BitRate::Kbit500), Command::Store] {
        assert_eq!(wire.run(command), done(command));
    }
    let activate = Command::Activate { delay_ms: 100 };
    let before = wire.now;
    assert_eq!(wire.run(activate), [Event::SwitchNow, Event::Done(activate)]);
    assert_eq!(wire.now.since(before), Duration::from_millis(200));
    let at_once = Command::Activate { delay_ms: 0 };
    assert_eq!(wire.run(at_once), [Event::SwitchNow, Event::Done(at_once)]);
    let waiting = Command::SwitchGlobal(Mode::Waiting);
    assert_eq!(wire.run(waiting), done(waiting));
    assert_eq!([wire.slaves[0].node_id(), wire.slaves[1].node_id()], [None, Some(7)]);
    assert_eq!(wire.run(Command::FindAll), [Event::Found(other), Event::Done(Command::FindAll)]);
}

#[test]
fn refusals_are_told_by_name() {
    let mut wire = Wire::new(&[]);
    let slave = SlaveConfig { bit_rates: &[], stores: false, ..config(address(1, 2, 3, 4)) };
    wire.slaves.push(Slave::new(slave));
    wire.run(Command::SwitchGlobal(Mode::Configuration));
    let rate = Command::SetBitRate(BitRate::Kbit10);
    for (command, refusal) in [(rate, Refusal::BitRateNotSupported), (Command::Store, Refusal::StoreNotSupported)] {
        assert_eq!(wire.run(command), [Event::Failed(command, Failure::Refused(refusal))]);
    }
    for (command, specifier, error, refusal) in [
        (Command::SetNodeId(3), 0x11, 1, Refusal::NodeIdOutOfRange),
        (Command::Store, 0x17, 2, Refusal::StorageAccess),
        (Command::Store, 0x17, 0xFF, Refusal::Specific(9)),
        (rate, 0x13, 2, Refusal::Other(2)),
    ] {
        let mut master = Master::new(Timing::default());
        master.start(Instant::ZERO, command).unwrap();
        master.handle_rx(Instant::ZERO, &Frame::standard(0x7E4, &[specifier, error, 9, 0, 0, 0, 0, 0]));
        assert_eq!(master.poll_event(), Some(Event::Failed(command, Failure::Refused(refusal))), "{command:?}");
    }
}

#[test]
fn the_master_takes_one_command_at_a_time_and_no_wrong_node_id() {
    let now = Instant::ZERO;
    let mut master = Master::new(Timing::default());
    for id in [0, 128, 254] {
        assert_eq!(master.start(now, Command::SetNodeId(id)), Err(StartError::NodeId));
    }
    assert_eq!((master.poll_tx(), master.is_idle()), (None, true));
    assert_eq!(master.start(now, Command::Store), Ok(()));
    assert_eq!(master.start(now, Command::Store), Err(StartError::Busy));
    master.cancel();
    assert_eq!((master.poll_tx(), master.start(now, Command::InquireNodeId)), (None, Ok(())));
    // Neither is an answer to something else one, nor what is no answer at all.
    for data in [&[][..], &[0xFF; 8], &[0x5E, 5], &[0x5A, 1, 2, 3, 4, 0, 0, 0]] {
        master.handle_rx(now, &Frame::standard(0x7E4, data));
        master.handle_rx(now, &Frame::standard_remote(0x7E4, 8));
    }
    master.handle_rx(now, &Response::Stored(Confirm::default()).frame());
    assert_eq!((master.poll_event(), master.is_idle()), (None, false));
}

#[test]
fn one_slave_is_given_its_node_id() {
    let mut wire = Wire::new(&[address(0, 0, 0, 1)]);
    let said: Vec<_> = [Command::Find, Command::SetNodeId(5), Command::SwitchGlobal(Mode::Waiting)]
        .into_iter()
        .flat_map(|command| wire.run(command))
        .map(|event| format!("{event:?}"))
        .collect();
    assert_eq!(
        said,
        [
            "Found(Address { vendor: 0, product: 0, revision: 0, serial: 1 })",
            "Done(Find)",
            "Done(SetNodeId(5))",
            "Done(SwitchGlobal(Waiting))"
        ]
    );
    assert_eq!(wire.slaves[0].node_id(), Some(5));
}
