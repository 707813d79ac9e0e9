//! Node of this project, with `master.py` as its master.

use super::bus::{Bus, PATIENCE, Script};
use super::store::Store;
use crate::support::workspace;
use base::Duration;
use canopen::eds::Eds;
use canopen::lss::BitRate;
use canopen::{Node, NodeEvent};

const ID: u8 = 5;
const BOOT: Duration = Duration::from_millis(50);

/// Node of the EDS file that the script also reads.
fn node() -> Node {
    let file = std::fs::read(workspace().join("advee/tests/it/canopen_peers/node.eds")).expect("node.eds");
    Node::new(Eds::parse(&file).expect("a good file").dictionary(ID), BOOT)
}

/// Application of the device: writing 0x2001 sends an emergency, and so does a lost heartbeat of the consumer. The time
/// of day is in 0x2004 (ms) and 0x2006 (days).
fn behave(node: &mut Node, event: NodeEvent) {
    match event {
        NodeEvent::ObjectWritten { index: 0x2001, .. } => {
            let [code_low, code_high, register, info] = (node.get(0x2001, 0).unwrap_or(0) as u32).to_le_bytes();
            node.emergency(u16::from_le_bytes([code_low, code_high]), register, [info, 2, 3, 4, 5]);
        }
        NodeEvent::HeartbeatLost { node: lost } => node.emergency(0x8130, 0x11, [lost, 0, 0, 0, 0]),
        NodeEvent::GuardLost => node.emergency(0x8130, 0x11, [0; 5]),
        NodeEvent::Time(time) => {
            node.set(0x2004, 0, i64::from(time.millis));
            node.set(0x2006, 0, i64::from(time.days));
        }
        _ => {}
    }
}

/// Runs the node for one of the exchanges of `master.py`, until that ends. The script prints `on` to power the node on.
fn serve(exchange: &str) {
    serve_node(exchange, node());
}

fn serve_node(exchange: &str, mut node: Node) {
    let mut bus = Bus::new();
    let Some(mut script) = Script::start("advee/tests/it/canopen_peers/master.py", &bus, &[exchange]) else { return };
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
fn every_nmt_command_of_python_canopen_is_executed() {
    serve("nmt");
}

#[test]
fn python_canopen_receives_heartbeats_at_the_period_it_sets_and_is_monitored_itself() {
    serve("heartbeat");
}

#[test]
fn python_canopen_guards_our_node_and_sends_it_the_time() {
    serve("guarding");
}

#[test]
fn python_canopen_finds_our_node_without_an_id_by_fastscan_and_gives_it_one() {
    const RATES: &[BitRate] = &[BitRate::Kbit1000, BitRate::Kbit500];
    serve_node("lss", node().with_lss(None, BitRate::Kbit1000, RATES));
}

#[test]
fn python_canopen_decodes_emergencies_and_reads_their_history() {
    serve("emergency");
}

#[test]
fn python_canopen_reads_and_writes_every_size_expedited_and_segmented() {
    serve("sdo");
}

/// Domains of up to 10 000 bytes, from 1 byte over every number of segments around the limits of blocks.
#[test]
fn python_canopen_reads_and_writes_blocks_of_every_size_with_crc_and_without() {
    let mut bus = Bus::new();
    let Some(mut script) = Script::start("advee/tests/it/canopen_peers/master.py", &bus, &["block"]) else { return };
    let mut store = Store::new(ID);
    while !script.is_over() {
        assert!(bus.now().as_nanos() < 3 * PATIENCE.as_nanos() as u64, "it does not end");
        bus.wait(store.poll_timeout());
        while let Some(frame) = bus.receive() {
            store.handle_rx(bus.now(), &frame);
            while let Some(frame) = store.poll_tx() {
                bus.send(frame);
            }
        }
        store.handle_timeout(bus.now());
    }
}

#[test]
fn python_canopen_gets_the_abort_code_of_each_refusal() {
    serve("aborts");
}

#[test]
fn python_canopen_remaps_pdos_and_exchanges_them_by_event_and_by_sync() {
    serve("pdo");
}
