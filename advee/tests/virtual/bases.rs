//! The shipped robots that do not steer: they move as commanded, localize themselves, and stop all wheels if one is
//! lost.

use super::*;
use messages::middlelevel;
use messages::simulation::{CmdFault, DataTruth};
use rovers::Rover;
use std::path::PathBuf;

/// Robots, the number of their wheels, and whether they go sideways.
const ROBOTS: [(&str, u16, bool); 4] =
    [("courier", 2, false), ("rover", 2, false), ("porter", 4, true), ("tripod", 3, true)];
/// Maximum time from a fault to the stop of each other wheel.
const STOP_MAX: Duration = Duration::from_millis(300);
/// First identifiers of a wheel's RPDO and TPDO, by its data sheet, and of its emergencies.
const RPDO: u16 = 0x200;
const TPDO: u16 = 0x180;
const EMERGENCY: u16 = 0x80;
/// Requests to an SDO server.
const SDO: u16 = 0x600;
/// Code of an emergency: the master is silent (CiA 301).
const HEARTBEAT_LOST: [u8; 2] = 0x8130u16.to_le_bytes();
/// Messages of CAN Simple by an identifier's lowest five bits: heartbeat, and velocity set-point of an ODrive.
const ODRIVE_HEARTBEAT: u16 = 0x01;
const ODRIVE_INPUT_VEL: u16 = 0x0D;
/// Commands of a VESC with a frame of their own: CAN_PACKET_SET_CURRENT_BRAKE, CAN_PACKET_SET_RPM.
const VESC_SET_CURRENT_BRAKE: u32 = 2;
const VESC_SET_RPM: u32 = 3;
/// State of an ODrive in its heartbeat.
const CLOSED_LOOP: u8 = 8;

#[derive(Default)]
struct Observed {
    truth: DataTruth,
    estimate: middlelevel::DataEstimate,
    velocity: lowlevel::DataVelocity,
    goal: String,
    /// The planner has commanded a turn on the spot, and motion to the side.
    turned: bool,
    slid: bool,
    /// Greatest rotation that it has commanded, rad/s.
    rotation: f64,
    /// Times at which a wheel ceased to be driven, by its number from 1: by an RPDO or by itself.
    stopped: Vec<(Instant, u16)>,
    moves: [bool; 8],
    /// Errors of the drives' driver.
    errors: Vec<(Instant, String)>,
    /// Set-points of enabled wheels, in the drives' unit.
    setpoints: Vec<(Instant, u16, i32)>,
    /// What was written to 0x60FE:1 of each drive.
    outputs: Vec<(Instant, u16, u32)>,
}

impl Observed {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Can { frame, .. } => self.on_frame(now, frame),
            News::Message { message, .. } => match message {
                Message::SimDataTruth(truth) => self.truth = truth.clone(),
                Message::MlDataEstimate(estimate) => self.estimate = estimate.clone(),
                Message::LlDataVelocity(velocity) => self.velocity = velocity.clone(),
                Message::MlDataGoal(goal) => self.goal = goal.message.clone(),
                Message::CmEventError(error) if error.severity == messages::common::Error::ERROR => {
                    self.errors.push((now, error.message.clone()));
                }
                Message::LlCmdVelocity(command) if command.source == "planner" => {
                    self.turned |= command.omega != 0.0;
                    self.slid |= command.vy != 0.0;
                    self.rotation = self.rotation.max(command.omega.abs());
                }
                _ => {}
            },
            _ => {}
        }
    }

    fn on_frame(&mut self, now: Instant, frame: &can::Frame) {
        let data = frame.data();
        let id = match frame.id() {
            can::Id::Standard(id) => id,
            can::Id::Extended(id) => {
                return match id >> 8 {
                    VESC_SET_RPM => self.set(now, u16::from(id as u8), data != [0; 4]),
                    VESC_SET_CURRENT_BRAKE => self.set(now, u16::from(id as u8), false),
                    _ => {}
                };
            }
        };
        if let (RPDO, &[0x0F, _, a, b, c, d]) = (id & 0x780, data) {
            self.setpoints.push((now, id & 0x7F, i32::from_le_bytes([a, b, c, d])));
        }
        if let (SDO, &[0x23, 0xFE, 0x60, 1, a, b, c, d]) = (id & 0x780, data) {
            self.outputs.push((now, id & 0x7F, u32::from_le_bytes([a, b, c, d])));
        }
        let (wheel, moves) = match id & 0x780 {
            RPDO if data.len() == 6 => (id & 0x7F, data[0] & 0x0F == 0x0F && data[2..] != [0; 4]),
            // Only that it is not enabled says something.
            TPDO if data.len() == 6 && data[0] & 0x6F != 0x27 => (id & 0x7F, false),
            EMERGENCY if data.starts_with(&HEARTBEAT_LOST) => (id & 0x7F, false),
            0 => match (id & 0x1F, data) {
                (ODRIVE_INPUT_VEL, &[a, b, c, d, ..]) => (id >> 5, f32::from_le_bytes([a, b, c, d]) != 0.0),
                (ODRIVE_HEARTBEAT, &[_, _, _, _, state, ..]) if state != CLOSED_LOOP => (id >> 5, false),
                _ => return,
            },
            _ => return,
        };
        self.set(now, wheel, moves);
    }

    fn set(&mut self, now: Instant, wheel: u16, moves: bool) {
        let Some(before) = self.moves.get_mut(usize::from(wheel)) else { return };
        if std::mem::replace(before, moves) && !moves {
            self.stopped.push((now, wheel));
        }
    }
}

pub struct Base {
    pub machine: Virtual,
    observed: Rc<RefCell<Observed>>,
    wheels: u16,
    /// Number of the next goal.
    goals: i32,
}

