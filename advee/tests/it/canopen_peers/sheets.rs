//! Robots whose wheels are data sheets of others: `examples/canopen_drives.py` makes a node of CANopen for Python of
//! each, and the robot is the courier with other drives, by configuration alone. Each sheet is driven, or refused with
//! object and reason; the table of the results is the one in `docs/adding-a-drive.md`.

use super::bus::Script;
use crate::command::Outcome;
use crate::support::{self, Robot, workspace};
use messages::lowlevel::{CmdMotion, CmdVelocity};
use nix::time::{ClockId, clock_gettime};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Timeout, longer than a loaded machine takes.
pub const PATIENCE: Duration = Duration::from_secs(20);
/// Folders made so far.
static FOLDERS: AtomicU32 = AtomicU32::new(0);
pub const FOLDER: &str = "buses/canopen/eds/others";
pub const WHEELS: [(u8, &str); 2] = [(1, "left"), (2, "right")];
/// Motor turns per turn of a wheel; the right one is mounted the other way round. At the courier's 0.8 m/s the motor
/// turns 1258 times a minute: the EPOS4 of the tree permits 1300 (0x6080).
const GEAR: [i32; 2] = [14, -14];
/// Radius and track of the courier's wheels, m.
const RADIUS_M: f64 = 0.085;
const TRACK_M: f64 = 0.42;
/// Time after which a wheel is commanded to stop when the other one's drive is gone.
const STOPPED_WITHIN: f64 = 0.3;

/// What a person adds to a sheet.
pub struct Given {
    sheet: &'static str,
    /// Lines of each wheel beside the gear.
    lines: &'static str,
    /// Velocity units of the drive at one turn of the motor per second.
    per_turn: f64,
}

/// Sheets that leave something open.
const GIVEN: [Given; 1] = [Given { sheet: "ros2_cia402_slave.eds", lines: "counts_per_turn = 4096", per_turn: 4096.0 }];

/// Of a sheet that states its units: rpm.
const STATED: Given = Given { sheet: "", lines: "", per_turn: 60.0 };

pub fn given(sheet: &str) -> &'static Given {
    GIVEN.iter().find(|given| given.sheet == sheet).unwrap_or(&STATED)
}

/// Folder of a robot: the courier's measures and limits, and these wheels.
pub fn robot(sheet: &Path, given: &Given) -> PathBuf {
    let name = sheet.file_name().expect("a file").to_str().expect("UTF-8");
    // Both tests try the same sheet, at the same time.
    let (process, number) = (std::process::id(), FOLDERS.fetch_add(1, Ordering::Relaxed));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("sheet-{name}-{process}-{number}"));
    fs::create_dir_all(&folder).expect("a folder");
    fs::copy(sheet, folder.join(name)).expect("a sheet of the tree");
    let courier = fs::read_to_string(workspace().join("conf/courier/robot.toml")).expect("the courier");
    let mut text = String::new();
    for table in ["[robot]", "[base]", "[geometry]", "[limits]", "[stop]"] {
        let begin = courier.find(table).expect("a table of the courier");
        let end = courier[begin + 1..].find("\n[").map_or(courier.len(), |end| begin + end + 2);
        text += &courier[begin..end];
    }
    // Without a port it follows that of LCM.
    text += "[can.main]\ninterface = \"udp:239.74.163.2\"\n\n";
    for ((id, axis), gear) in WHEELS.into_iter().zip(GEAR) {
        writeln!(text, "[[can.main.nodes]]\nid = {id}\naxis = \"{axis}\"\ndriver = \"cia402\"\neds = \"{name}\"")
            .expect("a string");
        writeln!(text, "gear = {gear}\n{}\n", given.lines).expect("a string");
    }
    fs::write(folder.join("robot.toml"), text).expect("a file");
    fs::write(folder.join("modules.toml"), "[[modules]]\nname = \"driver_canbus\"\ncritical = true\n").expect("a file");
    folder
}

