//! Each rule, held and broken, by news made by hand.

use super::*;
use messages::{lowlevel, middlelevel, simulation};
use module::ExitStatus;

const WATCHDOG: u32 = 1;
const POWER: u32 = 2;
const DRIVER: u32 = 3;
const PAD: (&str, i8) = ("pad", 2);
const SHELL: (&str, i8) = ("shell", 1);
const PLANNER: (&str, i8) = ("planner", 0);

fn limits() -> Limits {
    Limits {
        driver: "driver".into(),
        watchdog: "watchdog".into(),
        planner: "planner".into(),
        critical: vec!["power".into(), "driver".into()],
        bus: "can".into(),
        propulsion: 1,
        steering: 2,
        rpm_per_mps: 1000.0,
        speed: 1.2,
        steering_angle: 0.6,
        speed_manual: 0.6,
        speed_autonomous: 0.8,
        quick_stop: 1.5,
        ttl: Duration::from_millis(250),
        pause_line: true,
        restart_max: Duration::from_secs(2),
    }
}

/// A machine in which all is well unless it is told otherwise.
struct Bench {
    checkers: Checkers,
    now: Instant,
    /// Who speaks each 50 ms: the watchdog, the power controller's driver, the steering.
    watchdog: bool,
    power: bool,
    steering: bool,
    speed: f64,
}

impl Bench {
    /// All modules run since a second; nobody commands.
    fn new() -> Self {
        let checkers = Checkers::new(limits());
        let now = Instant::ZERO;
        let mut bench = Self { checkers, now, watchdog: true, power: true, steering: true, speed: 0.0 };
        for (module, pid) in [("watchdog", WATCHDOG), ("power", POWER), ("driver", DRIVER)] {
            bench.tell(&News::Started { module, pid });
            bench.tell(&News::State { module, state: State::Run });
        }
        bench.pass(1000);
        bench
    }

    fn tell(&mut self, news: &News<'_>) {
        self.checkers.observe(self.now, news);
    }