impl Base {
    /// Ready to drive in an empty hall, so that nothing is in its way.
    pub fn ready(name: &str, wheels: u16) -> Self {
        Self::in_world(name, wheels, &Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml"))
    }

    /// Ready to drive in the empty hall with more walls, from a start.
    pub fn among(name: &str, wheels: u16, start: [f64; 3], walls: &[[f64; 4]]) -> Self {
        let empty = include_str!("../../../conf/worlds/empty.toml");
        let more: String = walls.iter().map(|wall| format!("{wall:?}, ")).collect();
        let world = empty
            .replace("start = [10.0, 6.0, 0.0]", &format!("start = {start:?}"))
            .replace("walls = [", &format!("walls = [{more}"))
            .replace("x = 10.0, y = 11.9", "x = 8.0, y = 11.9");
        let file =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}-{}.toml", start[0], std::process::id()));
        std::fs::write(&file, world).expect("a file");
        let base = Self::in_world(name, wheels, &file);
        std::fs::remove_file(file).expect("the file");
        base
    }

    /// Ready to drive in an empty hall, with this laid over its configuration.
    pub fn with(name: &str, wheels: u16, sets: &[&str]) -> Self {
        let world = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml");
        Self::in_world_with(name, wheels, &world, sets)
    }

    pub fn in_world(name: &str, wheels: u16, world: &Path) -> Self {
        Self::in_world_with(name, wheels, world, &[])
    }

    fn in_world_with(name: &str, wheels: u16, world: &Path, sets: &[&str]) -> Self {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
        Self::of(&config, name, wheels, world, sets)
    }

    fn of(config: &Path, name: &str, wheels: u16, world: &Path, sets: &[&str]) -> Self {
        let config = config.into();
        let mut place = RobotLocation { config, world: Some(world.into()), ..guarded_place() };
        place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
        let mut machine = virtual_machine(&place, Config { seed: 1, ..Config::default() }).expect(name);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        machine.run_until(at(6.0));
        // One that is homed takes longer.
        while !observed.borrow().velocity.ready && machine.now() < at(20.0) {
            machine.run_until(machine.now() + Duration::from_millis(500));
        }
        assert!(observed.borrow().velocity.ready, "{name}: {:?}", observed.borrow().velocity);
        Self { machine, observed, wheels, goals: 1 }
    }

    pub fn pass(&mut self, seconds: f64) {
        self.machine.run_until(self.machine.now() + Duration::from_secs_f64(seconds));
    }

    /// Commands zero for half a second, then this velocity at 20 Hz for a while; queued in the machine.
    pub fn drive(&mut self, twist: (f64, f64, f64), seconds: f64) {
        let (begin, priority) = (self.machine.now(), lowlevel::CmdMotion::REMOTE);
        for n in 0..(seconds * 20.0) as u32 {
            let (vx, vy, omega) = if n < 10 { (0.0, 0.0, 0.0) } else { twist };
            let source = "test".into();
            let command = lowlevel::CmdVelocity { timestamp: 0, vx, vy, omega, priority, source, session: 1 };
            self.machine.inject(begin + n * Duration::from_millis(50), command);
        }
    }

    /// Sends a goal with a heading, and passes until it is reached, at most this long. Returns the time it took, s.
    #[track_caller]
    fn go(&mut self, name: &str, [x, y, theta]: [f64; 3], most: f64) -> f64 {
        let id = self.goals;
        self.goals += 1;
        let waypoint = middlelevel::Waypoint { x, y, theta, tolerance: 0.1, heading: true };
        let goal = middlelevel::CmdGoal { timestamp: 0, id, waypoints: vec![waypoint], ..Default::default() };
        let begun = self.machine.now();
        self.machine.inject(begun, goal);
        self.pass(0.5);
        while !self.observed.borrow().goal.contains("reached") {
            let goal = self.observed.borrow().goal.clone();
            let took = self.machine.now().since(begun).as_secs_f64();
            assert!(took < most, "{name} to {x}, {y}, {theta} after {took} s: {goal}, {:?}", self.truth());
            self.pass(0.1);
        }
        self.pass(0.5);
        let truth = self.truth();
        let (off, turned) = ((truth.x - x).hypot(truth.y - y), navitools::wrap(truth.theta - theta).abs());
        assert!(off < 0.2 && turned < 0.3, "{name} to {x}, {y}, {theta}: {off} m, {turned} rad off");
        assert_eq!(truth.collisions, 0, "{name} to {x}, {y}, {theta}");
        self.machine.now().since(begun).as_secs_f64()
    }

    /// True if the planner has turned on the spot, and gone to the side, since the last call.
    fn has_turned_and_slid(&self) -> (bool, bool) {
        let mut observed = self.observed.borrow_mut();
        (std::mem::take(&mut observed.turned), std::mem::take(&mut observed.slid))
    }

    pub fn truth(&self) -> DataTruth {
        self.observed.borrow().truth.clone()
    }

    /// Hangs, or kills, the driver of a robot that drives. Fails if its devices, whose stop is not on the bus, do not
    /// begin to stop the body by themselves, or if it does not stand this long afterwards, s.
    #[track_caller]
    fn assert_stops_without_its_driver(&mut self, name: &str, hangs: bool, seconds: f64) {
        let pid = self.machine.pid("driver_canbus").expect("it runs");
        let before = self.truth().speed;
        if hangs {
            self.machine.hang(pid);
        } else {
            self.machine.kill(pid);
        }
        self.pass(STOP_MAX.as_secs_f64());
        let after = self.truth().speed;
        assert!(after < before - 0.01, "{name}, hangs {hangs}: {before} m/s, then {after} m/s");
        self.pass(seconds);
        self.assert_stands(&format!("{name}, without its driver"));
    }

    /// Fails if it does not know where it is.
    #[track_caller]
    fn assert_located(&self, name: &str) {
        let (truth, observed) = (self.truth(), self.observed.borrow());
        let estimate = &observed.estimate;
        let off = (estimate.x - truth.x).hypot(estimate.y - truth.y);
        let turned = navitools::wrap(estimate.theta - truth.theta).abs();
        let is_fine = estimate.quality == middlelevel::DataEstimate::FINE;
        assert!(off < 0.15 && turned < 0.1 && is_fine, "{name}: {off} m, {turned} rad, {estimate:?}");
    }
}