/// Velocities of the wheels' drives in their units: `forward` in m/s, `rotation` to the left in rad/s.
pub fn velocities(given: &Given, forward: f64, rotation: f64) -> [i32; 2] {
    let treads = [forward - rotation * TRACK_M / 2.0, forward + rotation * TRACK_M / 2.0];
    let turns = |tread: f64| tread / (std::f64::consts::TAU * RADIUS_M);
    let drive = |side: usize| (turns(treads[side]) * f64::from(GEAR[side]) * given.per_turn).round() as i32;
    [drive(0), drive(1)]
}

/// Line of the script: what a drive reports.
#[derive(Clone, Debug)]
pub struct Line {
    /// Monotonic time, s.
    pub at: f64,
    pub node: u8,
    pub text: String,
}

impl Line {
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.splitn(3, ' ');
        let (at, node) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        Some(Self { at, node, text: words.next()?.into() })
    }

    pub fn number(&self, what: &str) -> Option<i32> {
        self.text.strip_prefix(what)?.trim().parse().ok()
    }
}

/// Monotonic time of this machine, s, as the script reports it.
pub fn monotonic() -> f64 {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("a clock");
    now.tv_sec() as f64 + now.tv_nsec() as f64 * 1e-9
}

/// Nodes in a process, and all that they have reported.
pub struct Drives {
    pub script: Script,
    log: Vec<Line>,
    /// The first line to be searched.
    from: usize,
}

impl Drives {
    /// Drives of a sheet on the bus of a robot with this port; `None`, with a report, without a Python that has the
    /// peers; the reason, if the sheet cannot be loaded.
    pub fn start(lcm_port: u16, nodes: &[u8], sheet: &Path) -> Option<Result<Self, String>> {
        let bus = format!("udp:239.74.163.2:{}", robot::topology::can_port_beside(lcm_port));
        let nodes = nodes.iter().map(|node| format!("{node}={}", sheet.display()));
        let args: Vec<String> = std::iter::once(bus).chain(nodes.clone()).collect();
        Self::run("examples/canopen_drives.py", &args, nodes.len())
    }

    /// The same with this script and its arguments, which makes this number of nodes.
    pub fn run(file: &str, args: &[String], count: usize) -> Option<Result<Self, String>> {
        let mut drives = Self { script: Script::run(file, args)?, log: Vec::new(), from: 0 };
        let begin = Instant::now();
        while drives.log.iter().filter(|line| line.text.starts_with("ready")).count() < count {
            if let Some(errors) = drives.script.failed() {
                return Some(Err(errors));
            }
            assert!(begin.elapsed() < PATIENCE, "{file} does not start");
            drives.read();
        }
        Some(Ok(drives))
    }

    pub fn read(&mut self) {
        std::thread::sleep(Duration::from_millis(2));
        while let Some(line) = self.script.heard() {
            self.log.extend(Line::parse(&line));
        }
    }

    /// Lines that come from now on.
    pub fn anew(&mut self) {
        self.read();
        self.from = self.log.len();
    }

    /// Waits for a line of a node.
    #[track_caller]
    pub fn until(&mut self, node: u8, what: &str, is_it: impl Fn(&Line) -> bool) -> Line {
        let begin = Instant::now();
        loop {
            let mut lines = self.log[self.from..].iter();
            if let Some(line) = lines.find(|line| line.node == node && is_it(line)) {
                return line.clone();
            }
            let last = &self.log[self.log.len().saturating_sub(20)..];
            assert!(begin.elapsed() < PATIENCE, "node {node} does not report: {what}; {last:#?}");
            self.read();
        }
    }

    /// Waits until a node moves at a velocity, within 2 %.
    #[track_caller]
    pub fn until_velocity(&mut self, node: u8, velocity: i32) -> Line {
        let near = |it: i32| (it - velocity).abs() <= velocity.abs() / 50 + 1 && it.signum() == velocity.signum();
        self.until(node, &format!("velocity {velocity}"), |line| line.number("velocity").is_some_and(near))
    }

