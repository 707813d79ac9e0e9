//! A courier whose wheels are on two CAN buses, as nodes of the same id: one body, which stops as a whole.

use super::courier_on_two_buses::{BUSES, Folder};
use super::*;
use messages::simulation::{CmdFault, DataTruth};

const AXES: [&str; 2] = ["left", "right"];
/// Maximum time from a fault to the stop of the other wheel, on its own wire.
const STOP_MAX: Duration = Duration::from_millis(300);
/// Identifiers of node 1: its RPDO by the data sheet, and requests to its SDO server.
const RPDO: can::Id = can::Id::Standard(0x201);
const SDO_REQUEST: can::Id = can::Id::Standard(0x601);
/// Bits of a controlword by which a command is a quick stop, and their value: enabled voltage, quick stop (active low).
const QUICK_STOP: (u8, u8) = (0x06, 0x02);

#[derive(Default)]
struct Observed {
    truth: DataTruth,
    velocity: lowlevel::DataVelocity,
    motion: lowlevel::DataMotion,
    holds: lowlevel::DataHold,
    axes: lowlevel::DataAxes,
    buses: [Option<lowlevel::DataBus>; 2],
    answers: Vec<lowlevel::DataSdo>,
    faults: Vec<String>,
    /// Frames of node 1 on each bus: quick stops, and requests of this index.
    stops: [Vec<Instant>; 2],
    requests: [Vec<u16>; 2],
}

impl Observed {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Can { bus, frame, .. } => {
                let Some(bus) = BUSES.iter().position(|name| name == bus) else { return };
                let data = frame.data();
                if frame.id() == RPDO && data[0] & QUICK_STOP.0 == QUICK_STOP.1 {
                    self.stops[bus].push(now);
                } else if frame.id() == SDO_REQUEST {
                    self.requests[bus].push(u16::from_le_bytes([data[1], data[2]]));
                }
            }
            News::Message { message, .. } => match message {
                Message::SimDataTruth(truth) => self.truth = truth.clone(),
                Message::LlDataVelocity(velocity) => self.velocity = velocity.clone(),
                Message::LlDataMotion(motion) => self.motion = motion.clone(),
                Message::LlDataHold(holds) => self.holds = holds.clone(),
                Message::LlDataAxes(axes) => self.axes = axes.clone(),
                Message::LlDataBus(bus) => {
                    if let Some(place) = BUSES.iter().position(|name| *name == bus.bus) {
                        self.buses[place] = Some(bus.clone());
                    }
                }
                Message::LlDataSdo(answer) => self.answers.push(answer.clone()),
                Message::CmEventError(error) => self.faults.push(error.message.clone()),
                _ => {}
            },
            _ => {}
        }
    }
}

struct Courier {
    machine: Virtual,
    observed: Rc<RefCell<Observed>>,
}

fn place(folder: &Folder) -> RobotLocation {
    let world = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml");
    RobotLocation { config: folder.path.clone(), world: Some(world), ..guarded_place() }
}

impl Courier {
    fn new(folder: &Folder) -> Self {
        let mut machine = virtual_machine(&place(folder), Config { seed: 1, ..Config::default() }).expect("a robot");
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        Self { machine, observed }
    }

    fn ready(folder: &Folder) -> Self {
        let mut courier = Self::new(folder);
        courier.pass(6.0);
        assert!(courier.observed.borrow().velocity.ready, "{}", courier.reason());
        courier
    }

    fn pass(&mut self, seconds: f64) {
        self.machine.run_until(self.machine.now() + Duration::from_secs_f64(seconds));
    }

    fn reason(&self) -> String {
        self.observed.borrow().motion.reason.clone()
    }

    fn truth(&self) -> DataTruth {
        self.observed.borrow().truth.clone()
    }

    /// Commands zero for half a second, then this motion at 20 Hz; queued in the machine.
    fn drive(&mut self, vx: f64, omega: f64, seconds: f64) {
        let (begin, priority) = (self.machine.now(), lowlevel::CmdMotion::REMOTE);
        for n in 0..(seconds * 20.0) as u32 {
            let (vx, omega) = if n < 10 { (0.0, 0.0) } else { (vx, omega) };
            let source = "test".into();
            let command = lowlevel::CmdVelocity { timestamp: 0, vx, vy: 0.0, omega, priority, source, session: 1 };
            self.machine.inject(begin + n * Duration::from_millis(50), command);
        }
    }

