//! A node that is given its id by LSS.

use super::*;
use crate::dictionary::Entry;
use crate::lss::{Address, BitRate, Command, Event, Master, Mode, Timing, UNCONFIGURED};
use std::vec;

const ADDRESS: Address = Address { vendor: 0xFB, product: 7, revision: 2, serial: 0x1234 };

fn node(serial: i64, id: Option<u8>) -> Node {
    use Access::{Const, ReadWrite};
    use DataType::{U8, U32};
    let word = |sub, value| Entry::new(0x1018, sub, U32, Const, value);
    let objects = Dictionary::new(1)
        .with(&[
            Entry::new(0x1014, 0, U32, ReadWrite, 0x80).plus_node_id(),
            Entry::new(0x1018, 0, U8, Const, 4),
            word(1, ADDRESS.vendor.into()),
            word(2, ADDRESS.product.into()),
            word(3, ADDRESS.revision.into()),
            word(4, serial),
            Entry::new(0x2000, 0, U8, ReadWrite, 0).mappable(),
        ])
        .with_tpdo(1, 0x180, &[0x2000_0008], false);
    Node::new(objects, Duration::from_millis(5)).with_lss(id, BitRate::Kbit1000, &BitRate::ALL)
}

#[test]
fn a_node_without_id_is_silent_until_it_is_given_one() {
    check(
        &mut node(0x1234, None),
        "
         0ms > on
         0ms < state Initialising
        10ms > 000 01 00                        # nobody
        10ms > 601 40 00 10 00 00 00 00 00
        10ms > 6FF 40 00 10 00 00 00 00 00
        10ms > 701 R
        10ms > 080
        20ms > 7E5 4C 00 00 00 00 00 00 00      # who has no id?
        20ms < 7E4 50 00 00 00 00 00 00 00
        21ms > 7E5 5E 00 00 00 00 00 00 00      # not while waiting
        22ms > 7E5 04 01 00 00 00 00 00 00
        23ms > 7E5 5E 00 00 00 00 00 00 00
        23ms < 7E4 5E FF 00 00 00 00 00 00
        24ms > 7E5 11 05 00 00 00 00 00 00      # be 5
        24ms < 7E4 11 00 00 00 00 00 00 00
        30ms > 605 40 14 10 00 00 00 00 00      # not yet
        31ms > 7E5 04 00 00 00 00 00 00 00
        31ms < state Initialising
        36ms < 705 00
        36ms < state PreOperational
        40ms > 605 40 14 10 00 00 00 00 00      # 0x1014 follows
        40ms < 585 43 14 10 00 85 00 00 00
        41ms > 605 40 00 18 01 00 00 00 00      # and the PDOs
        41ms < 585 43 00 18 01 85 01 00 00
        42ms > 000 01 05
        42ms < 185 00
        42ms < state Operational
        43ms > 7E5 4C 00 00 00 00 00 00 00      # has one
        44ms > 7E5 04 01 00 00 00 00 00 00
        45ms > 7E5 11 06 00 00 00 00 00 00      # be 6 from the next reset on
        45ms < 7E4 11 00 00 00 00 00 00 00
        46ms > 7E5 04 00 00 00 00 00 00 00
        47ms > set 2000 0 1
        47ms < 185 01
        50ms > 000 82 05
        50ms < state Initialising
        55ms < 706 00
        55ms < state PreOperational
        60ms > 000 01 06
        60ms < 186 01
        60ms < state Operational
        61ms > on                               # nothing was stored
        61ms < state Initialising
        70ms > 7E5 4C 00 00 00 00 00 00 00
        70ms < 7E4 50 00 00 00 00 00 00 00
        ",
    );
}

