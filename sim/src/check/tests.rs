//! Each rule, kept and violated, with scripted news.
//!
//! A script has one step per line: `+251` lets time pass, a word with arguments makes news ([`Bench::act`]). Every rule
//! holds after every step, unless the line ends with `! rule`: that rule must be the first to be violated there.

use super::*;
use base::can::Frame;
use messages::{lowlevel, middlelevel, simulation};
use module::ExitStatus;
use module::admission::{Process, Way};
use std::collections::BTreeMap;

mod bounded;
mod controllers;
mod others;
mod sight;
mod stopping;
mod wheels;

const WATCHDOG: u32 = 1;
const DRIVER: u32 = 3;

/// Controlword and target in this RPDO, the statusword first in these TPDOs.
fn drive(node: u8, command: u16, reports: &[u16]) -> wire::Drive {
    let first = |id| wire::Place { id, at: 0 };
    wire::Drive {
        protocol: wire::Protocol::Canopen,
        bus: 0,
        node,
        command: first(command),
        target: 2,
        reports: reports.iter().copied().map(first).collect(),
    }
}

fn limits() -> Limits {
    Limits {
        driver: "driver".into(),
        watchdog: "watchdog".into(),
        planner: "planner".into(),
        critical: vec!["power".into(), "driver".into()],
        power: Some("power".into()),
        stops: Vec::new(),
        estimator: None,
        commands: Commands::Host,
        buses: vec!["can".into()],
        wheels: vec![wire::Wheel {
            name: "propulsion".into(),
            drive: drive(1, 0x501, &[0x181, 0x481]),
            stop_word: 0x0B,
            units_per_mps: 1000.0,
        }],
        steering: Some(drive(2, 0x302, &[0x182, 0x282])),
        base: None,
        homed: 0x8000,
        speed: 1.2,
        steering_angle: 0.6,
        wheelbase: 0.6,
        tread_ratio: 1.0,
        rotation: 1.36,
        feed_is_cut: true,
        speed_manual: 0.6,
        speed_autonomous: 0.8,
        quick_stop: 1.5,
        coasting: None,
        ttl: Duration::from_millis(250),
        ranging: [("front", 0x10), ("rear", 0x11)]
            .map(|(name, address)| RangingBoard {
                name: name.into(),
                module: "ranges".into(),
                bus: "rs485".into(),
                crc: rs485::crc::Crc8::SAE_J1850,
                address,
                forward: name == "front",
                backward: name == "rear",
                sonars: if name == "front" { vec![(0, navitools::Pose::new(0.75, 0.0, 0.0))] } else { Vec::new() },
            })
            .into(),
        homing_at_start: false,
        guard: Some(Guarded { module: "guard".into(), creep_mps: 0.15 }),
        promise: Some(Promise { reaction_s: 0.37, braking_mps2: 0.8, beam_rad: 0.96 }),
        sight: None,
        restart_max: Duration::from_secs(2),
    }
}

/// A machine without faults unless a script injects them.
struct Bench {
    checkers: Checkers,
    now: Instant,
    /// Process of each module.
    pids: BTreeMap<String, u32>,
    /// Modules and drives that are silent; the others send something every 50 ms.
    quiet: Vec<String>,
    /// Position and speed of the body.
    x: f64,
    y: f64,
    theta: f64,
    speed: f64,
    steering: f64,
    /// Rotation of the body, rad/s.
    rotation: f64,
    /// Distance from the nearest obstacle, m.
    clearance: f64,
    /// It moves at its speed.
    rolls: bool,
    /// Process that simulates the body.
    simulator: u32,
    /// Way of the next message.
    way: Way,
}

impl Bench {
    /// All modules have run for a second; no source commands.
    fn new() -> Self {
        Self::with(limits())
    }

    fn with(limits: Limits) -> Self {
        let rolls = limits.base.is_some();
        let checkers = Checkers::new(limits);
        // A propulsion without another wheel is not watched.
        let quiet = if rolls { vec![] } else { vec!["propulsion".into()] };
        let (now, pids) = (Instant::ZERO, BTreeMap::new());
        let mut bench = Self {
            checkers,
            now,
            pids,
            quiet,
            x: 0.0,
            y: 0.0,
            theta: 0.0,
            speed: 0.0,
            steering: 0.0,
            rotation: 0.0,
            clearance: 1.0,
            rolls,
            simulator: 0,
            way: Way::Memory,
        };
        for module in ["watchdog", "power", "driver", "guard"] {
            bench.start(module);
            bench.tell(&News::State { module, state: State::Run });
        }
        bench.pass(1000);
        bench
    }

    fn tell(&mut self, news: &News<'_>) {
        self.checkers.observe(self.now, news);
    }

    fn start(&mut self, module: &str) {
        let pid = self.pids.get(module).map_or(self.pids.len() as u32 + 1, |last| last + 100);
        self.pids.insert(module.into(), pid);
        self.tell(&News::Started { module, pid });
    }

    fn pass(&mut self, ms: u64) {
        let end = self.now + Duration::from_millis(ms);
        while self.now < end {
            let next = Instant::from_millis((self.now.as_nanos() / 50_000_000 + 1) * 50);
            self.now = next.min(end);
            if self.now == next {
                self.usual();
            }
        }
    }