#[test]
fn they_move_as_commanded_and_know_where_they_are() {
    for (name, wheels, sideways) in ROBOTS {
        let mut base = Base::ready(name, wheels);
        let mut twists = vec![(0.25, 0.0, 0.0), (0.2, 0.0, 0.5), (0.0, 0.0, -0.6), (-0.2, 0.0, 0.0)];
        if sideways {
            twists.extend([(0.0, 0.2, 0.0), (-0.15, -0.15, 0.3)]);
        }
        for twist in twists {
            base.drive(twist, 5.0);
            base.pass(2.0);
            let from = base.truth();
            base.pass(2.0);
            let to = base.truth();
            let expected = kinematics::Twist::new(twist.0, twist.1, twist.2);
            let expected = kinematics::integrate(navitools::Pose::new(from.x, from.y, from.theta), expected, 2.0);
            let off = (to.x - expected.x).hypot(to.y - expected.y);
            let turned = navitools::wrap(to.theta - expected.theta.radians()).abs();
            assert!(off < 0.01 && turned < 0.01, "{name}, {twist:?}: {off} m, {turned} rad");
            let velocity = base.observed.borrow().velocity.clone();
            let measured = [velocity.vx - twist.0, velocity.vy - twist.1, velocity.omega - twist.2];
            assert!(measured.iter().all(|gap| gap.abs() < 0.02), "{name}, {twist:?}: {velocity:?}");
            base.pass(3.0);
            base.assert_located(name);
        }
        assert_eq!(base.truth().collisions, 0);
    }
}

#[test]
fn they_go_to_a_goal() {
    for (name, wheels, _) in ROBOTS {
        let mut base = Base::ready(name, wheels);
        let waypoint = middlelevel::Waypoint { x: 13.0, y: 8.0, theta: 0.0, tolerance: 0.1, heading: false };
        let goal = middlelevel::CmdGoal { timestamp: 0, id: 1, waypoints: vec![waypoint], ..Default::default() };
        base.machine.inject(base.machine.now(), goal);
        base.pass(30.0);
        let truth = base.truth();
        let off = (truth.x - 13.0).hypot(truth.y - 8.0);
        assert!(off < 0.2, "{name}: {off} m, {}", base.observed.borrow().goal);
        base.assert_located(name);
    }
}

/// The courier with a hexagon in place of its rectangle, made for the time of a call.
fn with_hexagon(test: &str, then: impl FnOnce(&Path)) {
    const HEXAGON: &str =
        "footprint_m = [[0.35, 0.1], [0.0, 0.25], [-0.35, 0.1], [-0.35, -0.1], [0.0, -0.25], [0.35, -0.1]]";
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("hexagon-{test}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    for entry in std::fs::read_dir(&shipped).expect("the shipped folder") {
        let file = entry.expect("a file").path();
        let name = file.file_name().expect("a name");
        let text = std::fs::read_to_string(&file).expect("a text");
        let is_side = |line: &&str| line.starts_with("width_m") || line.starts_with("rear_overhang_m");
        let lines = text.lines().filter(|line| !is_side(line));
        let lines = lines.map(|line| if line.starts_with("length_m") { HEXAGON } else { line });
        std::fs::write(folder.join(name), lines.collect::<Vec<_>>().join("\n")).expect("a file");
    }
    then(&folder);
    std::fs::remove_dir_all(folder).expect("the folder");
}

#[test]
fn a_courier_with_a_hexagonal_outline_goes_to_a_goal() {
    with_hexagon("goal", |folder| {
        let mut base = Base::of(folder, "hexagon", 2, &empty_world(), &[]);
        base.go("hexagon", [13.0, 8.0, 0.0], 40.0);
        base.go("hexagon", [13.0, 8.0, 3.0], 20.0);
        base.assert_located("hexagon");
    });
}

/// Times that goals took are printed.
#[test]
fn they_arrive_with_any_heading_and_turn_on_the_spot_in_a_dead_end() {
    use std::f64::consts::PI;
    // 1.3 m wide and deep, open to the right.
    let dead_end = [[6.0, 5.35, 7.3, 5.35], [6.0, 6.65, 7.3, 6.65], [6.0, 5.35, 6.0, 6.65]];
    for (name, wheels, _) in ROBOTS {
        let mut base = Base::among(name, wheels, [9.0, 6.0, 0.0], &dead_end);
        let there = base.go(name, [12.0, 6.0, PI], 40.0);
        let into = base.go(name, [6.75, 6.0, PI], 60.0);
        base.has_turned_and_slid();
        let out = base.go(name, [11.0, 6.0, 0.0], 60.0);
        assert!(base.has_turned_and_slid().0, "{name}");
        let rotation = base.observed.borrow().rotation;
        assert!(rotation <= 1.2 + 1e-9, "{name}: {rotation} rad/s");
        base.assert_located(name);
        println!("{name}: at the goal after {there:.1} s; into the dead end {into:.1} s, out of it {out:.1} s");
    }
}

#[test]
fn those_that_can_go_to_the_side_do_so_where_it_is_narrow() {
    // A bay 1.2 m long and 0.95 m deep, open upwards.
    let bay = [[9.4, 4.5, 10.6, 4.5], [9.4, 4.5, 9.4, 5.45], [10.6, 4.5, 10.6, 5.45]];
    for (name, wheels, sideways) in ROBOTS {
        if !sideways {
            continue;
        }
        let mut base = Base::among(name, wheels, [10.0, 6.2, 0.0], &bay);
        let into = base.go(name, [10.0, 5.0, 0.0], 60.0);
        assert!(base.has_turned_and_slid().1, "{name}");
        let out = base.go(name, [10.0, 6.2, 0.0], 60.0);
        assert!(base.has_turned_and_slid().1, "{name}");
        base.assert_located(name);
        println!("{name}: into the bay {into:.1} s, out of it {out:.1} s");
    }
}

