//! The master against nodes on a simulated wire.

use super::*;
use crate::Node;
use crate::drives::{epos, icla};
use crate::testing::Bus;
use base::Duration;
use std::vec;

/// Both drives of the robot and their master; nodes are switched on.
pub(super) fn robot(config: MasterConfig) -> Bus {
    let epos_parameters = epos::Parameters::new(1);
    let icla_parameters = icla::Parameters::new(2);
    let nodes = [
        epos::node_config("propulsion", &epos_parameters),
        icla::node_config("steering", &icla_parameters),
    ];
    let master = Master::new(config, &nodes).unwrap();
    let boot_time = Duration::from_millis(5);
    let twins = vec![
        Node::new(epos::dictionary(1), boot_time),
        Node::new(icla::dictionary(2), boot_time),
    ];
    let mut bus = Bus::new(master, twins);
    for node in &mut bus.nodes {
        node.power_on(bus.now);
    }
    bus
}

pub(super) fn is_booted(id: u8) -> impl Fn(&Event) -> bool {
    move |event| *event == Event::Booted { node: id }
}

#[test]
fn both_drives_boot_and_take_pdos() {
    let mut bus = robot(MasterConfig::default());
    assert_eq!(
        bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)),
        Err(PdoError::NotOperational)
    );
    bus.run_to(500, is_booted(1));
    bus.run(200);
    assert_eq!(
        [1, 2].map(|id| bus.master.state(id)),
        [Some(State::Operational); 2],
        "{:#?}",
        bus.events
    );
    bus.master.send_pdo(1, 4, &epos::pack(0x0F, 1500)).unwrap();
    bus.run(1);
    assert_eq!(bus.nodes[0].get(0x60FF, 0), Some(1500));
    assert_eq!(bus.nodes[0].get(0x6040, 0), Some(0x0F));
}
