//! The master against nodes on a simulated wire.

mod boot;
mod configuration;
mod demand;
mod guarding;
mod hostile;
mod loss;
mod lost;
mod noise;
mod producers;
mod table;
mod together;
mod troubles;

use super::*;
use crate::drives::{epos, icla};
use crate::testing::{Bus, Engine, Random, check, parse};
use crate::{Dictionary, Event};
use crate::{NmtCommand, Node, Payload, sdo};
use base::Duration;
use std::vec;
use std::vec::Vec;

/// Both drives of the robot and their master; nodes are switched on.
fn robot(config: MasterConfig) -> Bus {
    let epos_parameters = epos::parameters(1);
    let icla_parameters = icla::parameters(2);
    let nodes = [epos::node_config("propulsion", &epos_parameters), icla::node_config("steering", &icla_parameters)];
    let master = Master::new(config, &nodes).unwrap();
    let boot_time = Duration::from_millis(5);
    let twins = vec![Node::new(epos::dictionary(1), boot_time), Node::new(icla::dictionary(2), boot_time)];
    let mut bus = Bus::new(master, twins);
    for node in &mut bus.nodes {
        node.power_on(bus.now);
    }
    bus
}

/// The robot with both drives Operational.
fn booted() -> Bus {
    let mut bus = robot(MasterConfig::default());
    bus.run(500);
    assert_eq!([1, 2].map(|id| bus.master.state(id)), [Some(State::Operational); 2], "{:#?}", bus.events);
    bus
}

fn is_booted(id: u8) -> impl Fn(&Event) -> bool {
    move |event| *event == Event::Booted { node: id }
}

/// Objects that the master began to write to a node since frame number `from`.
fn written(bus: &Bus, node: u8, from: usize) -> Vec<(u16, u8)> {
    let to_node = |frame: &Frame| Service::of(frame) == Some(Service::SdoRequest { node });
    let begun = |(_, frame): &(Instant, Frame)| match frame.data() {
        &[command, low, high, sub, ..] if to_node(frame) && command >> 5 == 1 => {
            Some((u16::from_le_bytes([low, high]), sub))
        }
        _ => None,
    };
    bus.sent[from..].iter().filter_map(begun).collect()
}

/// A master and one node, a twin of the EPOS; the node is switched on.
fn one(config: MasterConfig, node: NodeConfig, objects: Dictionary) -> Bus {
    let mut bus = Bus::new(Master::new(config, &[node]).unwrap(), vec![Node::new(objects, Duration::from_millis(5))]);
    bus.nodes[0].power_on(bus.now);
    bus
}

/// What was told since event number `from`.
fn told(bus: &Bus, from: usize) -> Vec<Event> {
    bus.events[from..].iter().map(|(_, event)| event.clone()).collect()
}