    /// Drives; the return value is when it does so.
    #[track_caller]
    fn driving(&mut self) -> Instant {
        self.drive(0.25, 0.3, 8.0);
        self.pass(2.5);
        assert!((self.truth().speed - 0.25).abs() < 0.02, "{} m/s: {}", self.truth().speed, self.reason());
        let mut observed = self.observed.borrow_mut();
        observed.stops.iter_mut().for_each(Vec::clear);
        observed.faults.clear();
        self.machine.now()
    }

    /// Fails unless the wheel on a bus has got its quick stop in time.
    #[track_caller]
    fn assert_stopped(&self, what: &str, bus: usize, since: Instant) {
        let took = self.observed.borrow().stops[bus].first().map(|at| at.since(since));
        assert!(took.is_some_and(|took| took <= STOP_MAX), "{what}: {} after {took:?}: {}", AXES[bus], self.reason());
        println!("{what}: quick stop of {} on {} after {:?}", AXES[bus], BUSES[bus], took.unwrap_or_default());
    }

    /// Fails if it moves.
    #[track_caller]
    fn assert_stands(&mut self, what: &str) {
        let before = self.truth();
        self.pass(0.5);
        let after = self.truth();
        assert_eq!((before.x, before.y, before.theta), (after.x, after.y, after.theta), "{what}: {}", self.reason());
    }

    fn has_hold(&self, cause: Hold, subject: &str) -> bool {
        self.observed.borrow().holds.holds.iter().any(|hold| hold.cause() == Some(cause) && hold.subject == subject)
    }
}

#[test]
fn it_drives_straight_and_turns_and_each_bus_has_its_report() {
    let folder = Folder::new("drives");
    let mut courier = Courier::ready(&folder);
    for (vx, omega) in [(0.3, 0.0), (0.2, 0.5), (0.0, -0.6), (-0.2, 0.0)] {
        courier.drive(vx, omega, 4.0);
        courier.pass(2.0);
        let from = courier.truth();
        courier.pass(1.5);
        let to = courier.truth();
        let expected = kinematics::Twist::new(vx, 0.0, omega);
        let expected = kinematics::integrate(navitools::Pose::new(from.x, from.y, from.theta), expected, 1.5);
        let off = (to.x - expected.x).hypot(to.y - expected.y);
        let turned = navitools::wrap(to.theta - expected.theta.radians()).abs();
        assert!(off < 0.01 && turned < 0.01, "{vx}, {omega}: {off} m, {turned} rad: {}", courier.reason());
        courier.pass(2.0);
    }
    let observed = courier.observed.borrow();
    for (place, axis) in AXES.into_iter().enumerate() {
        let bus = observed.buses[place].as_ref().expect("1 Hz");
        let [node] = &bus.nodes[..] else { panic!("{bus:?}") };
        assert_eq!((bus.state, node.name.as_str(), node.address), (lowlevel::DataBus::ACTIVE, axis, 1));
        assert_eq!(node.state, lowlevel::Node::OK, "{node:?}");
        assert!(bus.load > 0.0 && bus.frames > 100, "{bus:?}");
    }
    let names: Vec<_> = observed.axes.axes.iter().map(|axis| (axis.name.as_str(), axis.nmt_state)).collect();
    assert_eq!(names, [("left", 5), ("right", 5)]);
}

#[test]
fn nothing_moves_before_the_drives_of_both_buses_are_ready() {
    for (bus, axis) in AXES.into_iter().enumerate() {
        let folder = Folder::new(&format!("boots-{axis}"));
        let mut courier = Courier::new(&folder);
        courier.pass(0.2);
        let silent = CmdFault { target: axis.into(), fault: "silent".into(), duration: 8.0, ..Default::default() };
        courier.machine.inject(courier.machine.now(), silent);
        courier.drive(0.25, 0.0, 5.0);
        courier.pass(5.0);
        assert!(!courier.observed.borrow().velocity.ready, "{axis}");
        assert!(courier.reason().contains(&format!("the {axis} drive")), "{}", courier.reason());
        let moved = (courier.truth().speed, courier.observed.borrow().stops[1 - bus].is_empty());
        assert_eq!(moved, (0.0, false), "{axis}: the other one is held by its quick stop");
        courier.pass(6.0);
        assert!(courier.observed.borrow().velocity.ready, "{}", courier.reason());
        courier.driving();
    }
}