    /// Time passes, in which everybody says what he always says.
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
        if self.steering {
            self.frame(0x702, &[5]);
        }
        if self.watchdog {
            self.list(&["power", "driver"]);
        }
        if self.power {
            self.line(false);
        }
        self.truth(self.speed);
    }

    fn frame(&mut self, id: u16, data: &[u8]) {
        self.tell(&News::Can { bus: "can", frame: Frame::standard(id, data) });
    }

    /// An RPDO4 of the propulsion.
    fn set_point(&mut self, controlword: u8, mps: f64) {
        let rpm = ((mps * 1000.0) as i32).to_le_bytes();
        self.frame(0x501, &[controlword, 0, rpm[0], rpm[1], rpm[2], rpm[3]]);
    }

    fn drive(&mut self, mps: f64) {
        self.set_point(0x0F, mps);
    }

    fn quick_stop(&mut self) {
        self.set_point(0x0B, 0.0);
    }

    fn sent(&mut self, pid: u32, message: impl Into<Message>) {
        self.tell(&News::Message { pid, message: &message.into() });
    }

    /// Sent, and served to the driver at once.
    fn heard(&mut self, message: impl Into<Message>) {
        let message = message.into();
        self.tell(&News::Message { pid: 0, message: &message });
        self.tell(&News::Heard { pid: DRIVER, at: self.now, message: &message });
    }

    fn say(&mut self, (source, priority): (&str, i8), speed: f64) {
        let source = source.into();
        self.heard(lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source });
    }

    /// Zero, then this: it has begun anew, and the robot moves.
    fn begin(&mut self, source: (&str, i8), speed: f64) {
        self.say(source, 0.0);
        self.pass(10);
        self.say(source, speed);
        self.drive(speed.clamp(-0.6, 0.6));
    }

    fn list(&mut self, running: &[&str]) {
        let row = |module: &str| common::Process {
            module: module.into(),
            phase: i8::from(running.contains(&module)),
            state: State::Run as i8,
            wanted: State::Run as i8,
            ..common::Process::default()
        };
        self.rows(vec![row("power"), row("driver")]);
    }

    fn rows(&mut self, processes: Vec<common::Process>) {
        let message = Message::from(common::DataProcesses { timestamp: micros(self.now), processes });
        self.tell(&News::Message { pid: WATCHDOG, message: &message });
        self.tell(&News::Heard { pid: DRIVER, at: self.now, message: &message });
    }

    fn line(&mut self, engaged: bool) {
        self.heard(lowlevel::EventStop { timestamp: 0, engaged, source: "button".into() });
    }

    fn truth(&mut self, speed: f64) {
        self.speed = speed;
        self.sent(0, simulation::DataTruth { speed, ..Default::default() });
    }

    fn motion(&mut self, source: &str, homed: bool, speed_target: f64) {
        let motion = lowlevel::DataMotion { timestamp: micros(self.now), homed, speed_target, ..Default::default() };
        self.sent(DRIVER, lowlevel::DataMotion { source: source.into(), ..motion });
    }

    fn command(&mut self, module: &str, state: State, manual: bool) {
        let (module, source) = (module.into(), "op".into());
        self.heard(common::CmdState { timestamp: 0, module, state: state as i8, manual, source });
    }

    fn state(&mut self, module: &str, state: State) {
        self.tell(&News::State { module, state });
    }

    fn exited(&mut self, module: &str, pid: u32) {
        self.tell(&News::Exited { module, pid, status: ExitStatus::Signal(9) });
    }

    fn fault(&mut self, target: &str, fault: &str, ms: u64) {
        self.tell(&News::Fault { target, fault, until: self.now + Duration::from_millis(ms) });
    }

    #[track_caller]
    fn holds(&self) {
        assert_eq!(self.checkers.violation().map(ToString::to_string), None);
    }

    #[track_caller]
    fn breaks(&self, rule: &str) {
        assert_eq!(self.checkers.violation().map(|violation| violation.rule), Some(rule));
    }
}

fn micros(at: Instant) -> i64 {
    at.as_nanos() as i64 / 1000
}

#[test]
fn a_set_point_lives_as_long_as_its_command() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.pass(251);
    bench.drive(0.4);
    bench.holds();
    bench.pass(2);
    bench.drive(0.4);
    bench.breaks("fresh");
}

#[test]
fn a_set_point_is_what_a_command_asks_for_or_less() {
    for (set, well) in [(0.4, true), (0.2, true), (0.45, false), (-0.4, false)] {
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.drive(set);
        assert_eq!(bench.checkers.violation().is_none(), well, "{set}");
    }
    let mut bench = Bench::new();
    bench.begin(PAD, 1.0);
    bench.drive(0.7);
    bench.breaks("fresh");
}

#[test]
fn the_last_command_counts_once_it_had_time_to_reach_the_wire() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.pass(50);
    bench.say(PAD, 0.0);
    bench.pass(1);
    bench.drive(0.4);
    bench.holds();
    bench.pass(2);
    bench.drive(0.4);
    bench.breaks("fresh");
}

#[test]
fn a_command_that_waited_counts_from_when_it_was_received() {
    let mut bench = Bench::new();
    bench.say(PAD, 0.0);
    let at = bench.now;
    bench.pass(200);
    let (source, priority) = (PAD.0.into(), PAD.1);
    let command = lowlevel::CmdMotion { timestamp: 0, speed: 0.3, steering: 0.0, priority, source };
    bench.tell(&News::Heard { pid: DRIVER, at, message: &command.into() });
    bench.drive(0.3);
    bench.holds();
    bench.pass(60);
    bench.drive(0.3);
    bench.breaks("fresh");
}

#[test]
fn an_rpdo4_is_whole_and_its_controlword_plain() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.set_point(0x1F, 0.4);
    bench.breaks("fresh");
    let mut bench = Bench::new();
    bench.frame(0x501, &[0x0F, 0, 1]);
    bench.breaks("fresh");
}