#[test]
fn all_wheels_stop_if_one_is_lost_or_the_driver_is() {
    let faults = ["silent", "fault", "reboot", "runaway"];
    for (name, wheels, _) in ROBOTS {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
        let robot = robot::config::Config::load(&config, true, &[]).unwrap().robot;
        let axes = robot.base.expect("a base").axes();
        for (victim, fault) in (0..wheels).flat_map(|wheel| faults.map(|fault| (wheel, fault))) {
            let mut base = Base::ready(name, wheels);
            base.drive((0.25, 0.0, 0.3), 8.0);
            base.pass(2.0);
            let since = base.machine.now();
            base.observed.borrow_mut().stopped.clear();
            let target = axes[usize::from(victim)].into();
            let command = CmdFault { target, fault: fault.into(), value: 0.5, duration: 5.0, ..Default::default() };
            base.machine.inject(since, command);
            base.pass(3.0);
            let what = format!("{name}: {fault} of {}", axes[usize::from(victim)]);
            base.assert_stopped(&what, since, STOP_MAX, Some(victim + 1));
            if fault != "runaway" {
                base.assert_stands(&format!("{name}: {fault}"));
            }
        }
        for lost in ["driver_canbus hangs", "driver_canbus dies", "watchdog dies"] {
            let mut base = Base::ready(name, wheels);
            base.drive((0.25, 0.0, 0.3), 8.0);
            base.pass(2.0);
            let since = base.machine.now();
            base.observed.borrow_mut().stopped.clear();
            let (module, what) = lost.split_once(' ').expect("two words");
            let pid = base.machine.pid(module).expect("it runs");
            if what == "hangs" {
                base.machine.hang(pid);
            } else {
                base.machine.kill(pid);
            }
            base.pass(3.0);
            base.assert_stopped(&format!("{name}: {lost}"), since, STOP_MAX, None);
            base.assert_stands(&format!("{name}: {lost}"));
        }
    }
}

