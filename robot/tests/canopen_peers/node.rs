//! Our node, with `master.py` as its master.

use super::bus::{Bus, PATIENCE, Script};
use base::Duration;
use canopen::dictionary::{Access, DataType, Dictionary, Entry};
use canopen::{Node, NodeEvent};

const ID: u8 = 5;
const BOOT: Duration = Duration::from_millis(50);

/// What `node.eds` says.
fn dictionary() -> Dictionary {
    use Access::{Const, ReadOnly, ReadWrite, WriteOnly};
    use DataType::{Domain, I16, I32, Text, U8, U16, U32};
    let entry = Entry::new;
    Dictionary::new(ID)
        .with(&[
            entry(0x1000, 0, U32, ReadOnly, 0x191),
            entry(0x1001, 0, U8, ReadOnly, 0).mappable(),
            entry(0x1003, 0, U8, ReadWrite, 0),
            entry(0x1003, 1, U32, ReadOnly, 0),
            entry(0x1003, 2, U32, ReadOnly, 0),
            entry(0x1003, 3, U32, ReadOnly, 0),
            entry(0x1003, 4, U32, ReadOnly, 0),
            entry(0x1005, 0, U32, ReadWrite, 0x80),
            entry(0x1008, 0, Text, Const, 0).text("A node to be talked to by others"),
            entry(0x1012, 0, U32, ReadWrite, 0x8000_0100),
            entry(0x1014, 0, U32, ReadOnly, 0x80).plus_node_id(),
            entry(0x1016, 0, U8, ReadOnly, 2),
            entry(0x1016, 1, U32, ReadWrite, 0),
            entry(0x1016, 2, U32, ReadWrite, 0),
            entry(0x1017, 0, U16, ReadWrite, 0),
            entry(0x1018, 0, U8, ReadOnly, 4),
            entry(0x1018, 1, U32, ReadOnly, 0xFEED),
            entry(0x1018, 2, U32, ReadOnly, 0x8000_0001),
            entry(0x1018, 3, U32, ReadOnly, 0x0002_0003),
            entry(0x1018, 4, U32, ReadOnly, 0xC0FF_EE01),
            entry(0x2000, 0, Domain, ReadWrite, 0),
            entry(0x2001, 0, U32, ReadWrite, 0),
            entry(0x2002, 0, U8, ReadWrite, 0).mappable(),
            entry(0x2003, 0, I16, ReadWrite, 0).mappable(),
            entry(0x2004, 0, U32, ReadWrite, 0x1234_5678).mappable(),
            entry(0x2005, 0, I32, ReadWrite, -5).mappable().limits(-1000, 1000),
            entry(0x2006, 0, U16, Const, 4711),
            entry(0x2007, 0, U16, WriteOnly, 0),
        ])
        .with_rpdo(1, 0x200, &[0x2002_0008, 0x2003_0010], true)
        .with_rpdo(2, 0x300, &[0x2004_0020], true)
        .with_tpdo(1, 0x4000_0180, &[0x2002_0008, 0x2003_0010], true)
        .with_tpdo(2, 0xC000_0280, &[0x2004_0020], true)
}

/// What the device does: 0x2001 makes an emergency of what is written; the loss of a heartbeat is one.
fn behave(node: &mut Node, event: NodeEvent) {
    match event {
        NodeEvent::ObjectWritten { index: 0x2001, .. } => {
            let [code_low, code_high, register, info] = (node.get(0x2001, 0).unwrap_or(0) as u32).to_le_bytes();
            node.emergency(u16::from_le_bytes([code_low, code_high]), register, [info, 2, 3, 4, 5]);
        }
        NodeEvent::HeartbeatLost { node: lost } => node.emergency(0x8130, 0x11, [lost, 0, 0, 0, 0]),
        _ => {}
    }
}

/// Serves our node to one of the exchanges of `master.py`, until that ends. The script prints `on` to have the node
/// switched on.
fn serve(exchange: &str) {
    let mut bus = Bus::new();
    let Some(mut script) = Script::start("master.py", &bus, &[exchange]) else { return };
    let mut node = Node::new(dictionary(), BOOT);
    while !script.is_over() {
        assert!(bus.now().as_nanos() < PATIENCE.as_nanos() as u64, "{exchange} does not end");
        if script.heard().is_some_and(|line| line == "on") {
            node.power_on(bus.now());
        }
        bus.wait(node.poll_timeout());
        while let Some(frame) = bus.receive() {
            node.handle_rx(bus.now(), &frame);
            settle(&mut node, &mut bus);
        }
        node.handle_timeout(bus.now());
        settle(&mut node, &mut bus);
    }
}

fn settle(node: &mut Node, bus: &mut Bus) {
    while let Some(event) = node.poll_event() {
        behave(node, event);
    }
    node.handle_timeout(bus.now());
    while let Some(frame) = node.poll_tx() {
        bus.send(frame);
    }
}

#[test]
fn every_nmt_command_of_python_canopen_is_obeyed() {
    serve("nmt");
}

#[test]
fn python_canopen_sees_heartbeats_at_the_period_it_sets_and_is_watched_itself() {
    serve("heartbeat");
}

#[test]
fn python_canopen_decodes_emergencies_and_reads_their_history() {
    serve("emergency");
}

#[test]
fn python_canopen_reads_and_writes_every_size_expedited_and_segmented() {
    serve("sdo");
}

#[test]
fn python_canopen_gets_the_abort_code_of_each_refusal() {
    serve("aborts");
}

#[test]
fn python_canopen_remaps_pdos_and_exchanges_them_by_event_and_by_sync() {
    serve("pdo");
}
