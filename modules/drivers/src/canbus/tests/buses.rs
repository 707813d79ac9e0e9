//! Drives on two CAN buses, as nodes of the same id: one body.

use super::super::FurtherBus;
use super::*;
use canopen::Dictionary;
use canopen::dictionary::{Access, DataType, Entry};
use settings::robot::{Base, Differential, Layout};

const BUSES: [&str; 2] = ["can.main", "can.second"];
/// Their ports: nothing lies between them, as there is neither a GPIO nor a serial line.
const PORTS: [PortId; 2] = [PortId(0), PortId(1)];
/// RPDO4 of an EPOS with node 1, and the bit of its controlword that a quick stop clears.
const RPDO: can::Id = can::Id::Standard(0x501);
const NO_QUICK_STOP: u8 = 0x04;
const SYNC: can::Id = can::Id::Standard(0x80);

fn two(further: impl FnOnce(&mut FurtherBus), stop: Stop) -> Config {
    let mut second = FurtherBus {
        bus: "can.second".into(),
        bitrate: 250_000,
        node_id: 100,
        sync: None,
        time: None,
        axes: vec![Axis::Right],
    };
    further(&mut second);
    let drive = epos_with(2483.0);
    let wheel = |axis| PropulsionConfig { axis, node: 1, drive: drive.clone(), writable: Vec::new() };
    let layout = Layout::Differential(Differential { track_m: 0.42 });
    Config {
        base: Some(Base { layout, strain: 0.3 }),
        wheels: [Axis::Left, Axis::Right].map(wheel).into(),
        steering: None,
        further: vec![second],
        critical: Vec::new(),
        planning: Vec::new(),
        stop,
        ..config()
    }
}

/// The module, a drive on each bus, and a node 5 with an output on the second one.
struct Two {
    bench: Bench,
    drives: [Fake; 2],
    output: Node,
    frames: [Vec<(Instant, can::Frame)>; 2],
    motion: lowlevel::DataMotion,
    holds: lowlevel::DataHold,
    buses: Vec<lowlevel::DataBus>,
    answers: Vec<lowlevel::DataSdo>,
    /// The module has ended.
    ended: bool,
}

impl Two {
    fn with(config: Config) -> Self {
        let canbus = Canbus::new(config).expect("a good configuration");
        let object = Entry::new(0x6200, 1, DataType::U8, Access::ReadWrite, 1);
        let mut output = Node::new(Dictionary::new(5).with(&[object]), Duration::from_millis(5));
        output.power_on(Instant::ZERO);
        let mut robot = Self {
            bench: Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(canbus))),
            drives: [1, 1].map(|node| Fake::new(epos::dictionary(node), 6)),
            output,
            frames: Default::default(),
            motion: Default::default(),
            holds: Default::default(),
            buses: Vec::new(),
            answers: Vec::new(),
            ended: false,
        };
        let ports: Vec<_> = robot.bench.shell.module().ports().iter().map(|port| port.bus.clone()).collect();
        assert_eq!(ports, BUSES);
        robot.bench.start();
        robot
    }

    fn ready(config: Config) -> Self {
        let mut robot = Self::with(config);
        robot.pass(2000);
        assert_eq!(robot.bench.shell.state(), State::Run, "{}", robot.motion.reason);
        robot
    }

    fn pass(&mut self, ms: u32) {
        for _ in 0..ms {
            self.bench.pass(MS);
            let now = self.bench.now();
            self.drives.iter_mut().for_each(|drive| drive.handle_timeout(now));
            self.output.handle_timeout(now);
            self.exchange();
        }
    }

    fn exchange(&mut self) {
        loop {
            let now = self.bench.now();
            let mut quiet = true;
            for (_, action) in self.bench.done() {
                match action {
                    Action::Send(port, Output::Can(frame)) => {
                        quiet = false;
                        let bus = PORTS.iter().position(|own| *own == port).expect("a CAN port");
                        self.frames[bus].push((now, frame));
                        self.drives[bus].handle_rx(now, &frame);
                        if bus == 1 {
                            self.output.handle_rx(now, &frame);
                        }
                    }
                    Action::Publish(Message::LlDataMotion(motion)) => self.motion = motion,
                    Action::Publish(Message::LlDataHold(holds)) => self.holds = holds,
                    Action::Publish(Message::LlDataBus(bus)) => self.buses.push(bus),
                    Action::Publish(Message::LlDataSdo(answer)) => self.answers.push(answer),
                    Action::Exit(_) => self.ended = true,
                    _ => {}
                }
            }
            for (port, drive) in PORTS.into_iter().zip(&mut self.drives) {
                while let Some(frame) = drive.poll_tx() {
                    quiet = false;
                    self.bench.can(port, frame);
                }
            }
            while let Some(frame) = self.output.poll_tx() {
                quiet = false;
                self.bench.can(PORTS[1], frame);
            }
            if quiet {
                return;
            }
        }
    }

    /// Drives straight on after a release.
    #[track_caller]
    fn driving(&mut self) {
        for n in 0..30 {
            let (vx, priority) = (if n < 5 { 0.0 } else { 0.3 }, lowlevel::CmdMotion::REMOTE);
            let command =
                lowlevel::CmdVelocity { vx, priority, source: "test".into(), session: 1, ..Default::default() };
            self.bench.message(command);
            self.pass(50);
        }
        assert!(self.turn().iter().all(|turns| *turns), "{}", self.motion.reason);
        self.frames.iter_mut().for_each(Vec::clear);
    }

    fn turn(&self) -> [bool; 2] {
        [0, 1].map(|bus: usize| {
            let drive = &self.drives[bus];
            drive.power.state() == PowerState::OperationEnabled && drive.node.get(0x606C, 0) != Some(0)
        })
    }

    /// When the drive on a bus got its first quick stop.
    fn stopped(&self, bus: usize) -> Option<Instant> {
        let is_stop = |frame: &can::Frame| frame.id() == RPDO && frame.data()[0] & NO_QUICK_STOP == 0;
        self.frames[bus].iter().find(|(_, frame)| is_stop(frame)).map(|(at, _)| *at)
    }

    fn has_hold(&self, cause: Hold, subject: &str) -> bool {
        self.holds.holds.iter().any(|hold| hold.cause() == Some(cause) && hold.subject == subject)
    }
}