/// The courier with drives that offer cyclic synchronous velocity alone, at SYNC or without it.
fn on_cyclic_drives(sync: Option<&str>) -> impl Fn() -> Base {
    let folder =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("cyclic-{}-{}", sync.is_some(), std::process::id()));
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
    std::fs::create_dir_all(&folder).expect("a folder");
    for file in ["modules.toml", "sim.toml", "robot.toml"] {
        std::fs::copy(shipped.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let sheet = std::fs::read_to_string(shipped.join("wheel.eds")).expect("its sheet");
    let modes = "ParameterName=Supported drive modes\nObjectType=0x7\nDataType=0x0007\nAccessType=ro\nDefaultValue=";
    let cyclic = sheet.replace(&format!("{modes}0x04"), &format!("{modes}0x0100"));
    assert_ne!(cyclic, sheet);
    std::fs::write(folder.join("wheel.eds"), cyclic).expect("a file");
    let sets: Vec<String> = sync.iter().map(|period| format!("can.main.sync_s={period}")).collect();
    move || {
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        Base::of(&folder, "courier", 2, &empty_world(), &sets)
    }
}

/// The courier with a holding brake on the output of each drive, which needs 200 ms.
#[test]
fn a_courier_with_brakes_on_its_drives_moves_as_commanded_stops_and_is_braked_at_the_end() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("braked-{}", std::process::id()));
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
    std::fs::create_dir_all(&folder).expect("a folder");
    for file in ["modules.toml", "sim.toml"] {
        std::fs::copy(shipped.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let robot = std::fs::read_to_string(shipped.join("robot.toml")).expect("the shipped configuration");
    let eds = "eds = \"wheel.eds\"\n";
    let braked = robot.replace(eds, &format!("{eds}brake = \"output\"\nbrake_release_s = 0.2\n"));
    std::fs::write(folder.join("robot.toml"), braked).expect("a file");
    let mut sheet = std::fs::read_to_string(shipped.join("wheel.eds")).expect("its sheet");
    sheet += "\n[60FE]\nParameterName=Digital outputs\nObjectType=0x8\nSubNumber=3\n";
    for (sub, kind, access, value) in [(0, "0x0005", "const", 2), (1, "0x0007", "rw", 0), (2, "0x0007", "rw", 0)] {
        sheet += &format!(
            "[60FEsub{sub}]\nParameterName=Sub {sub}\nObjectType=0x7\nDataType={kind}\nAccessType={access}\n\
             DefaultValue={value}\nPDOMapping=0\n"
        );
    }
    std::fs::write(folder.join("wheel.eds"), sheet).expect("a file");
    let ready = || Base::of(&folder, "courier with brakes", 2, &empty_world(), &[]);

    let mut base = ready();
    for twist in [(0.25, 0.0, 0.0), (0.0, 0.0, -0.6)] {
        base.drive(twist, 5.0);
        base.pass(4.0);
        let velocity = base.observed.borrow().velocity.clone();
        let measured = [velocity.vx - twist.0, velocity.vy - twist.1, velocity.omega - twist.2];
        assert!(measured.iter().all(|gap| gap.abs() < 0.02), "{twist:?}: {velocity:?}");
        base.pass(3.0);
    }
    assert!(base.observed.borrow().errors.is_empty(), "{:?}", base.observed.borrow().errors);
    // It was driven after its brakes were released, by 0 in bit 0 of 0x60FE:1.
    let outputs = base.observed.borrow().outputs.clone();
    let first = base.observed.borrow().setpoints.iter().find(|row| row.2 != 0).expect("it moved").0;
    for wheel in [1, 2] {
        let own: Vec<_> = outputs.iter().filter(|row| row.1 == wheel).collect();
        let released = own.iter().find(|row| row.2 & 1 == 0).expect("it was released").0;
        assert!(first.since(released) >= Duration::from_millis(200), "{own:?}, {first:?}");
    }
    // The module ends: the brakes are set, by the last thing that is written to the outputs.
    let (module, source, state) = ("driver_canbus".into(), "test".into(), State::Terminate as i8);
    let now = base.machine.now();
    base.machine.inject(now, messages::common::CmdState { timestamp: 0, module, state, manual: true, source });
    base.pass(1.0);
    for wheel in [1, 2] {
        let outputs = base.observed.borrow().outputs.clone();
        let last = outputs.iter().rev().find(|row| row.1 == wheel).expect("it was released");
        assert!(last.0 > now && last.2 & 1 == 1, "{outputs:?}");
    }

    for fault in ["silent", "fault", "reboot"] {
        let mut base = ready();
        base.drive((0.25, 0.0, 0.3), 8.0);
        base.pass(2.0);
        base.observed.borrow_mut().stopped.clear();
        let (since, target) = (base.machine.now(), "left".into());
        let command = CmdFault { target, fault: fault.into(), value: 0.5, duration: 5.0, ..Default::default() };
        base.machine.inject(since, command);
        base.pass(3.0);
        base.assert_stopped(fault, since, STOP_MAX, Some(1));
        base.assert_stands(fault);
    }
}

/// These drives have no ramp in their mode: the driver's set-points are one.
#[test]
fn a_courier_on_cyclic_drives_moves_as_commanded_by_ramps_of_the_driver() {
    for sync in [None, Some("0.01")] {
        let mut base = on_cyclic_drives(sync)();
        for twist in [(0.25, 0.0, 0.0), (0.2, 0.0, 0.5), (0.0, 0.0, -0.6), (-0.2, 0.0, 0.0)] {
            base.drive(twist, 5.0);
            base.pass(4.0);
            let velocity = base.observed.borrow().velocity.clone();
            let measured = [velocity.vx - twist.0, velocity.vy - twist.1, velocity.omega - twist.2];
            assert!(measured.iter().all(|gap| gap.abs() < 0.02), "{sync:?} {twist:?}: {velocity:?}");
            base.pass(3.0);
            base.assert_located("courier on cyclic drives");
        }
        let observed = base.observed.borrow();
        assert!(observed.errors.is_empty(), "{:?}", observed.errors);
        let period = if sync.is_some() { 0.01 } else { 0.02 };
        for wheel in [1, 2] {
            let own: Vec<_> = observed.setpoints.iter().filter(|row| row.1 == wheel).collect();
            // 0.8 m/s² at most, of a motor that makes 20 turns in the way of a wheel with a radius of 0.085 m, in rpm.
            let most = 0.8 * period * 60.0 * 20.0 / (std::f64::consts::TAU * 0.085) + 1.0;
            let moving = own.windows(2).filter(|two| two[1].0.since(two[0].0).as_secs_f64() < 0.1);
            let steps: Vec<f64> = moving.map(|two| f64::from(two[1].2 - two[0].2).abs()).collect();
            assert!(steps.len() > 1000, "{sync:?}: {} set-points", steps.len());
            assert!(
                steps.iter().all(|step| *step <= most),
                "{sync:?}: {:?} > {most}",
                steps.iter().max_by(|a, b| a.total_cmp(b))
            );
        }
    }
}

#[test]
fn all_wheels_of_a_courier_on_cyclic_drives_stop_if_one_is_lost_or_the_driver_is() {
    for sync in [None, Some("0.01")] {
        let ready = on_cyclic_drives(sync);
        let driving = || {
            let mut base = ready();
            base.drive((0.25, 0.0, 0.3), 8.0);
            base.pass(2.0);
            base.observed.borrow_mut().stopped.clear();
            base
        };
        for (victim, name) in [(1, "left"), (2, "right")] {
            for fault in ["silent", "fault", "reboot", "runaway"] {
                let mut base = driving();
                let (since, target, fault) = (base.machine.now(), name.into(), fault.to_owned());
                let what = format!("{sync:?}: {fault} of {name}");
                base.machine.inject(since, CmdFault { target, fault, value: 0.5, duration: 5.0, ..Default::default() });
                base.pass(3.0);
                base.assert_stopped(&what, since, STOP_MAX, Some(victim));
            }
        }
        for hangs in [true, false] {
            let mut base = driving();
            let (since, pid) = (base.machine.now(), base.machine.pid("driver_canbus").expect("it runs"));
            if hangs {
                base.machine.hang(pid);
            } else {
                base.machine.kill(pid);
            }
            base.pass(3.0);
            base.assert_stopped(&format!("{sync:?}: hangs {hangs}"), since, STOP_MAX, None);
            base.assert_stands(&format!("{sync:?}: hangs {hangs}"));
        }
        // The source is silent: the drives brake by their own quick stop.
        let mut base = ready();
        base.drive((0.25, 0.0, 0.3), 2.0);
        base.pass(1.9);
        base.observed.borrow_mut().stopped.clear();
        let since = base.machine.now();
        base.pass(2.0);
        base.assert_stopped(&format!("{sync:?}: silence"), since, Duration::from_millis(400), None);
        base.assert_stands(&format!("{sync:?}: silence"));
    }
}

#[test]
fn a_wheel_that_the_others_hold_is_found_by_the_torques_and_healthy_ones_are_not() {
    let mut base = Base::ready("porter", 4);
    base.observed.borrow_mut().errors.clear();
    // From one motion into another one, whatever forces that takes.
    for twist in
        [(0.3, 0.0, 0.0), (-0.3, 0.0, 0.5), (0.0, 0.3, 0.0), (0.2, -0.2, -0.4), (0.0, 0.0, 0.8), (0.0, 0.0, 0.0)]
    {
        base.drive(twist, 2.5);
        base.pass(2.5);
        assert_eq!(base.observed.borrow().errors, [], "{twist:?}");
    }
    base.drive((0.25, 0.1, 0.2), 8.0);
    base.pass(2.0);
    let since = base.machine.now();
    let (target, fault) = ("rear_left".into(), "runaway".into());
    base.machine.inject(since, CmdFault { target, fault, value: 0.3, duration: 5.0, ..Default::default() });
    base.pass(1.0);
    let first = base.observed.borrow().errors.first().map(|(at, message)| (at.since(since), message.clone()));
    let (took, message) = first.expect("a report");
    assert!(took <= STOP_MAX && message.starts_with("the wheels work against each other"), "{took:?}: {message}");
}

/// Maximum motion with a wrong encoder before it is reported and the other wheels stop.
const WRONG_MAX: Duration = Duration::from_millis(500);

#[test]
fn a_dead_reversed_or_exchanged_encoder_is_reported_and_stops_all_wheels() {
    for (name, wheels, _) in ROBOTS {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
        let robot = robot::config::Config::load(&config, true, &[]).unwrap().robot;
        let axes = robot.base.expect("a base").axes();
        for victim in 0..wheels {
            let other = f64::from((victim + 1) % wheels + 1);
            for (fault, value) in [("encoder", 0.0), ("encoder", -1.0), ("swapped", other)] {
                let mut base = Base::ready(name, wheels);
                // A curve on which no wheel stands, and no two of them are equally fast.
                base.drive((0.25, 0.0, 0.4), 8.0);
                base.pass(2.0);
                let since = base.machine.now();
                base.observed.borrow_mut().stopped.clear();
                base.observed.borrow_mut().errors.clear();
                let target = axes[usize::from(victim)].into();
                let command = CmdFault { target, fault: fault.into(), value, duration: 5.0, ..Default::default() };
                base.machine.inject(since, command);
                base.pass(1.0);
                let what = format!("{name}: {fault} {value} of {}", axes[usize::from(victim)]);
                let told =
                    base.observed.borrow().errors.first().map(|(at, message)| (at.since(since), message.clone()));
                assert!(told.as_ref().is_some_and(|(took, _)| *took <= WRONG_MAX), "{what}: {told:?}");
                base.assert_stopped(&what, since, WRONG_MAX, Some(victim + 1));
            }
        }
    }
}

/// Multiples of its way that a slipping encoder counts: of a wheel that spins, and of one that is dragged.
const SLIPPING: [f64; 2] = [1.5, 0.6];

/// The drive's own loop keeps the speed that it measures, so the measured speeds stay those of a motion of the base,
/// and nothing contradicts them. The wheel turns at the commanded speed divided by what is counted, and no faster.
#[test]
fn a_slipping_encoder_is_reported_or_makes_its_wheel_no_faster_than_what_it_counts() {
    for (name, wheels, _) in ROBOTS {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(name);
        let robot = robot::config::Config::load(&config, true, &[]).unwrap().robot;
        let base = robot.base.expect("a base");
        let (axes, chassis) = (base.axes(), base.chassis(&robot.limits).unwrap());
        for (victim, counts) in (0..wheels).flat_map(|wheel| SLIPPING.map(|counts| (wheel, counts))) {
            let mut base = Base::ready(name, wheels);
            base.drive((0.25, 0.0, 0.4), 8.0);
            base.pass(2.0);
            let since = base.machine.now();
            base.observed.borrow_mut().stopped.clear();
            base.observed.borrow_mut().errors.clear();
            let (target, fault) = (axes[usize::from(victim)].into(), "encoder".into());
            base.machine.inject(since, CmdFault { target, fault, value: counts, duration: 5.0, ..Default::default() });
            base.pass(1.0);
            let what = format!("{name}: {} counts {counts} times its way", axes[usize::from(victim)]);
            let report = base.observed.borrow().errors.first().map(|(at, message)| (at.since(since), message.clone()));
            println!("{what}: {report:?}");
            if report.is_some() {
                base.assert_stopped(&what, since, Duration::from_secs(1), Some(victim + 1));
                continue;
            }
            let from = base.truth();
            base.pass(0.2);
            let to = base.truth();
            let (x, y) = ((to.x - from.x) / 0.2, (to.y - from.y) / 0.2);
            let omega = navitools::wrap(to.theta - from.theta) / 0.2;
            let (sin, cos) = (from.theta + omega * 0.1).sin_cos();
            let moves = kinematics::Twist::new(x * cos + y * sin, y * cos - x * sin, omega);
            let speeds = |twist| chassis.wheel_states(twist, &vec![kinematics::WheelState::default(); wheels.into()]);
            let (turn, asked) = (speeds(moves), speeds(kinematics::Twist::new(0.25, 0.0, 0.4)));
            for (wheel, (turns, asked)) in turn.iter().zip(asked.iter()).enumerate() {
                let part = if wheel == usize::from(victim) { counts } else { 1.0 };
                let most = asked.speed_mps.abs() / part + 0.05;
                assert!(turns.speed_mps.abs() <= most, "{what}: wheel {wheel}: {turns:?}, {asked:?}");
            }
        }
    }
}

/// Straight ahead the encoder of the other wheel reads what the own one should: nothing contradicts it, and the wheel
/// that no loop controls rolls on. On a curve it is reported
/// (`a_dead_reversed_or_exchanged_encoder_is_reported_and_stops_all_wheels`).
#[test]
fn an_exchanged_encoder_of_two_wheels_cannot_be_noticed_straight_ahead() {
    for name in ["courier", "rover"] {
        let mut base = Base::ready(name, 2);
        base.drive((0.25, 0.0, 0.0), 4.0);
        base.pass(2.0);
        let since = base.machine.now();
        base.observed.borrow_mut().errors.clear();
        let (target, fault) = ("left".into(), "swapped".into());
        base.machine.inject(since, CmdFault { target, fault, value: 2.0, duration: 20.0, ..Default::default() });
        base.pass(1.0);
        assert_eq!(base.observed.borrow().errors, [], "{name}");
        let velocity = base.observed.borrow().velocity.clone();
        assert!((velocity.vx - 0.25).abs() < 0.02 && velocity.omega.abs() < 0.02, "{name}: {velocity:?}");
    }
}

#[test]
fn a_watchdog_that_is_late_stops_them_although_nothing_but_their_driver_is_critical() {
    for (name, wheels, _) in ROBOTS {
        let mut base = Base::ready(name, wheels);
        base.drive((0.25, 0.0, 0.0), 8.0);
        base.pass(2.0);
        assert!(base.truth().speed > 0.2, "{name}: {:?}", base.truth());
        let pid = base.machine.pid("watchdog").expect("it runs");
        base.machine.crawl(pid, Duration::from_millis(150));
        base.pass(3.0);
        base.assert_stands(name);
    }
}

impl Base {
    /// Fails if a wheel, but for `without`, has not stopped in time.
    #[track_caller]
    fn assert_stopped(&self, what: &str, since: Instant, within: Duration, without: Option<u16>) {
        let observed = self.observed.borrow();
        for wheel in (1..=self.wheels).filter(|wheel| Some(*wheel) != without) {
            let stop = observed.stopped.iter().find(|(at, other)| *at >= since && *other == wheel);
            let took = stop.map(|(at, _)| at.since(since));
            assert!(took.is_some_and(|took| took <= within), "{what}: wheel {wheel} after {took:?}");
        }
    }

    /// Fails if it moves.
    #[track_caller]
    fn assert_stands(&mut self, what: &str) {
        let before = self.truth();
        self.pass(0.5);
        let after = self.truth();
        assert_eq!((before.x, before.y, before.theta), (after.x, after.y, after.theta), "{what}: it moves");
    }
}

/// The rover with a VESC for each wheel in place of its ODrives.
fn on_vescs(test: &str, then: impl FnOnce(&dyn Fn() -> Base)) {
    let folder = Rover::VescsOnCan.folder(test);
    then(&|| Base::of(&folder.path, "rover on VESCs", 2, &empty_world(), &[]));
}

/// An empty hall.
fn empty_world() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml")
}

