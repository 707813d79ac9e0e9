//! What all nodes are together: ready, or not; started one by one, or when all are there.

use super::*;

fn is_start(node: u8) -> impl Fn(&(Instant, Frame)) -> bool {
    move |(_, frame)| *frame == wire::nmt(NmtCommand::Start, node)
}

/// The robot, and a third node that is not needed.
fn three(config: MasterConfig) -> Bus {
    let optional = NodeConfig { mandatory: false, ..NodeConfig::new(3, "display") };
    let nodes = [
        epos::node_config("propulsion", &epos::parameters(1)),
        icla::node_config("steering", &icla::parameters(2)),
        optional,
    ];
    let dictionaries = [epos::dictionary(1), icla::dictionary(2), epos::dictionary(3)];
    let twins = dictionaries.into_iter().map(|objects| Node::new(objects, Duration::from_millis(5))).collect();
    Bus::new(Master::new(config, &nodes).unwrap(), twins)
}

#[test]
fn the_net_is_ready_when_all_mandatory_nodes_are_operational() {
    let mut bus = three(MasterConfig::default());
    bus.nodes[0].power_on(bus.now);
    bus.run_to(500, is_booted(1));
    bus.run(5000);
    assert!(!told(&bus, 0).contains(&Event::Ready));
    bus.nodes[1].power_on(bus.now);
    bus.run_to(3000, |event| *event == Event::Ready);
    assert_eq!(bus.master.state(2), Some(State::Operational));
    let from = bus.events.len();
    bus.nodes[0].power_off();
    bus.run_to(300, |event| *event == Event::NotReady);
    bus.run(5000);
    bus.nodes[0].power_on(bus.now);
    bus.run_to(3000, |event| *event == Event::Ready);
    // The one that is not needed comes and goes.
    bus.nodes[2].power_on(bus.now);
    bus.run_to(3000, is_booted(3));
    bus.nodes[2].power_off();
    bus.run_to(3000, |event| matches!(event, Event::Lost { node: 3, .. }));
    let ready = told(&bus, from).into_iter().filter(|event| matches!(event, Event::Ready | Event::NotReady));
    assert_eq!(ready.collect::<Vec<_>>(), [Event::NotReady, Event::Ready]);
}

#[test]
fn nodes_that_start_together_wait_for_the_mandatory_ones() {
    let mut bus = three(MasterConfig { together: true, ..MasterConfig::default() });
    bus.nodes[0].power_on(bus.now);
    bus.nodes[2].power_on(bus.now);
    bus.run(5000);
    assert_eq!([1, 3].map(|id| bus.master.state(id)), [Some(State::Booting(Step::Start)); 2]);
    assert!(![1, 2, 3].iter().any(|node| bus.sent.iter().any(is_start(*node))));
    bus.nodes[1].power_on(bus.now);
    bus.run_to(3000, |event| *event == Event::Ready);
    let starts: Vec<_> =
        [1, 2, 3].iter().map(|node| bus.sent.iter().find(|sent| is_start(*node)(sent)).unwrap().0).collect();
    assert_eq!(starts, [starts[0]; 3], "in one breath");
    // One that comes back later finds the others running.
    bus.nodes[0].power_on(bus.now);
    bus.run_to(1000, is_booted(1));
    // One that dies while it is held begins anew.
    bus.nodes[1].power_off();
    bus.run(2000);
    bus.nodes[0].power_on(bus.now);
    bus.run(1500);
    assert_eq!(bus.master.state(1), Some(State::Booting(Step::Start)));
    bus.nodes[0].power_off();
    bus.run_to(300, |event| {
        matches!(event, Event::BootFailed { node: 1, step: Step::Start, reason: BootError::NoHeartbeat })
    });
}