#[test]
fn a_bus_that_goes_down_or_has_no_acknowledgment_stops_the_drive_on_the_other_one_at_once() {
    for bus in [0, 1] {
        let inputs = [
            (Input::Down("unplugged"), Hold::BusDown),
            (Input::CanNotice(can::Notice::NoAcknowledge), Hold::BusUnacknowledged),
        ];
        for (input, hold) in inputs {
            let mut robot = Two::ready(two(|_| {}, config().stop));
            robot.driving();
            let since = robot.bench.now();
            robot.bench.event(Event::Port { port: PORTS[bus], input });
            robot.exchange();
            assert_eq!(robot.stopped(1 - bus), Some(since), "{hold:?}");
            robot.pass(100);
            assert!(robot.has_hold(hold, BUSES[bus]) && !robot.has_hold(hold, BUSES[1 - bus]), "{:?}", robot.holds);
        }
    }
}

#[test]
fn a_bus_that_comes_back_boots_its_drive_and_nothing_else() {
    let mut robot = Two::ready(two(|_| {}, config().stop));
    robot.bench.event(Event::Port { port: PORTS[1], input: Input::Down("unplugged") });
    robot.pass(500);
    robot.frames.iter_mut().for_each(Vec::clear);
    robot.bench.event(Event::Port { port: PORTS[1], input: Input::Up });
    robot.pass(2000);
    let resets = |bus: usize| robot.frames[bus].iter().any(|(_, frame)| frame.id() == can::Id::Standard(0));
    assert_eq!([resets(0), resets(1)], [false, true], "NMT commands");
    robot.driving();
}