#[test]
fn a_rover_on_vescs_moves_as_commanded_and_knows_where_it_is() {
    on_vescs("vescs-move", |rover| {
        let mut base = rover();
        for twist in [(0.25, 0.0, 0.0), (0.2, 0.0, 0.5), (0.0, 0.0, -0.6), (-0.2, 0.0, 0.0)] {
            base.drive(twist, 5.0);
            base.pass(4.0);
            let velocity = base.observed.borrow().velocity.clone();
            let measured = [velocity.vx - twist.0, velocity.vy - twist.1, velocity.omega - twist.2];
            assert!(measured.iter().all(|gap| gap.abs() < 0.02), "{twist:?}: {velocity:?}");
            base.pass(3.0);
            base.assert_located("rover on VESCs");
        }
        base.go("rover on VESCs", [13.0, 8.0, 0.0], 60.0);
    });
}

#[test]
fn a_rover_on_vescs_stops_if_one_is_lost_or_the_driver_is() {
    on_vescs("vescs-stop", |rover| {
        let driving = || {
            let mut base = rover();
            base.drive((0.25, 0.0, 0.3), 8.0);
            base.pass(2.0);
            base.observed.borrow_mut().stopped.clear();
            base
        };
        for (victim, name) in [(1, "left"), (2, "right")] {
            for fault in ["silent", "fault", "reboot", "runaway"] {
                let mut base = driving();
                let since = base.machine.now();
                let (target, fault) = (name.into(), fault.to_owned());
                let what = format!("{fault} of {name}");
                base.machine.inject(since, CmdFault { target, fault, value: 0.5, duration: 5.0, ..Default::default() });
                base.pass(3.0);
                base.assert_stopped(&what, since, STOP_MAX, Some(victim));
            }
        }
        for hangs in [true, false] {
            driving().assert_stops_without_its_driver("rover on VESCs", hangs, 3.0);
        }
    });
}

