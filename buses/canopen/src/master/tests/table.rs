//! State × input → next state.

use super::*;

/// A node's states on the way up, each with the frames that lead there from the one before.
const WAY_UP: [(&str, &[&str]); 5] = [
    ("resetting", &[]),
    ("working", &["701 00"]),
    ("listening", &["581 43 00 10 00 92 01 02 00", "581 80 18 10 04 11 00 09 06", "581 4B 17 10 00 64 00 00 00"]),
    ("starting", &["701 7F"]),
    ("running", &["701 05"]),
];

/// A master whose node is `steps` states up; nothing waits to be sent or told.
fn climbed(steps: usize) -> Master {
    let config = MasterConfig { heartbeat: Duration::from_secs(60), ..MasterConfig::default() };
    let mut master = Master::new(config, &[NodeConfig::new(1, "propulsion")]).unwrap();
    master.handle_timeout(Instant::ZERO);
    for frame in WAY_UP[..=steps].iter().flat_map(|(_, frames)| *frames) {
        master.handle_rx(Instant::ZERO, &parse(&frame.split(' ').collect::<Vec<_>>()));
    }
    while master.poll_tx().is_some() || master.poll_event().is_some() {}
    master
}

/// State × input → next state, and what is sent.
#[test]
fn the_states_of_a_node_and_what_leads_from_one_to_the_next() {
    let inputs = ["701 00", "701 7F", "701 05", "701 04", "581 80 00 10 00 00 00 02 06", "time"];
    let mut table = Vec::new();
    for (steps, (name, _)) in WAY_UP.iter().enumerate() {
        for input in inputs {
            let mut master = climbed(steps);
            let before = master.state(1).unwrap();
            if input == "time" {
                let until = master.poll_timeout().unwrap();
                master.handle_timeout(until);
            } else {
                master.handle_rx(Instant::ZERO, &parse(&input.split(' ').collect::<Vec<_>>()));
            }
            let after = master.state(1).unwrap();
            let sent: Vec<_> = master.outputs();
            if before != after || !sent.is_empty() {
                let after = std::format!("{after:?}").replace("Booting", "");
                table.push(std::format!("{name}, {input}: {after} {}", sent.join("; ")));
            }
        }
    }
    let expected = "
resetting, 701 00: (DeviceType) 601 40 00 10 00 00 00 00 00
resetting, time: (DeviceType) 601 40 00 10 00 00 00 00 00
working, 701 00: (BootUp) 000 82 01
working, 581 80 00 10 00 00 00 02 06: Resting failed 1 device type: 0x1000:0 refused: object does not exist (0x06020000)
working, time: (DeviceType) 601 80 00 10 00 00 00 04 05; 601 40 00 10 00 00 00 00 00
listening, 701 00: (BootUp) 000 82 01
listening, 701 7F: (Start) 000 01 01
listening, 701 05: (Start) 000 01 01
listening, 701 04: (Start) 000 01 01
listening, time: Resting failed 1 error control: no heartbeat
starting, 701 00: (BootUp) 000 82 01
starting, 701 05: Operational booted 1; Ready
starting, time: (Start) 000 01 01
running, 701 00: (BootUp) 000 82 01; lost 1: booted by itself; NotReady
running, 701 7F: (BootUp) 000 82 01; lost 1: went to PreOperational; NotReady
running, 701 04: (BootUp) 000 82 01; lost 1: went to Stopped; NotReady
running, time: (BootUp) 000 82 01; lost 1: heartbeat missing; NotReady
";
    assert_eq!(table.join("\n"), expected.trim());
}