#[test]
fn who_did_not_let_go_does_not_move_the_robot_after_a_stop() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.pass(50);
    bench.say(PAD, 0.4);
    bench.quick_stop();
    bench.pass(50);
    bench.say(PAD, 0.4);
    bench.drive(0.4);
    bench.breaks("resumes");
}

#[test]
fn who_let_go_moves_it_again() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.quick_stop();
    bench.pass(50);
    bench.begin(PAD, 0.4);
    bench.holds();
    bench.quick_stop();
    // Silence is as good as zero.
    bench.pass(300);
    bench.say(PAD, 0.4);
    bench.drive(0.4);
    bench.holds();
}

fn estimate() -> middlelevel::DataEstimate {
    middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() }
}

fn goal() -> middlelevel::CmdGoal {
    middlelevel::CmdGoal { waypoints: vec![middlelevel::Waypoint::default()], ..Default::default() }
}

#[test]
fn the_planner_needs_leave_and_an_estimate() {
    let drive = |goal_first: bool, located: bool| {
        let mut bench = Bench::new();
        if goal_first {
            bench.heard(goal());
        }
        if located {
            bench.heard(estimate());
        }
        bench.say(PLANNER, 0.7);
        bench.drive(0.7);
        bench
    };
    drive(true, true).holds();
    drive(false, true).breaks("resumes");
    drive(true, false).breaks("resumes");
    let mut bench = drive(true, true);
    bench.pass(210);
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.breaks("resumes");
}

#[test]
fn the_planner_goes_on_after_its_own_silence_and_not_after_a_stop() {
    let mut bench = Bench::new();
    bench.heard(goal());
    bench.heard(estimate());
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.pass(250);
    bench.quick_stop();
    bench.pass(100);
    bench.heard(estimate());
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.holds();
    bench.quick_stop();
    bench.pass(10);
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.breaks("resumes");
}

#[test]
fn after_a_manual_take_over_the_planner_waits_for_leave() {
    let mut bench = Bench::new();
    bench.heard(goal());
    bench.heard(estimate());
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.begin(PAD, 0.2);
    bench.pass(250);
    bench.quick_stop();
    bench.pass(100);
    bench.heard(estimate());
    bench.say(PLANNER, 0.7);
    bench.drive(0.7);
    bench.breaks("resumes");
}

#[test]
fn no_set_point_leaves_20_ms_after_pause_is_known() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.power = false;
    bench.line(true);
    bench.pass(19);
    bench.drive(0.4);
    bench.holds();
    bench.pass(2);
    bench.drive(0.4);
    bench.breaks("pause");
}

#[test]
fn under_pause_the_speed_never_rises() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.power = false;
    bench.line(true);
    bench.quick_stop();
    for speed in [0.4, 0.3, 0.3, 0.2] {
        bench.speed = speed;
        bench.pass(50);
        bench.holds();
    }
    bench.speed = 0.21;
    bench.pass(50);
    bench.breaks("pause");
}

#[test]
fn a_pause_line_that_is_not_heard_of_counts_as_engaged() {
    let mut bench = Bench::new();
    bench.power = false;
    bench.pass(1190);
    bench.begin(PAD, 0.4);
    bench.holds();
    bench.pass(10);
    bench.drive(0.4);
    bench.breaks("pause");
    // A driver that has just come knows nothing.
    let mut bench = Bench::new();
    bench.power = false;
    bench.exited("driver", DRIVER);
    bench.tell(&News::Started { module: "driver", pid: DRIVER });
    bench.state("driver", State::Run);
    bench.pass(50);
    bench.begin(PAD, 0.4);
    bench.breaks("pause");
}

#[test]
fn without_a_critical_module_nothing_moves() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.watchdog = false;
    bench.list(&["driver"]);
    bench.pass(1);
    bench.drive(0.4);
    bench.holds();
    bench.pass(2);
    bench.drive(0.4);
    bench.breaks("critical");
}