/// What is on the serial lines of the rover, in place of its CAN bus.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lines {
    /// A VESC on a UART for each wheel.
    Vescs,
    /// One RoboClaw for both. A GPIO line cuts the motors' feed, since its command time limit cannot be proven.
    RoboClaw,
}

impl Lines {
    const BOTH: [Self; 2] = [Self::Vescs, Self::RoboClaw];

    /// The rover without a CAN bus.
    fn rover(self, test: &str, then: impl FnOnce(&dyn Fn() -> Base)) {
        let rover = if self == Self::Vescs { Rover::VescsOnUarts } else { Rover::RoboClaw };
        let folder = rover.folder(test);
        then(&|| Base::of(&folder.path, &format!("rover on {self:?}"), 2, &empty_world(), &[]));
    }

    /// The line of the right wheel.
    fn right(self) -> &'static str {
        if self == Self::Vescs { "serial.right" } else { "serial.wheels" }
    }
}

#[test]
fn a_rover_on_serial_lines_goes_to_a_place_and_knows_where_it_is() {
    for lines in Lines::BOTH {
        lines.rover("lines-move", |rover| {
            let (mut base, name) = (rover(), format!("{lines:?}"));
            for twist in [(0.25, 0.0, 0.0), (0.2, 0.0, 0.5), (-0.2, 0.0, 0.0)] {
                base.drive(twist, 5.0);
                base.pass(4.0);
                let velocity = base.observed.borrow().velocity.clone();
                let measured = [velocity.vx - twist.0, velocity.vy - twist.1, velocity.omega - twist.2];
                assert!(measured.iter().all(|gap| gap.abs() < 0.02), "{name}, {twist:?}: {velocity:?}");
                base.pass(3.0);
                base.assert_located(&name);
            }
            base.go(&name, [13.0, 8.0, 0.0], 60.0);
        });
    }
}