    fn usual(&mut self) {
        for (who, says) in [
            ("propulsion", "frame 701 05"),
            ("steering", "frame 702 05"),
            ("watchdog", "list power,driver"),
            ("power", "line free"),
            ("front", "answer 10"),
            ("rear", "answer 11"),
            ("guard", "guard 2 2"),
        ] {
            if !self.quiet.iter().any(|quiet| quiet == who) {
                self.act(&says.split(' ').collect::<Vec<_>>());
            }
        }
        // A body that turns by its wheels is judged by its way.
        self.x += if self.rolls { self.speed * 0.05 * libm::cos(self.theta) } else { 0.0 };
        self.y += if self.rolls { self.speed * 0.05 * libm::sin(self.theta) } else { 0.0 };
        self.theta += self.rotation * 0.05;
        self.truth();
    }

    fn truth(&mut self) {
        let &mut Self { x, y, theta, speed, steering, clearance, .. } = self;
        let truth = simulation::DataTruth { x, y, theta, speed, steering, clearance, ..Default::default() };
        self.sent(self.simulator, truth);
    }

    fn sender(&self, pid: u32) -> Sender {
        Sender { way: self.way, process: (self.way == Way::Memory).then_some(Process { pid, uid: 0 }) }
    }

    fn sent(&mut self, pid: u32, message: impl Into<Message>) {
        let sender = self.sender(pid);
        self.tell(&News::Message { sender, message: &message.into() });
    }

    /// Sent, and served to the driver at once.
    fn served(&mut self, pid: u32, message: impl Into<Message>) {
        let (message, sender) = (message.into(), self.sender(pid));
        self.tell(&News::Message { sender, message: &message });
        self.tell(&News::Heard { pid: self.pids["driver"], at: self.now, sender, message: &message });
    }

    fn frame(&mut self, id: u16, data: &[u8]) {
        self.frame_of(DRIVER, id, data);
    }

    fn frame_of(&mut self, pid: u32, id: u16, data: &[u8]) {
        self.tell(&News::Can { bus: "can", pid, frame: Frame::standard(id, data) });
    }

    /// An RPDO4 of the propulsion.
    fn set_point(&mut self, controlword: u8, mps: f64) {
        self.set_point_of(0x501, controlword, mps);
    }

    fn set_point_of(&mut self, id: u16, controlword: u8, mps: f64) {
        let rpm = ((mps * 1000.0) as i32).to_le_bytes();
        self.frame(id, &[controlword, 0, rpm[0], rpm[1], rpm[2], rpm[3]]);
    }

    fn words(&mut self, what: &str, address: u8) {
        self.distances(what, address, 1000);
    }

    /// The same, with this distance of each sonar, mm.
    fn distances(&mut self, what: &str, address: u8, distance: u16) {
        use rs485::boards::sd1;
        let both = sd1::Both { srfs: [distance; 8].into_iter().collect(), irs: [120; 2].into_iter().collect() }.build();
        let data = if ["answer", "garbled"].contains(&what) { &both[..] } else { &[] };
        let flags = u8::from(what == "refusal");
        let frame = rs485::frame::Frame { address, instruction: sd1::GET_BOTH_DATA.code, flags, data };
        let mut words = rs485::frame::Words::new();
        frame.encode(rs485::crc::Crc8::SAE_J1850, &mut words);
        if what == "garbled" {
            words[6].byte ^= 1;
        }
        self.tell(&News::Words { bus: "rs485", pid: 9, words: &words });
        self.tell(&News::Words { bus: "elsewhere", pid: 9, words: &words });
    }

    fn rows(&mut self, processes: Vec<common::Process>) {
        self.served(WATCHDOG, common::DataProcesses { timestamp: micros(self.now), processes });
    }