    /// True if there is such a line since [`Self::anew`].
    pub fn has(&self, is_it: impl Fn(&Line) -> bool) -> bool {
        self.log[self.from..].iter().any(is_it)
    }

    /// Last state of a node.
    fn state(&self, node: u8) -> &str {
        let mut lines = self.log.iter().rev().filter(|line| line.node == node);
        lines.find_map(|line| line.text.strip_prefix("state ")).unwrap_or("switch on disabled")
    }

    /// What the drives refused: nothing, by a master that knows the standard and the sheet.
    fn refused(&self) -> Vec<&Line> {
        self.log.iter().filter(|line| line.text.starts_with("refused")).collect()
    }
}

/// Command that is ended with the test, whatever its outcome.
pub struct Command(pub Child);

impl Drop for Command {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Processes that are stopped, so that nothing of them is on the bus, and ended with the test.
struct Silenced(Vec<u32>);

impl Silenced {
    fn of(robot: &Robot) -> Self {
        let processes = Self(robot.processes());
        processes.signal("STOP");
        processes
    }

    fn signal(&self, name: &str) {
        self.0.iter().for_each(|pid| support::signal(*pid as i32, name));
    }
}

impl Drop for Silenced {
    fn drop(&mut self) {
        self.signal("KILL");
    }
}

/// Drives a robot of these two drives by its commands, stops it, and takes the master away. Gives what the drives do
/// without their master.
fn driven(sheet: &Path, given: &Given, folder: &Path) -> Option<String> {
    let forward = velocities(given, 0.2, 0.0);
    let ids = WHEELS.map(|(id, _)| id);
    let config = folder.to_str().expect("UTF-8");

    // Enabled, at the velocity that is commanded, and stopped by quick stop at the end of the robot.
    let mut robot = Robot::of(folder);
    let mut drives = Drives::start(robot.port, &ids, sheet)?.expect("CANopen for Python loads it");
    let command = Command(robot.spawn(&["--config", config, "drive", "0.2", "0", "--for", "60"]));
    for (id, velocity) in ids.into_iter().zip(forward) {
        drives.until(id, "enabled", |line| line.text == "state operation enabled");
        drives.until_velocity(id, velocity);
    }
    drives.anew();
    assert_eq!(robot.stop(), 0);
    for id in ids {
        let stopped = drives.until(id, "quick stop", |line| line.text == "state quick stop active");
        let stands = drives.until(id, "standing", |line| line.number("velocity") == Some(0));
        // 0.2 m/s by 1.5 m/s²: not at once, but by its ramp.
        assert!(stands.at - stopped.at > 0.1, "{stopped:?}, {stands:?}");
    }
    assert_eq!(drives.refused().len(), 0, "{:?}", drives.refused());
    drop((command, robot, drives));

    // The same drives notice that their master is gone.
    let robot = Robot::of(folder);
    let mut drives = Drives::start(robot.port, &ids, sheet)?.expect("CANopen for Python loads it");
    let command = Command(robot.spawn(&["--config", config, "drive", "0.2", "0", "--for", "60"]));
    for (id, velocity) in ids.into_iter().zip(forward) {
        drives.until_velocity(id, velocity);
    }
    drives.anew();
    let silenced = Silenced::of(&robot);
    let gone = monotonic();
    for id in ids {
        let lost = drives.until(id, "its master is lost", |line| line.text == "master lost");
        assert!(lost.at - gone < 0.5, "after {} s", lost.at - gone);
        drives.until(id, "standing", |line| line.number("velocity") == Some(0));
    }
    let states = ids.map(|id| drives.state(id).to_owned());
    assert_eq!(states[0], states[1]);
    assert_eq!(drives.refused().len(), 0, "{:?}", drives.refused());
    drop((silenced, command));
    Some(states[0].clone())
}

/// Row of the table, asserted on the way.
fn row(sheet: &Path) -> Option<String> {
    let name = sheet.file_name().expect("a file").to_str().expect("UTF-8");
    let given = given(name);
    let folder = robot(sheet, given);
    let lines = if given.lines.is_empty() { "`gear`" } else { "`gear`, `counts_per_turn`" };

    // On the bus: what identifies the nodes knows the sheet.
    let port = support::unique_port();
    let run_dir = folder.join("run");
    let run = |args: &[&str]| {
        let mut command = support::advee(&format!("udpm://239.255.76.67:{port}?ttl=0"), &run_dir);
        Outcome::within(command.args(args), PATIENCE)
    };
    let nodes = match Drives::start(port, &[1, 2], sheet)? {
        Err(errors) => {
            assert!(errors.contains("CANopen for Python cannot load it"), "{errors}");
            "cannot be loaded".into()
        }
        Ok(_drives) => {
            let interface = format!("udp:239.74.163.2:{}", robot::topology::can_port_beside(port));
            let (eds, config) = (sheet.display().to_string(), folder.display().to_string());
            let command = ["identify", "--from", "1", "--to", "2", "--interface", &interface, "--eds", &eds];
            let found = run(&[&["can"][..], &command, &["--config", &config]].concat()).good();
            let drives = found.matches("driver = \"cia402\"").count();
            let why = ["No drive of CiA 402: ", "Not driven by ", "It states no vendor (0x1018:1)"];
            let refused = found.lines().filter(|line| why.iter().any(|why| line.contains(why))).count();
            match (drives, refused) {
                (2, 0) => String::from("identified"),
                (0, 2) => String::from("refused"),
                _ => panic!("{found}"),
            }
        }
    };

    let check = run(&["config", "check", &folder.display().to_string()]);
    let result = if check.code == Some(0) {
        let alone = driven(sheet, given, &folder)?;
        format!("driven; without its master: {alone}")
    } else {
        let refusal = check.refused();
        let (_, why) = refusal.split_once("the left drive is refused: ").expect("a refusal of the drive");
        let up = run(&["up", "--headless", "--config", &folder.display().to_string()]);
        assert!(up.refused().contains(why), "it starts nevertheless");
        format!("refused: {why}")
    };
    assert_eq!(nodes == "identified", result.starts_with("driven"), "{name}: {nodes}, {result}");
    fs::remove_dir_all(&folder).expect("the folder is there");
    Some(format!("| {name} | {nodes} | {lines} | {result} |"))
}

fn sheets() -> Vec<PathBuf> {
    let entries = fs::read_dir(workspace().join(FOLDER)).expect("data sheets");
    let is_sheet = |path: &PathBuf| path.extension().is_some_and(|end| end == "eds" || end == "dcf");
    let mut sheets: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).filter(is_sheet).collect();
    sheets.sort();
    sheets
}