#[test]
fn without_a_watchdog_nothing_moves() {
    let mut bench = Bench::new();
    bench.watchdog = false;
    bench.pass(240);
    bench.begin(PAD, 0.4);
    bench.holds();
    bench.pass(3);
    bench.drive(0.4);
    bench.breaks("critical");
}

#[test]
fn a_command_out_of_limits_stops_the_robot_for_its_time_to_live() {
    for wild in [1.3, f64::NAN] {
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.say(SHELL, wild);
        bench.pass(3);
        bench.drive(0.4);
        bench.breaks("refused");
    }
    let mut bench = Bench::new();
    bench.say(SHELL, 1.3);
    bench.pass(250);
    bench.begin(PAD, 0.4);
    bench.holds();
}

#[test]
fn a_driver_that_does_not_run_does_not_act() {
    for state in [State::Pause, State::Stop, State::Error] {
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.state("driver", state);
        bench.pass(2);
        bench.drive(0.4);
        bench.holds();
        bench.pass(1);
        bench.drive(0.4);
        bench.breaks("idle");
    }
}

#[test]
fn a_steering_that_is_lost_stops_the_propulsion() {
    let mut bench = Bench::new();
    bench.steering = false;
    bench.pass(190);
    bench.begin(PAD, 0.4);
    bench.holds();
    bench.pass(5);
    bench.drive(0.4);
    bench.breaks("drives");
}

#[test]
fn a_steering_in_fault_or_started_anew_stops_the_propulsion() {
    for (id, data) in [(0x282, [0x18, 0x02]), (0x702, [0, 0])] {
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.frame(id, &data);
        bench.pass(1);
        bench.drive(0.4);
        bench.holds();
        bench.pass(2);
        bench.drive(0.4);
        bench.breaks("drives");
    }
}

#[test]
fn an_unhomed_robot_is_not_driven() {
    let mut bench = Bench::new();
    bench.motion("", false, 0.0);
    bench.begin(PAD, 0.4);
    bench.motion("pad", true, 0.4);
    bench.holds();
    bench.motion("", false, 0.0);
    bench.drive(0.4);
    bench.motion("", false, 0.0);
    bench.breaks("homed");
    let mut bench = Bench::new();
    bench.motion("", false, 0.1);
    bench.breaks("homed");
}

#[test]
fn who_holds_the_motion_keeps_it_until_it_lets_go() {
    let contest = |first: (&str, i8), second: (&str, i8)| {
        let mut bench = Bench::new();
        bench.begin(first, 0.2);
        bench.motion(first.0, true, 0.2);
        bench.begin(second, 0.2);
        bench.motion(second.0, true, 0.2);
        bench
    };
    contest(SHELL, PAD).holds();
    contest(PAD, SHELL).breaks("authority");
    contest(PAD, ("wheel", PAD.1)).breaks("authority");
    let mut bench = Bench::new();
    bench.begin(PAD, 0.2);
    bench.motion("pad", true, 0.2);
    bench.pass(300);
    bench.begin(SHELL, 0.2);
    bench.motion("shell", true, 0.2);
    bench.holds();
    bench.pass(300);
    bench.motion("shell", true, 0.2);
    bench.breaks("authority");
}

#[test]
fn set_points_are_those_of_who_holds_the_motion() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.2);
    bench.motion("pad", true, 0.2);
    bench.say(SHELL, 0.0);
    bench.say(SHELL, 0.3);
    bench.drive(0.2);
    bench.holds();
    bench.drive(0.3);
    bench.breaks("authority");
}