    #[track_caller]
    fn act(&mut self, words: &[&str]) {
        match *words {
            [] => {}
            // Motion commands: with permission to move; sent only; received some ms ago.
            ["begin", source, speed] => {
                self.act(&["say", source, "0"]);
                self.pass(10);
                self.act(&["say", source, speed]);
                self.set_point(0x0F, number(speed).clamp(-0.6, 0.6));
            }
            ["say", source, speed] => self.served(0, motion_command(source, number(speed))),
            ["velocity", source, vx, omega] => {
                let lowlevel::CmdMotion { priority, source, .. } = motion_command(source, 0.0);
                let (vx, omega) = (number(vx), number(omega));
                self.served(0, lowlevel::CmdVelocity { vx, omega, priority, source, ..Default::default() });
            }
            ["say", source, speed, ago] => {
                let at = Instant::from_nanos(self.now.as_nanos() - ago.parse::<u64>().unwrap() * 1_000_000);
                let message = &motion_command(source, number(speed)).into();
                let sender = self.sender(0);
                self.tell(&News::Heard { pid: DRIVER, at, sender, message });
            }
            ["goal"] => {
                let waypoints = vec![middlelevel::Waypoint::default()];
                self.served(0, middlelevel::CmdGoal { waypoints, ..Default::default() });
            }
            ["mode", mode] => {
                let mode = middlelevel::CmdMode::from_name(mode).unwrap();
                self.served(0, middlelevel::CmdMode { mode, ..Default::default() });
            }
            ["estimate"] => {
                let quality = middlelevel::DataEstimate::FINE;
                self.served(0, middlelevel::DataEstimate { quality, ..Default::default() });
            }
            // On the CAN bus: set-points, quick stops, any frame.
            ["drive", speed] => self.set_point(0x0F, number(speed)),
            ["drive", controlword, speed] => self.set_point(byte(controlword), number(speed)),
            ["stop"] => self.set_point(0x0B, 0.0),
            // Of two wheels, the left one first.
            ["wheels", left, right] => {
                for (id, speed) in [(0x501, left), (0x302, right)] {
                    let (controlword, mps) = if speed == "stop" { (0x0B, 0.0) } else { (0x0F, number(speed)) };
                    self.set_point_of(id, controlword, mps);
                }
            }
            // `other`: of another master.
            [what @ ("frame" | "other"), id, ref data @ ..] => {
                let data: Vec<u8> = data.iter().map(|text| byte(text)).collect();
                let pid = if what == "other" { 0 } else { DRIVER };
                self.frame_of(pid, u16::from_str_radix(id, 16).unwrap(), &data);
            }
            // The body, and the driver's report of it.
            ["speed", speed] => self.speed = number(speed),
            ["rotation", rotation] => self.rotation = number(rotation),
            ["clearance", clearance] => self.clearance = number(clearance),
            ["truth", speed] => {
                self.speed = number(speed);
                self.truth();
            }
            ["motion", homed, source, speed] => {
                let (timestamp, homed, speed_target) = (micros(self.now), homed == "homed", number(speed));
                let source = source.trim_matches('-').into();
                let motion = lowlevel::DataMotion { timestamp, homed, speed_target, source, ..Default::default() };
                self.sent(if self.way == Way::Memory { DRIVER } else { 0 }, motion);
            }
            // Faster by `step` m/s, or the wheels turned by `step` rad, at each of so many samples, 50 ms apart.
            [what @ ("faster" | "turn"), step, samples] => {
                for _ in 0..samples.parse().unwrap() {
                    *(if what == "turn" { &mut self.steering } else { &mut self.speed }) += number(step);
                    self.pass(50);
                }
            }
            // Another process simulates the body, from this angle on.
            ["simulator", pid, angle] => (self.simulator, self.steering) = (pid.parse().unwrap(), number(angle)),
            ["line", what] => self.act(&["line", what, "button"]),
            ["line", what, source] => {
                let pid = self.pids["power"].to_string();
                self.act(&["line", what, source, "by", &pid]);
            }
            ["line", what, source, "by", pid] => {
                let (engaged, source) = (what == "engaged", source.into());
                self.served(pid.parse().unwrap(), lowlevel::EventStop { timestamp: 0, engaged, source });
            }
            // A sender of another user, or of another computer.
            [by @ ("host" | "network"), ref rest @ ..] => {
                self.way = if by == "host" { Way::Host } else { Way::Network };
                self.act(rest);
                self.way = Way::Memory;
            }
            ["home"] => self.served(0, lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() }),
            // Bounds forward and backward, m/s; a second input.
            ["guard", forward, backward] => {
                let (forward, backward) = (number(forward), number(backward));
                let bounds = lowlevel::DataGuard { forward, backward, ..Default::default() };
                self.served(if self.way == Way::Memory { self.pids["guard"] } else { 0 }, bounds);
            }
            ["creep", held] => {
                let (source, held) = ("pad".into(), held == "held");
                self.served(0, lowlevel::CmdCreep { timestamp: 0, source, session: 0, held });
            }
            // The motors' feed: the driver switches it off, a person on.
            ["cut"] => {
                self.sent(DRIVER, lowlevel::CmdPower { timestamp: 0, device: 3, action: lowlevel::CmdPower::OFF });
            }
            ["feed"] => self.sent(0, lowlevel::CmdPower { timestamp: 0, device: 3, action: lowlevel::CmdPower::ON }),
            // On the wire of the ranging boards: a request, an answer, a refusal, an answer with a wrong CRC.
            [what @ ("ask" | "answer" | "refusal" | "garbled"), address] => self.words(what, byte(address)),
            // Processes: as listed by the watchdog, and their real state.
            ["list", running] => {
                let row = |module: &str| row(module, running.split(',').any(|name| name == module), "RUN", "RUN");
                self.rows(vec![row("power"), row("driver")]);
            }
            ["row", state, wanted] => self.rows(vec![row("power", true, state, wanted)]),
            ["quiet", who] => self.quiet.push(who.into()),
            ["start", module] => self.start(module),
            ["exit", module] => {
                let (pid, status) = (self.pids[module], ExitStatus::Signal(9));
                self.tell(&News::Exited { module, pid, status });
            }
            ["crawl", module, ms] => {
                let late = Duration::from_millis(ms.parse().unwrap());
                self.tell(&News::Crawls { module, pid: self.pids[module], late });
            }
            ["hang", module] => self.tell(&News::Hung { module, pid: self.pids[module] }),
            ["resume", module] => self.tell(&News::Resumed { module, pid: self.pids[module] }),
            ["state", module, to] => self.tell(&News::State { module, state: state(to) }),
            [by @ ("operator" | "program"), module, to] => {
                let (state, manual, source) = (state(to) as i8, by == "operator", "op".into());
                self.served(0, common::CmdState { timestamp: 0, module: module.into(), state, manual, source });
            }
            // Faults.
            ["fault", target, fault, ms] => {
                let until = self.now + Duration::from_millis(ms.parse().unwrap());
                self.tell(&News::Fault { target, fault, until });
            }
            ["dropped", whose] => self.tell(&News::Dropped { whose, count: 3 }),
            ["calm"] => self.checkers.calm(self.now),
            // Timestamps of a process on LL_DATA_ODO and LL_DATA_SRFS.
            ["odo", pid, at] => {
                let timestamp = at.parse().unwrap();
                self.sent(pid.parse().unwrap(), lowlevel::DataOdo { timestamp, ..Default::default() });
            }
            ["srfs", pid, at] => {
                let (timestamp, srfs) = (at.parse().unwrap(), Vec::new());
                self.sent(pid.parse().unwrap(), lowlevel::DataSrfs { timestamp, srfs });
            }
            _ => panic!("{words:?}"),
        }
    }

    #[track_caller]
    fn line(&mut self, line: &str) {
        let (step, rule) = line.split_once('!').map_or((line, None), |(step, rule)| (step, Some(rule.trim())));
        let mut words: Vec<&str> = step.split_whitespace().collect();
        if let Some(ms) = words.first().and_then(|word| word.strip_prefix('+')) {
            self.pass(ms.parse().unwrap());
            words.remove(0);
        }
        self.act(&words);
        let violation = self.checkers.violation();
        assert_eq!(violation.map(|violation| violation.rule), rule, "{line}: {violation:?}");
    }
}