#[test]
fn a_rover_on_serial_lines_stops_if_a_line_is_cut_or_garbled_or_a_wheel_does_not_turn() {
    // Of the right wheel, or of its line; the most that it may take until the robot brakes.
    let of_wheel = ["silent", "garbled", "fault", "reboot", "runaway"].map(|fault| (None, fault, STOP_MAX));
    let of_encoder = [(None, "encoder", WRONG_MAX)];
    for lines in Lines::BOTH {
        let of_line = ["cut", "noise"].map(|fault| (Some(lines.right()), fault, STOP_MAX));
        lines.rover("lines-stop", |rover| {
            for (line, fault, most) in of_wheel.into_iter().chain(of_encoder).chain(of_line) {
                let mut base = rover();
                base.drive((0.25, 0.0, 0.3), 14.0);
                base.pass(2.0);
                let (target, what) = (line.unwrap_or("right").to_owned(), format!("{lines:?}: {fault} of {line:?}"));
                let value = match fault {
                    "encoder" => 0.0,
                    "garbled" => 1.0,
                    "noise" => 0.5,
                    _ => 0.3,
                };
                let since = base.machine.now();
                base.observed.borrow_mut().errors.clear();
                let command = CmdFault { target, fault: fault.into(), value, duration: 5.0, ..Default::default() };
                base.machine.inject(since, command);
                // The deceleration of the body shows that the other wheel brakes.
                let before = base.truth().speed;
                base.pass(most.as_secs_f64() + 0.1);
                let first =
                    base.observed.borrow().errors.first().map(|(at, message)| (at.since(since), message.clone()));
                assert!(first.as_ref().is_some_and(|(took, _)| *took <= most), "{what}: {first:?}");
                let after = base.truth().speed;
                // A wheel that is too fast, or whose encoder is dead, is still there, and turns as its drive lets it.
                if ["runaway", "encoder"].contains(&fault) {
                    let velocity = base.observed.borrow().velocity.clone();
                    assert!(velocity.quick_stop && !velocity.ready, "{what}: {velocity:?}");
                } else {
                    // A RoboClaw that is cut off lets its motors roll, as is assumed of it.
                    let least = if lines == Lines::Vescs { 0.05 } else { 0.01 };
                    assert!(after < before - least, "{what}: {before} m/s, then {after} m/s");
                    base.pass(3.0);
                    base.assert_stands(&what);
                    // The fault ends, and the source goes on: nothing resumes by itself.
                    base.pass(4.0);
                    base.assert_stands(&what);
                }
            }
        });
    }
}

#[test]
fn a_rover_on_serial_lines_stops_without_its_driver() {
    for lines in Lines::BOTH {
        lines.rover("lines-driver", |rover| {
            for hangs in [true, false] {
                let mut base = rover();
                base.drive((0.25, 0.0, 0.0), 8.0);
                base.pass(2.0);
                // A VESC brakes, a RoboClaw is assumed to let its motors roll.
                base.assert_stops_without_its_driver(&format!("rover on {lines:?}"), hangs, 5.0);
            }
        });
    }
}

/// That of the simulator, which cannot be out of range.
const GAMEPAD: &str = "\n[gamepad]\ndevice = \"file:gamepad\"\nquiet_s = 0\n";

#[test]
fn a_gamepad_turns_a_base_on_the_spot_and_moves_it_sideways() {
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("porter-gamepad-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = |name: &str| std::fs::read_to_string(conf.join("porter").join(name)).expect("the shipped configuration");
    let robot =
        file("robot.toml").replace("\"wheel.eds\"", &format!("\"{}\"", conf.join("porter/wheel.eds").display()));
    let modules = file("modules.toml");
    let (head, end) = modules.rsplit_once(']').expect("a list of modules");
    let with_gamepad = format!("{head}    {{ name = \"driver_joydev\", critical = false }},\n]{end}");
    std::fs::write(folder.join("robot.toml"), robot + GAMEPAD).expect("robot.toml");
    std::fs::write(folder.join("modules.toml"), with_gamepad).expect("modules.toml");
    std::fs::write(folder.join("sim.toml"), file("sim.toml")).expect("sim.toml");
    let mut base = Base::of(&folder, "porter with a gamepad", 4, &conf.join("worlds/empty.toml"), &[]);
    std::fs::remove_dir_all(folder).expect("the folder");

    let pad = |base: &mut Base, fault: &str, value: f64| {
        let (target, fault) = ("gamepad".into(), fault.into());
        base.machine.inject(base.machine.now(), CmdFault { timestamp: 0, target, fault, value, duration: 0.0 });
        base.pass(0.1);
    };
    pad(&mut base, "plug", 0.0);
    pad(&mut base, "hold", 0.0);
    pad(&mut base, "steering", 1.0);
    base.pass(3.0);
    let turning = base.observed.borrow().velocity.clone();
    assert_eq!(turning.source, "gamepad");
    // Without a guard its corners go at most at `guard.speed_blind_mps`.
    let (still, fast) = (turning.vx.abs() < 0.02 && turning.vy.abs() < 0.02, 0.3 / 0.375_f64.hypot(0.275));
    assert!(still && (turning.omega - fast).abs() < 0.02, "{turning:?}");
    pad(&mut base, "steering", 0.0);
    pad(&mut base, "sideways", -0.5);
    base.pass(3.0);
    let sliding = base.observed.borrow().velocity.clone();
    assert!(sliding.vx.abs() < 0.02 && sliding.vy < -0.1 && sliding.omega.abs() < 0.05, "{sliding:?}");
    pad(&mut base, "release", 0.0);
    base.pass(1.0);
    let stands = base.observed.borrow().velocity.clone();
    assert!([stands.vx, stands.vy, stands.omega].iter().all(|speed| speed.abs() < 0.01), "{stands:?}");
}