#[test]
fn the_stop_has_begun_300_ms_after_a_critical_module_was_lost() {
    for lost in ["hang", "death"] {
        let lose = |bench: &mut Bench| match lost {
            "hang" => bench.tell(&News::Hung { module: "power", pid: POWER }),
            _ => bench.exited("power", POWER),
        };
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.speed = 0.4;
        lose(&mut bench);
        bench.pass(299);
        bench.quick_stop();
        bench.pass(200);
        bench.holds();
        let mut bench = Bench::new();
        bench.begin(PAD, 0.4);
        bench.speed = 0.4;
        lose(&mut bench);
        for _ in 0..10 {
            bench.say(PAD, 0.4);
            bench.pass(50);
        }
        bench.breaks("stop");
    }
}

#[test]
fn a_drive_that_stops_by_itself_has_begun_the_stop() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.speed = 0.4;
    bench.pass(100);
    bench.exited("driver", DRIVER);
    bench.pass(260);
    for speed in [0.4, 0.35, 0.3, 0.2, 0.1, 0.0] {
        bench.speed = speed;
        bench.pass(50);
    }
    bench.holds();
}

#[test]
fn a_hang_that_is_over_soon_or_is_none_of_a_critical_module_is_no_loss() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.speed = 0.4;
    bench.tell(&News::Started { module: "beacons", pid: 9 });
    bench.exited("beacons", 9);
    bench.tell(&News::Hung { module: "power", pid: POWER });
    bench.pass(150);
    bench.tell(&News::Resumed { module: "power", pid: POWER });
    for _ in 0..10 {
        bench.say(PAD, 0.4);
        bench.pass(50);
    }
    bench.holds();
}

#[test]
fn a_robot_that_nobody_moves_comes_to_a_stand() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.speed = 0.4;
    bench.pass(250);
    bench.quick_stop();
    bench.pass(700);
    bench.holds();
    bench.pass(200);
    bench.breaks("body");
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.speed = 0.4;
    bench.pass(250);
    bench.quick_stop();
    // Without its power stage it rolls.
    bench.fault("propulsion", "fault", 0);
    bench.pass(2000);
    bench.holds();
    bench.truth(0.43);
    bench.breaks("body");
}

#[test]
fn what_a_driver_commanded_before_it_hung_moves_the_robot_until_the_drive_misses_it() {
    let mut bench = Bench::new();
    bench.pass(20);
    bench.begin(PAD, 0.4);
    bench.drive(0.4);
    bench.pass(10);
    bench.tell(&News::Hung { module: "driver", pid: DRIVER });
    for speed in [0.05, 0.1, 0.15, 0.2] {
        bench.speed = speed;
        bench.pass(50);
    }
    bench.holds();
    for speed in [0.15, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0] {
        bench.speed = speed;
        bench.pass(50);
    }
    bench.truth(0.1);
    bench.breaks("body");
}

#[test]
fn stop_is_left_by_an_operator_alone() {
    let mut bench = Bench::new();
    bench.command("power", State::Stop, true);
    bench.state("power", State::Stop);
    bench.state("power", State::Error);
    bench.state("power", State::Stop);
    bench.pass(100);
    bench.command("*", State::Run, true);
    bench.state("power", State::Run);
    bench.holds();
    for way in [State::Run, State::Pause] {
        let mut bench = Bench::new();
        bench.command("power", State::Run, true);
        bench.pass(100);
        bench.command("power", State::Stop, true);
        bench.state("power", State::Stop);
        bench.command("power", way, false);
        bench.exited("power", POWER);
        bench.state("power", way);
        bench.breaks("stopped");
    }
}

#[test]
fn restarts_wait_for_their_delays() {
    let start = |waits: &[u64]| {
        let mut bench = Bench::new();
        for (pid, wait) in (100..).zip(waits) {
            bench.exited("power", if pid == 100 { POWER } else { pid - 1 });
            bench.pass(*wait);
            bench.tell(&News::Started { module: "power", pid });
            bench.pass(10);
        }
        bench
    };
    start(&[0, 100, 200, 400, 800, 1600, 2000, 2000]).holds();
    start(&[0, 50]).breaks("restarts");
    start(&[0, 100, 200, 300]).breaks("restarts");
    start(&[0, 100, 200, 400, 800, 1600, 1900]).breaks("restarts");
}