/// Runs a script, whose last line violates a rule if any does.
#[track_caller]
fn check(script: &str) {
    check_with(Bench::new(), script);
}

#[track_caller]
fn check_with(mut bench: Bench, script: &str) {
    for line in script.lines().map(|line| line.split('#').next().unwrap().trim()).filter(|line| !line.is_empty()) {
        assert!(bench.checkers.violation().is_none(), "behind the last line: {line}");
        bench.line(line);
    }
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn byte(text: &str) -> u8 {
    u8::from_str_radix(text, 16).unwrap()
}

fn state(name: &str) -> State {
    State::from_name(name).unwrap()
}

fn micros(at: Instant) -> i64 {
    at.as_nanos() as i64 / 1000
}

fn motion_command(source: &str, speed: f64) -> lowlevel::CmdMotion {
    let priority = ["planner", "shell", "pad"].iter().position(|name| *name == source).unwrap_or(2) as i8;
    lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source: source.into() }
}

fn row(module: &str, runs: bool, is: &str, wanted: &str) -> common::Process {
    let (state, wanted) = (state(is) as i8, state(wanted) as i8);
    common::Process { module: module.into(), phase: i8::from(runs), state, wanted, ..common::Process::default() }
}

#[test]
fn a_set_point_lives_as_long_as_its_command() {
    check(
        "begin pad 0.4
        +251 drive 0.4
        +2 drive 0.4 ! fresh",
    );
}

#[test]
fn a_set_point_is_what_a_command_asks_for_or_less() {
    check("begin pad 0.4 \n drive 0.4 \n drive 0.2");
    check("begin pad 0.4 \n drive 0.45 ! fresh");
    check("begin pad 0.4 \n drive -0.4 ! fresh");
    check("begin pad 1.0 \n drive 0.7 ! fresh");
}

#[test]
fn the_last_command_counts_once_it_had_time_to_reach_the_wire() {
    check(
        "begin pad 0.4
        +50 say pad 0
        +1 drive 0.4
        +2 drive 0.4 ! fresh",
    );
}

#[test]
fn a_command_that_waited_counts_from_when_it_was_received() {
    check(
        "say pad 0
        +200 say pad 0.3 200
        drive 0.3
        +60 drive 0.3 ! fresh",
    );
}

#[test]
fn an_rpdo4_is_whole_and_its_controlword_plain() {
    check("begin pad 0.4 \n drive 1F 0.4 ! fresh");
    check("frame 501 0F 00 01 ! fresh");
}

#[test]
fn a_source_that_was_not_released_does_not_move_the_robot_after_a_stop() {
    check(
        "begin pad 0.4
        +50 say pad 0.4
        stop
        +50 say pad 0.4
        drive 0.4 ! resumes",
    );
}

#[test]
fn a_released_source_moves_the_robot_again() {
    check(
        "begin pad 0.4
        stop
        +50 begin pad 0.4
        stop
        +300 say shell 0.4   # never received before
        drive 0.4",
    );
}

#[test]
fn a_source_that_stalled_does_not_move_the_robot_again() {
    check(
        "begin pad 0.4
        +251 stop
        +300 say pad 0.4   # silence is no release
        drive 0.4 ! resumes",
    );
}