#[test]
fn foreign_sheets_are_driven_as_python_nodes_or_refused_as_the_guide_says() {
    let mut table = String::new();
    for sheet in sheets() {
        let Some(row) = row_undisturbed(&sheet) else { return };
        writeln!(table, "{row}").expect("a string");
    }
    assert!(table.matches("| driven; ").count() >= 2, "{table}");
    let guide = fs::read_to_string(workspace().join("docs/adding-a-drive.md")).expect("the guide");
    assert!(guide.contains(&table), "docs/adding-a-drive.md has another table than this one:\n{table}");
}

fn row_undisturbed(sheet: &Path) -> Option<String> {
    let found = std::cell::RefCell::new(None);
    support::undisturbed(|| *found.borrow_mut() = row(sheet));
    found.into_inner()
}

/// A differential robot whose wheels are two processes: straight on, a turn on the spot, a curve; then one dies.
#[test]
fn foreign_sheets_make_a_differential_robot_that_stops_when_one_of_its_drives_dies() {
    support::undisturbed(|| {
        let _skipped = differential("ros2_cia402_slave.eds");
    });
}

fn differential(name: &str) -> Option<()> {
    let (sheet, given) = (workspace().join(FOLDER).join(name), given(name));
    let folder = robot(&sheet, given);
    let mut robot = Robot::of(&folder);
    let config = folder.to_str().expect("UTF-8");
    let start = |node| Some(Drives::start(robot.port, &[node], &sheet)?.expect("CANopen for Python loads it"));
    let (mut left, mut right) = (start(1)?, start(2)?);

    // Straight on, and on the spot to the left, by the command line.
    for (arguments, forward, rotation) in [
        (&["drive", "0.2", "0", "--for", "60"][..], 0.2, 0.0),
        (&["drive", "0", "--rotation", "0.6", "--for", "60"], 0.0, 0.6),
    ] {
        left.anew();
        right.anew();
        let mut command = Command(robot.spawn(&[&["--config", config], arguments].concat()));
        let wanted = velocities(given, forward, rotation);
        left.until_velocity(1, wanted[0]);
        right.until_velocity(2, wanted[1]);
        left.anew();
        right.anew();
        support::signal(command.0.id() as i32, "INT");
        assert!(command.0.wait().expect("it ends").success());
        left.until(1, "standing", |line| line.number("velocity") == Some(0));
        right.until(2, "standing", |line| line.number("velocity") == Some(0));
    }

    // A curve to the right, by LL_CMD_VELOCITY.
    left.anew();
    right.anew();
    let wanted = velocities(given, 0.2, -0.4);
    assert!(wanted[0] > 0 && wanted[1] < 0 && wanted[0] > -wanted[1], "{wanted:?}");
    let reaches = |drives: &Drives, node: u8, wanted: i32| {
        let mut lines = drives.log[drives.from..].iter().filter(|line| line.node == node);
        lines.any(|line| line.number("velocity").is_some_and(|it| (it - wanted).abs() <= wanted.abs() / 50))
    };
    let begin = Instant::now();
    // A command that was late stops the robot until zero is commanded, so it begins anew each three seconds.
    let mut drives = (0..60).map(|round| round > 3).cycle();
    while !(reaches(&left, 1, wanted[0]) && reaches(&right, 2, wanted[1])) {
        assert!(begin.elapsed() < PATIENCE, "not {wanted:?}: {:?}, {:?}", left.log.last(), right.log.last());
        curve(&mut robot, drives.next().unwrap_or(true));
        left.read();
        right.read();
    }

    // The left drive dies while the command goes on: the right one gets a quick stop, and is not moved again.
    right.anew();
    let died = monotonic();
    drop(left);
    let begin = Instant::now();
    let stopped = loop {
        curve(&mut robot, true);
        right.read();
        if let Some(line) = right.log[right.from..].iter().find(|line| line.text == "state quick stop active") {
            break line.clone();
        }
        assert!(begin.elapsed() < PATIENCE, "the right drive is not stopped: {:?}", right.log.last());
    };
    assert!(stopped.at - died <= STOPPED_WITHIN, "stopped after {} s", stopped.at - died);
    right.until(2, "standing", |line| line.number("velocity") == Some(0));
    robot.until("the loss is reported", 10.0, |view| {
        view.errors.iter().any(|error| error.message.contains("left drive (node 1)"))
    });
    right.anew();
    for _ in 0..20 {
        curve(&mut robot, true);
        right.read();
    }
    assert!(right.log[right.from..].iter().all(|line| line.number("target").is_none_or(|target| target == 0)));
    assert_eq!(right.refused().len(), 0, "{:?}", right.refused());
    drop(robot);
    fs::remove_dir_all(&folder).expect("the folder is there");
    Some(())
}

/// Command of a program for 50 ms: 0.2 m/s, 0.4 rad/s to the right; or standstill.
fn curve(robot: &mut Robot, drives: bool) {
    let (vx, omega) = if drives { (0.2, -0.4) } else { (0.0, 0.0) };
    robot.publish(CmdVelocity {
        timestamp: 0,
        vx,
        vy: 0.0,
        omega,
        priority: CmdMotion::REMOTE,
        source: "test".into(),
        session: 1,
    });
    robot.pass(0.05);
}