#[test]
fn what_was_stored_is_there_after_power_off_and_can_be_taken_away() {
    check(
        &mut node(0x1234, Some(9)),
        "
         0ms > on
         0ms < state Initialising
         5ms < 709 00
         5ms < state PreOperational
        10ms > 7E5 04 01 00 00 00 00 00 00
        11ms > 7E5 11 05 00 00 00 00 00 00
        11ms < 7E4 11 00 00 00 00 00 00 00
        12ms > 7E5 13 00 04 00 00 00 00 00      # 125 kbit/s
        12ms < 7E4 13 00 00 00 00 00 00 00
        13ms > 7E5 17 00 00 00 00 00 00 00
        13ms < 7E4 17 00 00 00 00 00 00 00
        13ms < stored Some(5) Kbit125
        20ms > on
        20ms < state Initialising
        25ms < 705 00
        25ms < state PreOperational
        30ms > 7E5 04 01 00 00 00 00 00 00
        31ms > 7E5 11 FF 00 00 00 00 00 00      # have none
        31ms < 7E4 11 00 00 00 00 00 00 00
        32ms > 7E5 04 00 00 00 00 00 00 00
        33ms > 605 40 00 18 00 00 00 00 00      # still has it
        33ms < 585 4F 00 18 00 03 00 00 00
        34ms > 000 82 00
        34ms < state Initialising
        40ms > 7E5 4C 00 00 00 00 00 00 00
        40ms < 7E4 50 00 00 00 00 00 00 00
        ",
    );
}

#[test]
fn nothing_is_sent_while_the_bit_rate_changes_and_nothing_later() {
    check(
        &mut node(0x1234, Some(9)),
        "
         0ms > on
         0ms < state Initialising
         5ms < 709 00
         5ms < state PreOperational
        10ms > 000 01 00
        10ms < 189 00
        10ms < state Operational
        11ms > 7E5 04 01 00 00 00 00 00 00
        12ms > 7E5 13 00 02 00 00 00 00 00
        12ms < 7E4 13 00 00 00 00 00 00 00
        20ms > 7E5 15 32 00 00 00 00 00 00      # 50 ms
        30ms > set 2000 0 1
        40ms > 609 40 00 18 00 00 00 00 00
        70ms < rate Kbit500
       110ms > set 2000 0 2
       119ms > 7E5 5E 00 00 00 00 00 00 00
       120ms > 7E5 5E 00 00 00 00 00 00 00
       120ms < 7E4 5E 09 00 00 00 00 00 00
       130ms > set 2000 0 3
       130ms < 189 03
        ",
    );
}

/// All frames are heard by all, and those of one moment that are the same are one.
fn run(now: &mut Instant, master: &mut Master, nodes: &mut [Node], command: Command) -> Vec<Event> {
    master.start(*now, command).unwrap();
    let mut events = Vec::new();
    while !master.is_idle() {
        while let Some(request) = master.poll_tx() {
            let mut answers = Vec::new();
            for node in nodes.iter_mut() {
                node.handle_rx(*now, &request);
                node.handle_timeout(*now);
                answers.extend(core::iter::from_fn(|| node.poll_tx()));
            }
            answers.dedup();
            for answer in answers {
                master.handle_rx(*now, &answer);
            }
        }
        events.extend(core::iter::from_fn(|| master.poll_event()));
        if let Some(next) = master.poll_timeout() {
            *now = (*now).max(next);
            master.handle_timeout(*now);
            events.extend(core::iter::from_fn(|| master.poll_event()));
        }
    }
    // The last frame of a command may wait still.
    while let Some(request) = master.poll_tx() {
        nodes.iter_mut().for_each(|node| node.handle_rx(*now, &request));
    }
    events
}

#[test]
fn a_master_gives_every_node_that_has_none_its_id() {
    let mut now = Instant::from_millis(1);
    let mut master = Master::new(Timing::default());
    let mut nodes = [node(5, None), node(4, None), node(0x8000_0004, None), node(1, Some(77))];
    for node in &mut nodes {
        node.power_on(now);
    }
    now += Duration::from_millis(10);
    nodes.iter_mut().for_each(|node| node.handle_timeout(now));
    for node in &mut nodes {
        while node.poll_tx().is_some() {}
    }
    let waiting = Command::SwitchGlobal(Mode::Waiting);
    let mut next = 10;
    loop {
        let found = run(&mut now, &mut master, &mut nodes, Command::Find);
        let [Event::Found(_), Event::Done(_)] = found[..] else { break };
        for command in [Command::SetNodeId(next), Command::Store, waiting] {
            assert_eq!(run(&mut now, &mut master, &mut nodes, command), vec![Event::Done(command)]);
        }
        next += 1;
    }
    now += Duration::from_millis(10);
    nodes.iter_mut().for_each(|node| node.handle_timeout(now));
    assert_eq!(nodes.each_ref().map(Node::id), [11, 10, 12, 77]);
    assert!(nodes.iter().all(|node| node.nmt_state() == Some(NmtState::PreOperational)));
    let unheard = node(1, None);
    assert_eq!(unheard.id(), UNCONFIGURED);
}