#[test]
fn the_planner_needs_a_release_and_an_estimate() {
    check(
        "goal
        estimate
        say planner 0.7
        drive 0.7
        +210 say planner 0.7
        drive 0.7 ! resumes",
    );
    check("mode home \n estimate \n say planner 0.7 \n drive 0.7");
    check("mode route \n estimate \n say planner 0.7 \n drive 0.7 ! resumes");
    check("estimate \n say planner 0.7 \n drive 0.7 ! resumes");
    check("goal \n say planner 0.7 \n drive 0.7 ! resumes");
}

#[test]
fn the_planner_continues_after_its_own_silence_but_not_after_a_stop() {
    check(
        "goal
        estimate
        say planner 0.7
        drive 0.7
        +250 stop
        +100 estimate
        say planner 0.7
        drive 0.7
        stop
        +10 say planner 0.7
        drive 0.7 ! resumes",
    );
}

#[test]
fn a_stop_for_the_planner_s_silence_is_one_although_its_next_command_overtakes_it_on_the_way_to_the_wire() {
    check(
        "goal
        estimate
        say planner 0.7
        drive 0.7
        +240 estimate
        +10 say planner 0.7
        stop              # decided before that command was served
        drive 0.7
        +50 say planner 0.7
        +10 stop          # not for silence: the commands were on time
        +10 say planner 0.7
        drive 0.7 ! resumes",
    );
}

#[test]
fn to_a_driver_that_hung_the_planner_was_silent_and_continues() {
    check(
        "goal
        estimate
        say planner 0.7
        drive 0.7
        +30 hang driver
        +225 resume driver
        estimate
        say planner 0.7 205   # waited for the driver
        say planner 0.7 5
        stop                  # decided before: the last command that it knew had expired
        drive 0.7
        +50 say planner 0.7
        +10 stop              # not for silence
        +10 say planner 0.7
        drive 0.7 ! resumes",
    );
}

#[test]
fn a_driver_that_was_restarted_needs_zero_from_every_source() {
    let restarted = "exit driver
        start driver
        state driver RUN
        line open
        list power,driver
        guard 2 2
        goal
        estimate\n";
    check(&format!("say pad 0 \n {restarted} +10 say pad 0.4 \n drive 0.4 ! resumes"));
    check(&format!("{restarted} +10 say shell 0.4   # never received before \n drive 0.4 ! resumes"));
    check(&format!("{restarted} +10 begin pad 0.4"));
    // Who has not sent it zero has not taken over.
    check(&format!(
        "say pad 0
        {restarted} say planner 0.7
        drive 0.7
        say pad 0.2
        +245 say pad 0.2
        +5 stop              # for the planner's silence
        +100 estimate
        say planner 0.7
        drive 0.7"
    ));
}

#[test]
fn after_a_manual_take_over_the_planner_waits_for_a_release() {
    check(
        "goal
        estimate
        say planner 0.7
        drive 0.7
        begin pad 0.2
        +250 stop
        +100 estimate
        say planner 0.7
        drive 0.7 ! resumes",
    );
}

#[test]
fn no_set_point_leaves_20_ms_after_pause_is_known() {
    check(
        "begin pad 0.4
        quiet power
        line engaged
        +19 drive 0.4
        +2 drive 0.4 ! pause",
    );
}

#[test]
fn under_pause_the_speed_never_rises() {
    check(
        "begin pad 0.4
        quiet power
        line engaged
        stop
        speed 0.4
        +50 speed 0.3
        +50
        +50 speed 0.2
        +50 speed 0.21
        +50 ! pause",
    );
    // Something held it, and lets it go while its wheels still turn; later it must not gain speed.
    check(
        "begin pad 0.4
        quiet power
        line engaged
        stop
        speed 0.05
        +50 clearance 0.001
        +50 speed 0.1
        +50 clearance 0.06
        +50 speed 0.05
        +50
        +50 speed 0.06
        +50 ! pause",
    );
}

#[test]
fn an_unknown_pause_line_counts_as_engaged() {
    check(
        "quiet power
        +1190 begin pad 0.4
        +10 drive 0.4 ! pause",
    );
    // A driver that has just started knows nothing.
    check(
        "quiet power
        exit driver
        start driver
        state driver RUN
        +50 begin pad 0.4 ! pause",
    );
}

#[test]
fn without_a_critical_module_nothing_moves() {
    check(
        "begin pad 0.4
        quiet watchdog
        list driver
        +1 drive 0.4
        +2 drive 0.4 ! critical",
    );
}

#[test]
fn without_a_watchdog_nothing_moves() {
    check(
        "quiet watchdog
        +240 begin pad 0.4
        +3 drive 0.4 ! critical",
    );
}