#[test]
fn a_module_that_ends_does_not_wait_for_a_bus_that_is_down() {
    for bus in [0, 1] {
        let mut robot = Two::ready(two(|_| {}, config().stop));
        robot.driving();
        robot.bench.event(Event::Port { port: PORTS[bus], input: Input::Down("unplugged") });
        let state = State::Terminate as i8;
        robot.bench.message(common::CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
        robot.exchange();
        robot.pass(2000);
        assert!(robot.ended, "{}", robot.motion.reason);
        assert_eq!(robot.drives[1 - bus].power.state(), PowerState::SwitchOnDisabled, "it is left without power");
    }
}

#[test]
fn a_drive_that_is_lost_or_in_fault_stops_its_twin_on_the_other_bus() {
    for bus in [0, 1] {
        let lose = |drive: &mut Fake, _| drive.alive = false;
        let fail = |drive: &mut Fake, now| drive.fault(now, 0x8400);
        for (what, harm) in [("lost", lose as fn(&mut Fake, Instant)), ("in fault", fail)] {
            let mut robot = Two::ready(two(|_| {}, config().stop));
            robot.driving();
            let since = robot.bench.now();
            harm(&mut robot.drives[bus], since);
            robot.pass(300);
            let took = robot.stopped(1 - bus).map(|at| at.since(since));
            assert!(took.is_some_and(|took| took <= Duration::from_millis(300)), "{what}: {took:?}");
        }
    }
}

#[test]
fn each_bus_has_its_heartbeat_its_sync_and_its_report() {
    let mut robot = Two::ready(two(|second| second.sync = Some(Duration::from_millis(20)), config().stop));
    robot.driving();
    robot.buses.clear();
    robot.pass(1000);
    let count = |bus: usize, id| robot.frames[bus].iter().filter(|(_, frame)| frame.id() == id).count();
    assert_eq!([0, 1].map(|bus| count(bus, SYNC)), [0, 50]);
    let (main, second) = (can::Id::Standard(0x77F), can::Id::Standard(0x764));
    assert_eq!([0, 1].map(|bus| [count(bus, main), count(bus, second)]), [[20, 0], [0, 20]]);
    let rows: Vec<_> = robot.buses.iter().map(|bus| (bus.bus.as_str(), bus.nodes[0].name.as_str())).collect();
    assert_eq!(rows, [("can.main", "left"), ("can.second", "right")]);
}

#[test]
fn another_master_is_of_its_bus() {
    for bus in [0, 1] {
        let mut robot = Two::ready(two(|_| {}, config().stop));
        robot.driving();
        let since = robot.bench.now();
        robot.bench.can(PORTS[bus], can::Frame::standard(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
        robot.exchange();
        assert_eq!([0, 1].map(|bus| robot.stopped(bus)), [Some(since); 2]);
        robot.pass(100);
        let has = |bus: usize| robot.has_hold(Hold::SecondMaster, BUSES[bus]);
        assert!(has(bus) && !has(1 - bus), "{:?}", robot.holds);
        // It ends by itself.
        robot.pass(12_000);
        assert!(!robot.has_hold(Hold::SecondMaster, BUSES[bus]), "{:?}", robot.holds);
        robot.driving();
    }
}

/// With the output of the node 5 on the second bus.
fn fed_by_the_second_bus() -> Stop {
    let output = OutputConfig { node: 5, index: 0x6200, subindex: 1, bits: 8, on: 1, cut: 0 };
    Stop {
        second_way: SecondWay::Canopen,
        output: Some(output),
        output_bus: Some("can.second".into()),
        ..config().stop
    }
}

#[test]
fn an_output_on_a_bus_that_is_down_is_not_known_and_holds_the_robot() {
    let mut robot = Two::ready(two(|_| {}, fed_by_the_second_bus()));
    robot.bench.event(Event::Port { port: PORTS[1], input: Input::Down("unplugged") });
    robot.pass(2000);
    assert!(robot.has_hold(Hold::SecondWayLost, ""), "{:?}", robot.holds);
    robot.bench.event(Event::Port { port: PORTS[1], input: Input::Up });
    robot.pass(2000);
    assert!(!robot.has_hold(Hold::SecondWayLost, ""), "{:?}", robot.holds);
    robot.driving();
}

#[test]
fn the_output_that_feeds_the_motors_may_be_on_the_second_bus() {
    let mut robot = Two::ready(two(|_| {}, fed_by_the_second_bus()));
    robot.driving();
    robot.pass(500);
    let asked = |robot: &Two| {
        let is_asked = |(_, frame): &(Instant, can::Frame)| frame.id() == can::Id::Standard(0x605);
        [0, 1].map(|bus: usize| robot.frames[bus].iter().any(is_asked))
    };
    assert_eq!(asked(&robot), [false, true]);
    // Found off, it holds the robot.
    robot.output.set(0x6200, 1, 0);
    robot.pass(1000);
    assert!(robot.has_hold(Hold::FeedOff, ""), "{:?}", robot.holds);
    // Nobody writes to it.
    let write =
        |node| lowlevel::CmdSdo { node, index: 0x6200, subindex: 1, write: true, data: vec![1], ..<_>::default() };
    for (node, abort) in [(1005, canopen::Abort::LOCAL_CONTROL), (2005, canopen::Abort::NO_RESOURCE)] {
        robot.answers.clear();
        robot.bench.message(write(node));
        robot.pass(500);
        let codes: Vec<_> = robot.answers.iter().map(|answer| (answer.node, answer.abort_code)).collect();
        assert_eq!(codes, [(node, i64::from(abort.0))]);
    }
}

#[test]
fn an_object_is_read_from_the_node_of_its_bus() {
    let mut robot = Two::ready(two(|_| {}, config().stop));
    // Both have the same number, and answer by the same identifier.
    for (bus, serial) in [(0, 11), (1, 22)] {
        robot.drives[bus].node.set(0x6065, 0, serial);
    }
    for node in [1, 1001] {
        robot.bench.message(lowlevel::CmdSdo { node, index: 0x6065, ..<_>::default() });
    }
    robot.pass(200);
    let mut answers: Vec<_> = robot.answers.iter().map(|answer| (answer.node, answer.data.first().copied())).collect();
    answers.sort_unstable();
    assert_eq!(answers, [(1, Some(11)), (1001, Some(22))]);
}
