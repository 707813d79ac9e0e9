//! The bus itself, and engineers' access to objects.

use super::*;
use base::can::{BusState, Health, Notice};
use messages::lowlevel::{CmdSdo, DataBus, DataSdo, Node};

impl Robot {
    fn notice(&mut self, notice: Notice) {
        self.bench.event(Event::Port { port: PortId(0), input: Input::CanNotice(notice) });
        self.exchange();
    }

    fn bus(&self) -> &DataBus {
        self.bus.as_ref().expect("1 Hz")
    }

    fn told(&self, fault: Fault) -> Vec<Severity> {
        self.errors.iter().filter(|(told, _)| *told == fault).map(|(_, severity)| *severity).collect()
    }

    fn sdo(&mut self, node: i32, index: i32, subindex: i32, write: Option<&[u8]>) -> DataSdo {
        self.answers.clear();
        let data = write.unwrap_or_default().to_vec();
        self.bench.message(CmdSdo { timestamp: 0, request: 77, node, index, subindex, write: write.is_some(), data });
        self.pass(2);
        assert_eq!(self.answers.len(), 1, "one answer to one request");
        self.answers.remove(0)
    }
}

#[test]
fn load_frames_and_nodes_of_the_bus_are_published_each_second() {
    let mut robot = Robot::ready();
    robot.pass(1000);
    let before = robot.bus().clone();
    robot.drive(0.4, 1000);
    let bus = robot.bus();
    assert_eq!((bus.bus.as_str(), bus.state, bus.errors), ("can.main", DataBus::ACTIVE, 0));
    // 20 Hz of RPDO4, three heartbeats, and the drives' PDOs: about 100 frames of 100 bits at 1 Mbit/s.
    let frames = bus.frames - before.frames;
    assert!((60..400).contains(&frames), "{frames}");
    assert!(bus.load > 60e-6 * frames as f64 && bus.load < 135e-6 * frames as f64, "{} of {frames} frames", bus.load);
    let row = |node: &Node| (node.name.clone(), node.address, node.state, node.timeouts);
    let rows: Vec<_> = bus.nodes.iter().map(row).collect();
    assert_eq!(rows, [("propulsion".into(), 1, Node::OK, 0), ("steering".into(), 2, Node::OK, 0)]);
    assert!(bus.nodes.iter().all(|node| node.requests > 10));

    robot.icla.alive = false;
    robot.pass(3000);
    assert_eq!(robot.bus().nodes[1].state, Node::LOST);
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Down("unplugged") });
    robot.pass(1000);
    assert_eq!(robot.bus().state, DataBus::CLOSED);
}

#[test]
fn a_passive_controller_and_its_recovery_are_reported() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 300);
    let health = |state, transmit_errors| Notice::Health(Health { state, transmit_errors, receive_errors: 0 });
    robot.notice(health(BusState::Warning, 100));
    robot.pass(1000);
    assert_eq!((robot.bus().state, robot.told(Fault::CanPassive)), (DataBus::WARNING, vec![]));
    robot.notice(health(BusState::Passive, 130));
    robot.notice(health(BusState::Passive, 131));
    robot.pass(1000);
    assert_eq!((robot.bus().state, robot.told(Fault::CanPassive)), (DataBus::PASSIVE, vec![Severity::Warning]));
    robot.notice(health(BusState::Active, 0));
    robot.pass(1000);
    let told = vec![Severity::Warning, Severity::Notice];
    assert_eq!((robot.bus().state, robot.told(Fault::CanPassive)), (DataBus::ACTIVE, told));
}

#[test]
fn bus_off_is_reported_as_such_and_not_as_passive_first() {
    let mut robot = Robot::ready();
    robot.notice(Notice::Health(Health { state: BusState::Off, transmit_errors: 0, receive_errors: 0 }));
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Down("bus-off") });
    robot.pass(100);
    assert_eq!(robot.told(Fault::CanPassive), vec![]);
    assert_eq!(robot.told(Fault::PortDown), vec![Severity::Error]);
}

#[test]
fn a_missing_acknowledgement_stops_the_robot_and_nothing_resumes_by_itself() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 300);
    assert!(robot.moves());
    robot.notice(Notice::NoAcknowledge);
    assert!(!robot.moves());
    robot.drive(0.4, 400);
    assert_eq!(robot.reason(), "nobody on can.main acknowledges what is sent");
    robot.drive(0.4, 600);
    assert!(!robot.moves());
    assert_eq!(robot.told(Fault::CanUnacknowledged), [Severity::Error, Severity::Notice]);
    robot.drive(0.0, 50);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn errors_and_lost_frames_are_counted_and_a_bad_wire_reported_once() {
    let mut robot = Robot::ready();
    robot.pass(1000);
    for _ in 0..20 {
        robot.notice(Notice::Errors(5));
        robot.notice(Notice::Lost(1));
        robot.pass(100);
    }
    assert_eq!(robot.bus().errors, 120);
    robot.pass(2000);
    assert_eq!(robot.told(Fault::CanErrors), [Severity::Warning, Severity::Notice]);
    // Occasional errors are handled by the CRC.
    robot.notice(Notice::Errors(3));
    robot.pass(2000);
    assert_eq!(robot.told(Fault::CanErrors).len(), 2);
}