#[test]
fn both_messages_of_a_source_are_its_commands() {
    check(
        "begin pad 0.4
        +50 velocity pad 0.3 0.1
        +3 drive 0.3
        +250 drive 0.3 ! fresh",
    );
    check("begin pad 0.4 \n velocity pad 0.3 0.1 \n +3 drive 0.4 ! fresh");
    // A rotation alone is no release.
    check("begin pad 0.4 \n +50 stop \n +50 velocity pad 0 0 \n +20 velocity pad 0.3 0 \n drive 0.3");
    check("begin pad 0.4 \n +50 stop \n +50 velocity pad 0 0.1 \n +20 velocity pad 0.3 0 \n drive 0.3 ! resumes");
    check("begin pad 0.4 \n velocity shell 0.4 1.5 \n +3 drive 0.4 ! refused");
    check("begin pad 0.4 \n velocity shell 0.4 NaN \n +3 drive 0.4 ! refused");
    check("begin pad 0.4 \n velocity shell 1.3 0 \n +3 drive 0.4 ! refused");
}

#[test]
fn a_command_out_of_limits_stops_the_robot_for_its_time_to_live() {
    check("begin pad 0.4 \n say shell 1.3 \n +3 drive 0.4 ! refused");
    check("begin pad 0.4 \n say shell NaN \n +3 drive 0.4 ! refused");
    check("say shell 1.3 \n +250 begin pad 0.4");
}

#[test]
fn a_driver_that_does_not_run_does_not_act() {
    for state in ["PAUSE", "STOP", "ERROR"] {
        check(&format!("begin pad 0.4 \n state driver {state} \n +2 drive 0.4 \n +1 drive 0.4 ! idle"));
    }
}

#[test]
fn frames_that_a_driver_queued_at_the_end_of_a_hang_are_on_the_wire_within_60_ms() {
    check(
        "begin pad 0.4
        hang driver
        +50 resume driver
        state driver TERMINATE   # behind commands that have waited, too
        +4 drive 0.4
        exit driver              # what is queued outlives it
        +55 drive 0.4
        +2 drive 0.4 ! idle",
    );
}

#[test]
fn a_steering_that_is_lost_stops_the_propulsion() {
    check(
        "quiet steering
        +190 begin pad 0.4
        +5 drive 0.4 ! drives",
    );
    // A heartbeat that was sent while the bus was disturbed may have been received late.
    let disturbed = "fault can delay 1 \n +50 quiet steering \n +190 begin pad 0.4";
    check(&format!("{disturbed} \n +40 drive 0.4"));
    check(&format!("{disturbed} \n +40 drive 0.4 \n +50 drive 0.4 ! drives"));
}

#[test]
fn a_steering_in_fault_or_rebooted_stops_the_propulsion() {
    for frame in ["282 18 02", "702 00 00"] {
        check(&format!("begin pad 0.4 \n frame {frame} \n +1 drive 0.4 \n +2 drive 0.4 ! drives"));
    }
}

#[test]
fn an_unhomed_robot_is_not_driven() {
    check(
        "motion not_homed - 0
        begin pad 0.4
        motion homed pad 0.4
        motion not_homed - 0
        drive 0.4                # was on its way to the wire
        motion not_homed - 0
        +3 drive 0.4
        motion not_homed - 0 ! homed",
    );
    check("motion not_homed - 0.1 ! homed");
}

#[test]
fn the_holder_of_the_motion_keeps_it_until_released() {
    let contest = |first: &str, second: &str, end: &str| {
        check(&format!(
            "begin {first} 0.2
            motion homed {first} 0.2
            begin {second} 0.2
            motion homed {second} 0.2 {end}"
        ));
    };
    contest("shell", "pad", "");
    contest("pad", "shell", "! authority");
    contest("pad", "wheel", "! authority");
    check(
        "begin pad 0.2
        motion homed pad 0.2
        +300 begin shell 0.2
        motion homed shell 0.2
        +300 motion homed shell 0.2 ! authority",
    );
}

#[test]
fn set_points_are_those_of_the_holder_of_the_motion() {
    check(
        "begin pad 0.2
        motion homed pad 0.2
        say shell 0
        say shell 0.3
        drive 0.3       # queued before the pad took over
        +3 drive 0.2
        drive 0.3 ! authority",
    );
}

#[test]
fn a_frame_that_nobody_acknowledged_is_retransmitted_whatever_its_age() {
    let script = |fault: &str, end: &str| {
        check(&format!(
            "quiet steering      # its heartbeats count as frames of the driver here
            {fault}
            begin pad 0.4
            +400 drive 0.4 {end}"
        ));
    };
    script("fault can noise 100", "");
    script("fault can noise 100", "\n drive 0.4 ! fresh");
    script("", "! fresh");
}

#[test]
fn the_stop_has_begun_300_ms_after_a_critical_module_was_lost() {
    for lost in ["hang power", "exit power"] {
        check(&format!("begin pad 0.4 \n speed 0.4 \n {lost} \n +299 stop \n +200"));
        check(&format!("begin pad 0.4 \n speed 0.4 \n {lost} \n {} +50 ! stop", "say pad 0.4 \n +50 \n".repeat(7)));
    }
}

#[test]
fn a_drive_that_stops_by_itself_has_begun_the_stop() {
    check(
        "begin pad 0.4
        speed 0.4
        +100 exit driver
        +260 speed 0.4
        +50 speed 0.35
        +50 speed 0.3
        +50 speed 0.2
        +50 speed 0.1
        +50 speed 0
        +50",
    );
}