#[test]
fn life_pays_off_delays_and_an_operator_lifts_them() {
    let mut bench = Bench::new();
    bench.exited("power", POWER);
    bench.tell(&News::Started { module: "power", pid: 10 });
    bench.pass(10_000);
    bench.exited("power", 10);
    bench.tell(&News::Started { module: "power", pid: 11 });
    bench.holds();
    bench.exited("power", 11);
    bench.command("power", State::Run, true);
    bench.tell(&News::Started { module: "power", pid: 12 });
    bench.holds();
}

#[test]
fn a_module_has_one_process() {
    let mut bench = Bench::new();
    bench.exited("power", POWER);
    bench.tell(&News::Started { module: "power", pid: 10 });
    bench.holds();
    bench.pass(1000);
    bench.tell(&News::Started { module: "power", pid: 11 });
    bench.breaks("single");
}

#[test]
fn timestamps_do_not_go_back_on_a_channel_of_a_process() {
    let mut bench = Bench::new();
    let odo = |timestamp| lowlevel::DataOdo { timestamp, ..Default::default() };
    bench.sent(POWER, odo(100));
    bench.sent(POWER, odo(100));
    bench.sent(POWER, lowlevel::DataSrfs { timestamp: 50, srfs: Vec::new() });
    bench.sent(DRIVER, odo(90));
    bench.sent(0, odo(0));
    bench.holds();
    bench.sent(POWER, odo(99));
    bench.breaks("clock");
}

#[test]
fn queues_overflow_where_something_is_broken_alone() {
    let mut bench = Bench::new();
    bench.fault("can", "cut", 500);
    bench.tell(&News::Dropped { whose: "can", count: 3 });
    bench.tell(&News::Hung { module: "power", pid: POWER });
    bench.tell(&News::Dropped { whose: "power", count: 1 });
    bench.holds();
    for whose in ["can", "power"] {
        let mut bench = Bench::new();
        bench.pass(1000);
        bench.tell(&News::Dropped { whose, count: 1 });
        bench.breaks("queues");
    }
}

fn row(state: State, wanted: State) -> common::Process {
    common::Process {
        module: "power".into(),
        phase: common::Process::RUNNING,
        state: state as i8,
        wanted: wanted as i8,
        ..common::Process::default()
    }
}

#[test]
fn what_is_wanted_changes_by_command_alone() {
    let mut bench = Bench::new();
    bench.command("power", State::Pause, false);
    bench.rows(vec![row(State::Run, State::Pause)]);
    bench.holds();
    bench.rows(vec![row(State::Pause, State::Stop)]);
    bench.breaks("wanted");
}

#[test]
fn in_calm_all_come_to_be_as_they_are_wanted_within_ten_seconds() {
    let differs = |seconds: u64| {
        let mut bench = Bench::new();
        bench.watchdog = false;
        bench.checkers.calm(bench.now);
        for _ in 0..seconds * 10 {
            bench.rows(vec![row(State::Error, State::Run)]);
            bench.pass(100);
        }
        bench.rows(vec![row(State::Run, State::Run)]);
        bench
    };
    differs(9).holds();
    differs(11).breaks("wanted");
    let mut bench = Bench::new();
    bench.checkers.calm(bench.now);
    bench.watchdog = false;
    bench.pass(9_900);
    bench.holds();
    bench.pass(200);
    bench.breaks("wanted");
}

#[test]
fn a_violation_is_one_line_and_the_first_one_stays() {
    let mut bench = Bench::new();
    bench.begin(PAD, 0.4);
    bench.pass(300);
    bench.drive(0.4);
    bench.pass(2000);
    let line = bench.checkers.violation().map(ToString::to_string);
    let expected = "at 1.310000 s, rule fresh: 0.400 m/s, which no living command asks for";
    assert_eq!(line.as_deref(), Some(expected));
    assert_eq!(bench.checkers.setpoints(), 2);
}