#[test]
fn an_engineer_reads_objects_of_the_drives_or_gets_the_abort_code() {
    let mut robot = Robot::ready();
    let answer = robot.sdo(1, 0x1018, 1, None);
    assert_eq!((answer.request, answer.node, answer.index, answer.subindex), (77, 1, 0x1018, 1));
    assert_eq!((answer.abort_code, answer.data), (0, vec![0xFB, 0, 0, 0]));
    // Objects that the driver itself reads at times.
    for (node, index, len) in [(1, 0x6041, 2), (2, 0x6064, 4), (1, 0x606C, 4)] {
        let answer = robot.sdo(node, index, 0, None);
        assert_eq!((answer.abort_code, answer.data.len()), (0, len), "0x{index:04X}");
    }
    assert_eq!(robot.sdo(2, 0x5FFF, 0, None).abort_code, 0x0602_0000);
    assert_eq!(robot.sdo(1, 0x6041, 9, None).abort_code, 0x0609_0011);
    for (node, index, sub) in [(0, 0x1000, 0), (128, 0x1000, 0), (1, 0x1_0000, 0), (1, -1, 0), (1, 0x1000, 256)] {
        assert!(robot.sdo(node, index, sub, None).abort_code != 0, "{node} {index:x}:{sub}");
    }
}

#[test]
fn an_engineer_writes_only_listed_objects_and_only_at_standstill() {
    let mut robot = Robot::ready();
    assert_eq!(robot.sdo(1, 0x6065, 0, Some(&[0x10, 0x27, 0, 0])).abort_code, 0);
    assert_eq!(robot.epos.node.get(0x6065, 0), Some(10_000));
    assert_eq!(robot.sdo(1, 0x1003, 0, Some(&[0])).abort_code, 0, "the error history");
    let ramp = robot.epos.node.get(0x6085, 0);
    // The same object of the other drive is not on its list.
    assert_eq!(robot.sdo(2, 0x6065, 0, Some(&[0, 1, 0, 0])).abort_code, 0x0800_0021);
    for (node, index, data) in [
        (1, 0x6040, &[0x0F, 0][..]),
        (1, 0x60FF, &[0, 1, 0, 0]),
        (2, 0x607A, &[0, 1, 0, 0]),
        (2, 0x6060, &[3]),
        (1, 0x1017, &[0, 0]),
        (1, 0x1016, &[0, 0, 0, 0]),
        (2, 0x1401, &[0, 0, 0, 0x80]),
        (1, 0x6085, &[60, 0, 0, 0]),
        (1, 0x6084, &[60, 0, 0, 0]),
        (1, 0x6083, &[60, 0, 0, 0]),
        (1, 0x607F, &[0, 1, 0, 0]),
        (2, 0x605A, &[0, 0]),
        (1, 0x2008, &[0, 0]),
        (1, 0x2210, &[0, 0]),
        (1, 0x1003, &[1]),
        (1, 0x1F50, &[0, 0, 0, 0]),
    ] {
        assert_eq!(robot.sdo(node, index, 0, Some(data)).abort_code, 0x0800_0021, "0x{index:04X}");
    }
    assert_eq!(robot.epos.node.get(0x6085, 0), ramp);
    robot.drive(0.4, 500);
    assert_eq!(robot.sdo(1, 0x6065, 0, Some(&[1, 0, 0, 0])).abort_code, 0x0800_0022);
    assert_eq!(robot.epos.node.get(0x6065, 0), Some(10_000));
    assert!(robot.moves(), "asking does not stop the robot: {}", robot.reason());
}

#[test]
fn more_requests_than_fit_are_refused_and_each_is_answered_once() {
    let mut robot = Robot::ready();
    robot.icla.alive = false;
    robot.answers.clear();
    for request in 0..100 {
        let index = 0x1000;
        robot.bench.message(CmdSdo { timestamp: 0, request, node: 2, index, ..CmdSdo::default() });
    }
    robot.pass(20_000);
    let mut requests: Vec<_> = robot.answers.iter().map(|answer| answer.request).collect();
    requests.sort_unstable();
    assert_eq!(requests, (0..100).collect::<Vec<_>>());
    assert!(robot.answers.iter().all(|answer| answer.abort_code != 0));
}

#[test]
fn time_is_sent_at_its_period_where_it_is_configured_and_never_without() {
    let is_time = |(_, frame): &&(Instant, can::Frame)| frame.id() == can::Id::Standard(0x100);
    let mut robot = Robot::ready();
    robot.pass(3000);
    assert_eq!(robot.frames.iter().filter(is_time).count(), 0);

    let mut robot = Robot::with(epos::dictionary(1), Config { time: Some(Duration::from_secs(1)), ..config() });
    robot.pass(5000);
    assert_eq!(robot.frames.iter().filter(is_time).count(), 6, "at the start, and once a second");
}

#[test]
fn time_is_that_of_the_messages() {
    // Noon of the 1st of June 2011: 28 bits of ms after midnight, days since 1984-01-01 (CiA 301, 7.2.6).
    let mut out = module::Actions::new(base::Epoch { offset_us: 1_306_929_600_000_000 });
    let mut canbus = Canbus::new(Config { time: Some(Duration::from_secs(1)), ..config() }).unwrap();
    let (start, later) = (Instant::ZERO, Instant::ZERO + Duration::from_secs(1));
    module::Module::handle(&mut canbus, start, Event::Start, &mut out);
    for (now, input) in [(start, Input::Up), (later, Input::CanNotice(Notice::Errors(0)))] {
        module::Module::handle(&mut canbus, now, Event::Port { port: PortId(0), input }, &mut out);
        module::Module::handle(&mut canbus, now, Event::Timer, &mut out);
    }
    let sent = out.drain().filter_map(|action| match action {
        Action::Send(_, Output::Can(frame)) => Some(frame).filter(|frame| frame.id() == can::Id::Standard(0x100)),
        _ => None,
    });
    let sent: Vec<Vec<u8>> = sent.map(|frame| frame.data().to_vec()).collect();
    // 43,200,000 ms and a second later; 10,013 days.
    assert_eq!(sent, [[0x00, 0x2E, 0x93, 0x02, 0x1D, 0x27], [0xE8, 0x31, 0x93, 0x02, 0x1D, 0x27]]);
}