#[test]
fn a_short_hang_or_one_of_an_uncritical_module_is_no_loss() {
    check(&format!(
        "begin pad 0.4
        speed 0.4
        start beacons
        exit beacons
        hang power
        +150 resume power
        {}",
        "say pad 0.4 \n +50 \n".repeat(10)
    ));
}

#[test]
fn a_robot_that_nobody_moves_brakes_all_the_time() {
    // Stopped at 0.5 m/s, when its command had 200 ms to live: a stop that begins 500 ms later ends 0.33 s after that.
    let stopped = "speed 0.5 \n begin pad 0.5 \n +50 stop \n +650";
    check(&format!("{stopped} \n faster -0.075 6 \n faster -0.05 1 \n +2000"));
    // It would stand in time if it braked twice as hard from here on.
    check(&format!("{stopped} \n faster 0 2 \n faster 0 1 ! body"));
}

#[test]
fn a_robot_that_nobody_moves_comes_to_a_stand() {
    check(
        "begin pad 0.4
        speed 0.4
        +250 stop
        +550
        +50 ! body",
    );
    // Without its power stage it rolls.
    check(
        "begin pad 0.4
        speed 0.4
        +250 stop
        fault propulsion fault 0
        +2000
        truth 0.43 ! body",
    );
}

#[test]
fn what_a_driver_commanded_before_it_hung_moves_the_robot_until_the_drive_misses_it() {
    check(
        "+20 begin pad 0.4
        drive 0.4
        +10 hang driver
        speed 0.05
        +50 speed 0.1
        +50 speed 0.15
        +50 speed 0.2
        +50 speed 0.15
        +50 speed 0.1
        +50 speed 0
        +250 truth 0.1 ! body",
    );
}

#[test]
fn only_an_operator_leads_out_of_stop() {
    check(
        "operator power STOP
        state power STOP
        state power ERROR
        state power STOP
        +100 operator * RUN
        state power RUN",
    );
    for way in ["RUN", "PAUSE"] {
        check(&format!(
            "operator power RUN
            +100 operator power STOP
            state power STOP
            program power {way}
            exit power
            state power {way} ! stopped"
        ));
    }
    // The watchdog may not have heard the command: it starts the module again as it knows it.
    check(
        "fault lcm loss 900
        operator power STOP
        state power STOP
        +100 exit power
        +100 start power
        state power RUN",
    );
    check(
        "fault lcm loss 900
        operator power STOP
        state power STOP
        +300 state power RUN ! stopped",
    );
}

#[test]
fn restarts_wait_for_their_delays() {
    let start = |waits: &[u64], end: &str| {
        let starts: Vec<String> = waits.iter().map(|wait| format!("exit power \n +{wait} start power")).collect();
        check(&format!("{} {end}", starts.join("\n +10 \n")));
    };
    start(&[0, 100, 200, 400, 800, 1600, 2000, 2000], "");
    start(&[0, 50], "! restarts");
    start(&[0, 100, 200, 300], "! restarts");
    start(&[0, 100, 200, 400, 800, 1600, 1900], "! restarts");
}

#[test]
fn uptime_reduces_restart_delays_and_an_operator_lifts_them() {
    check(
        "exit power
        start power
        +10000 exit power
        start power
        exit power
        operator power RUN
        start power",
    );
}

#[test]
fn a_module_has_one_process() {
    check(
        "exit power
        start power
        +1000 start power ! single",
    );
}

#[test]
fn timestamps_do_not_go_back_on_a_channel_of_a_process() {
    check(
        "odo 2 100
        odo 2 100
        srfs 2 50
        odo 3 90
        odo 0 0
        odo 2 99 ! clock",
    );
}

#[test]
fn queues_overflow_only_where_a_fault_is_injected() {
    check(
        "fault can cut 500
        dropped can
        hang power
        dropped power",
    );
    for whose in ["can", "power"] {
        check(&format!("+1000 dropped {whose} ! queues"));
    }
}

#[test]
fn the_wanted_state_changes_only_by_command() {
    check(
        "program power PAUSE
        row RUN PAUSE
        row PAUSE STOP ! wanted",
    );
}

#[test]
fn in_calm_all_modules_reach_their_wanted_state_within_ten_seconds() {
    let differs =
        |seconds: usize| format!("quiet watchdog \n calm \n {}", "row ERROR RUN \n +100 \n".repeat(seconds * 10));
    check(&format!("{} row RUN RUN", differs(9)));
    check(&format!("{} row ERROR RUN \n +100 row ERROR RUN ! wanted", differs(10)));
    check(
        "calm
        quiet watchdog
        +9900
        +200 ! wanted",
    );
}

#[test]
fn a_violation_is_one_line_and_the_first_one_stays() {
    let mut bench = Bench::new();
    bench.act(&["begin", "pad", "0.4"]);
    bench.pass(300);
    bench.act(&["drive", "0.4"]);
    bench.pass(2000);
    let line = bench.checkers.violation().map(ToString::to_string);
    let expected = "at 1.310000 s, rule fresh: 0.400 m/s, which no living command asks for";
    assert_eq!(line.as_deref(), Some(expected));
    assert_eq!(bench.checkers.setpoints(), 2);
}

