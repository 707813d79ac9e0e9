//! Every single frame of a boot-up is lost once.

use super::*;

/// The robot boots with frame number `lost` lost; gives how many frames there were until both drives stand.
fn boot(lost: Option<usize>, change: &impl Fn(&mut NodeConfig)) -> usize {
    let mut configs =
        [epos::node_config("propulsion", &epos::parameters(1)), icla::node_config("steering", &icla::parameters(2))];
    configs.iter_mut().for_each(change);
    let twins = [epos::dictionary(1), icla::dictionary(2)];
    let twins = twins.into_iter().map(|objects| Node::new(objects, Duration::from_millis(5))).collect();
    let mut bus = Bus::new(Master::new(MasterConfig::default(), &configs).unwrap(), twins);
    bus.lost = lost;
    let now = bus.now;
    bus.nodes.iter_mut().for_each(|node| node.power_on(now));
    bus.run_to(8000, |event| *event == Event::Ready);
    let frames = bus.sent.len();
    bus.run(3000);
    // No set-point may leave before a node is booted, and none is sent here.
    assert!(!bus.sent.iter().any(|(_, frame)| matches!(Service::of(frame), Some(Service::Rpdo { .. }))));
    // Booted, or failed, told, and booted then.
    let events = told(&bus, 0);
    for node in [1, 2] {
        assert_eq!(bus.master.state(node), Some(State::Operational), "frame {lost:?}: {events:?}");
        let booted = events.iter().filter(|event| **event == Event::Booted { node }).count();
        let lost_events =
            events.iter().filter(|event| matches!(event, Event::Lost { node: of, .. } if *of == node)).count();
        assert_eq!(booted, lost_events + 1, "frame {lost:?}: {events:?}");
    }
    assert_eq!([0, 1].map(|at| bus.nodes[at].get(0x6060, 0)), [Some(3), Some(1)], "frame {lost:?}");
    assert_eq!(bus.nodes[0].get(0x1016, 1), Some(0x007F_00C8), "frame {lost:?}");
    assert_eq!([0, 1].map(|at| bus.nodes[at].nmt_state()), [Some(NmtState::Operational); 2], "frame {lost:?}");
    assert_eq!(bus.master.dropped(), 0);
    frames
}

#[test]
fn each_single_frame_of_a_boot_up_may_be_lost() {
    let frames = boot(None, &|_| ());
    assert!(frames > 100, "{frames} frames");
    for lost in 0..frames {
        boot(Some(lost), &|_| ());
    }
}

#[test]
fn each_single_frame_may_be_lost_where_nodes_are_not_reset() {
    let change = |config: &mut NodeConfig| config.reset = false;
    for lost in 0..boot(None, &change) {
        boot(Some(lost), &change);
    }
}