#[test]
fn the_other_wheel_stops_if_one_is_dead_or_in_fault() {
    for (bus, axis) in AXES.into_iter().enumerate() {
        for fault in ["silent", "fault"] {
            let what = format!("{fault} of {axis}");
            let folder = Folder::new(&format!("{fault}-{axis}"));
            let mut courier = Courier::ready(&folder);
            let since = courier.driving();
            let command =
                CmdFault { target: axis.into(), fault: fault.into(), value: 0.5, duration: 3.0, ..<_>::default() };
            courier.machine.inject(since, command);
            courier.pass(2.0);
            courier.assert_stopped(&what, 1 - bus, since);
            courier.assert_stands(&what);
            // Nothing resumes by itself, a person drives on.
            courier.pass(8.0);
            courier.assert_stands(&what);
            courier.driving();
        }
    }
}

#[test]
fn the_other_wheel_stops_if_a_bus_is_cut_or_off() {
    for (bus, name) in BUSES.into_iter().enumerate() {
        for fault in ["cut", "bus_off"] {
            let what = format!("{fault} of {name}");
            let folder = Folder::new(&format!("{fault}-{name}"));
            let mut courier = Courier::ready(&folder);
            let since = courier.driving();
            assert!(courier.machine.fault(name, fault, 0.0, 2.0), "{what}");
            courier.pass(1.5);
            courier.assert_stopped(&what, 1 - bus, since);
            courier.assert_stands(&what);
            let drive = format!("the {} drive", AXES[1 - bus]);
            assert!(!courier.reason().contains(&drive), "{what}: {}", courier.reason());
            courier.pass(8.0);
            courier.assert_stands(&what);
            courier.driving();
        }
    }
}

#[test]
fn a_second_master_on_either_bus_stops_both_wheels() {
    for (bus, name) in BUSES.into_iter().enumerate() {
        let folder = Folder::new(&format!("rival-{name}"));
        let mut courier = Courier::ready(&folder);
        let since = courier.driving();
        let read = can::Frame::standard(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
        assert!(courier.machine.inject_frame(since, name, read));
        courier.pass(1.0);
        for wheel in 0..2 {
            courier.assert_stopped(&format!("a second master on {name}"), wheel, since);
        }
        assert!(courier.has_hold(Hold::SecondMaster, name), "{}", courier.reason());
        assert!(!courier.has_hold(Hold::SecondMaster, BUSES[1 - bus]), "{}", courier.reason());
        let observed = courier.observed.borrow();
        let said = format!("another program commands the drives on {name} (");
        assert!(observed.faults.iter().any(|fault| fault.contains(&said)), "{:?}", observed.faults);
    }
}

#[test]
fn a_request_of_an_object_reaches_the_node_of_its_bus() {
    const NAME: u16 = 0x1008;
    let folder = Folder::new("sdo");
    let mut courier = Courier::ready(&folder);
    for (bus, node) in [1, 1001].into_iter().enumerate() {
        courier.observed.borrow_mut().requests.iter_mut().for_each(Vec::clear);
        courier.observed.borrow_mut().answers.clear();
        let request = 7 + bus as i32;
        let read = lowlevel::CmdSdo { timestamp: 0, request, node, index: NAME.into(), ..Default::default() };
        courier.machine.inject(courier.machine.now(), read);
        courier.pass(1.0);
        let observed = courier.observed.borrow();
        let [answer] = &observed.answers[..] else { panic!("{:?}", observed.answers) };
        assert_eq!((answer.request, answer.node, answer.abort_code), (request, node, 0));
        assert!(!answer.data.is_empty(), "a device has a name");
        let asked = [0, 1].map(|bus| observed.requests[bus].contains(&NAME));
        assert_eq!(asked, [bus == 0, bus == 1], "node {node}");
    }
    // Our drives are protected on either bus, and there is no third one.
    for (node, is_ours) in [(1, true), (1001, true), (2001, false)] {
        courier.observed.borrow_mut().answers.clear();
        let index = 0x6085;
        let data = vec![0; 4];
        let write = lowlevel::CmdSdo { timestamp: 0, request: 9, node, index, subindex: 0, write: true, data };
        courier.machine.inject(courier.machine.now(), write);
        courier.pass(1.0);
        let observed = courier.observed.borrow();
        let [answer] = &observed.answers[..] else { panic!("{:?}", observed.answers) };
        let abort = if is_ours { canopen::Abort::LOCAL_CONTROL } else { canopen::Abort::NO_RESOURCE };
        assert_eq!((answer.node, answer.abort_code), (node, i64::from(abort.0)));
    }
}