#[test]
fn the_robot_does_not_drive_where_its_ranging_board_does_not_answer() {
    let script = |board: &str, speed: &str, after: &str| {
        check(&format!(
            "begin pad {speed}
            quiet {board}
            +200 say pad {speed}
            +200 say pad {speed}
            +200 say pad {speed}
            +200 say pad {speed}
            +150 say pad {speed}
            +30 drive {speed}
            +50 {after}"
        ));
    };
    script("front", "0.4", "drive 0.4 ! blind");
    script("rear", "-0.4", "drive -0.4 ! blind");
    // The other board does not matter, and the robot may stop.
    script("rear", "0.4", "drive 0.4");
    script("front", "-0.4", "drive -0.4");
    script("front", "0.4", "stop");
}

#[test]
fn requests_refusals_and_damaged_answers_are_no_answers() {
    for (frame, rule) in
        [("ask 10", "! blind"), ("refusal 10", "! blind"), ("garbled 10", "! blind"), ("answer 10", "")]
    {
        check(&format!(
            "begin pad 0.4
            quiet front
            +240 say pad 0.4
            +240 say pad 0.4
            +240 say pad 0.4
            +200 say pad 0.4
            {frame}
            +200 drive 0.4 {rule}"
        ));
    }
}

#[test]
fn a_board_that_is_served_late_is_not_judged() {
    check(
        "begin pad 0.4
        quiet front
        fault lcm late 900
        +240 say pad 0.4
        +240 say pad 0.4
        +240 say pad 0.4
        +200 say pad 0.4
        +200 drive 0.4
        +1 say pad 0.4
        +200 say pad 0.4
        +200 say pad 0.4
        +200 say pad 0.4
        +190 say pad 0.4
        +20 drive 0.4 ! blind",
    );
}

/// A robot that drives at `mps` for 3 s and touches something, whose sonar answers the distance of that, but for the
/// answers at `missed` s before; the first rule that is broken.
fn touches(mps: f64, contact: &str, missed: &[f64], until: impl Fn(&mut Bench)) -> Option<&'static str> {
    let mut bench = Bench::new();
    bench.start("ranges");
    bench.quiet.push("front".into());
    bench.act(&["begin", "pad", "0.5"]);
    for n in 0..60 {
        let left = f64::from(60 - n) * 0.05;
        bench.act(&["say", "pad", "0.5"]);
        // Every 50 ms, as the robot is polled while it drives; touched at x = 10 by the front.
        (bench.x, bench.speed) = (10.0 - 0.75 - mps * left, mps);
        bench.pass(50);
        let missed = missed.iter().any(|at| (at - left).abs() < 0.12);
        bench.distances("answer", 0x10, if missed { 0 } else { (mps * left * 1000.0) as u16 + 30 });
    }
    until(&mut bench);
    bench.tell(&News::Note { module: "simulator", line: contact });
    bench.checkers.violation().map(|violation| violation.rule)
}

#[test]
fn what_stands_and_was_answered_is_not_hit() {
    let wall = "contact: by robot, robot 0.500 m/s, wall, at 9.250 0.000";
    let nothing = |_: &mut Bench| {};
    assert_eq!(touches(0.5, wall, &[], nothing), Some("promise"));
    let leg = "contact: by robot, robot 0.500 m/s, person 3 0.050 of 0.050 m/s, at 10.200 0.100";
    assert_eq!(touches(0.5, leg, &[], nothing), Some("promise"));
    for other in [
        "contact: by person, robot 0.500 m/s, person 3 0.050 of 0.050 m/s, at 10.200 0.100",
        "contact: by robot, robot 0.040 m/s, wall, at 9.250 0.000",
        "contact: by robot, robot 0.500 m/s, person 3 0.900 of 0.900 m/s, at 10.200 0.100",
        // One who walks past, too.
        "contact: by robot, robot 0.500 m/s, person 3 0.005 of 0.270 m/s, at 10.200 0.100",
        "contact: by robot, robot 0.500 m/s, person 3 0.050 of 0.050 m/s, at 9.500 1.500",
        // A leg answered that is farther away than the body before it: the other one, or the rear one of a stride.
        "contact: by robot, robot 0.500 m/s, person 3 0.050 of 0.050 m/s, at 9.960 0.100",
    ] {
        assert_eq!(touches(0.5, other, &[], nothing), None, "{other}");
    }
    assert_eq!(touches(0.5, wall, &[0.6], nothing), None, "it was missed within the time to stop");
    assert_eq!(touches(0.5, wall, &[2.8], nothing), Some("promise"), "and before");
    assert_eq!(touches(0.5, wall, &[], |bench| bench.act(&["exit", "guard"])), None, "the guard has ended");
    let creeps = |bench: &mut Bench| bench.sent(9, lowlevel::CmdCreep { held: true, ..Default::default() });
    assert_eq!(touches(0.5, wall, &[], creeps), None);
}
