//! `advee rs485 …` as used from the shell: with emulated boards on a pseudo-terminal, and with the running simulated
//! robot.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::command::{Outcome, values};
use crate::support::{self, Robot, advee, signal};
use base::serial::Word;
use base::{Duration, Instant};
use host::clock;
use host::ports::{Port, PortConfig, Received};
use messages::{Channel, Message};
use module::{Input, Output as ToPort};
use rs485::boards::{psc1, so1};
use rs485::crc::Crc8;
use rs485::frame::{Frame, Status, Words};
use rs485::slave::{self, Slave};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::thread::{JoinHandle, sleep, spawn};

/// Emulated board: address, and answer to an instruction.
type Emulated = (u8, fn(u8) -> (Status, Vec<u8>));

/// SO1 of firmware 1.4.
const SO1: Emulated = (so1::ADDRESS, |instruction| match instruction {
    0x01 => (Status::Ok, vec![0x05, 0x00, 0xFE, 0xFF]),
    0xFE => (Status::Ok, vec![1, 4]),
    0xFF | 0x02 => (Status::Ok, Vec::new()),
    _ => (Status::UnknownInstruction, Vec::new()),
});
/// Unknown board that only reports its version.
const STRANGER: Emulated = (0x77, |instruction| match instruction {
    0xFE => (Status::Ok, vec![9, 1, 0xAB]),
    _ => (Status::UnknownInstruction, Vec::new()),
});

/// Boards on a pseudo-terminal, until dropped.
struct Boards {
    folder: PathBuf,
    stop: Arc<AtomicBool>,
    /// Somebody was asked after a board had answered.
    asked_on: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Boards {
    fn new(boards: &'static [Emulated]) -> Self {
        Self::with(boards, Vec::new(), Duration::ZERO)
    }

    /// Starts the boards with `chatter` on the line every 20 ms.
    fn talking(boards: &'static [Emulated], chatter: Vec<Word>) -> Self {
        Self::with(boards, chatter, Duration::ZERO)
    }

    /// The same; the boards answer after `delay`.
    fn with(boards: &'static [Emulated], chatter: Vec<Word>, delay: Duration) -> Self {
        static NEXT: AtomicU16 = AtomicU16::new(0);
        let name = format!("advee-rs485-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let asked_on = Arc::new(AtomicBool::new(false));
        let (stopped, asked, link) = (stop.clone(), asked_on.clone(), folder.join("line"));
        let offered = link.clone();
        let thread = spawn(move || {
            let mut port = Port::new("line".into(), PortConfig::Pseudo { link, baud: 115_200 });
            port.device.open().unwrap();
            let mut slaves: Vec<Slave> =
                boards.iter().map(|(address, _)| Slave::new(slave::Config::new(*address))).collect();
            let mut chatters = clock::now();
            let mut late = VecDeque::new();
            let mut answered = false;
            while !stopped.load(Ordering::Relaxed) {
                let (heard, answers) = serve(&mut port, &mut slaves, boards, delay, &mut late);
                asked.fetch_or(answered && heard, Ordering::Relaxed);
                answered |= answers;
                if !chatter.is_empty() && clock::now() >= chatters {
                    chatters = clock::now() + Duration::from_millis(20);
                    let _ = port.device.send(clock::now(), &ToPort::Words(chatter.clone()));
                }
                sleep(std::time::Duration::from_micros(200));
            }
        });
        while !offered.exists() && !thread.is_finished() {
            sleep(std::time::Duration::from_millis(1));
        }
        Self { folder, stop, asked_on, thread: Some(thread) }
    }

    fn line(&self) -> String {
        self.folder.join("line").display().to_string()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = advee("udpm://239.255.76.67:7667?ttl=0", &self.folder);
        command.arg("rs485").args(args).args(["--port", &self.line()]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, args: &[&str]) -> Outcome {
        Outcome::of(self.command(args).output().expect("the executable is built"))
    }
}

impl Drop for Boards {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Passes words between the line and the boards. Returns true if words were received, and true if a board answers.
fn serve(
    port: &mut Port,
    slaves: &mut [Slave],
    boards: &[Emulated],
    delay: Duration,
    late: &mut VecDeque<(Instant, Vec<Word>)>,
) -> (bool, bool) {
    let now = clock::now();
    let (mut heard, mut answers) = (false, false);
    while let Ok(Received::Input { input: Input::Words(words), .. }) = port.device.receive(now) {
        heard = true;
        slaves.iter_mut().for_each(|slave| slave.handle_rx(now, words));
    }
    for (slave, (_, answer)) in slaves.iter_mut().zip(boards) {
        while let Some(asked) = slave.poll_request() {
            let (status, data) = answer(asked.instruction);
            slave.respond(status, &data);
        }
        slave.handle_timeout(now);
        if let Some(transmit) = slave.poll_tx(now) {
            answers = true;
            late.push_back((now + delay, transmit.words.to_vec()));
        }
    }
    while late.front().is_some_and(|(due, _)| *due <= now) {
        let Some((_, words)) = late.pop_front() else { break };
        let _ = port.device.send(now, &ToPort::Words(words));
    }
    (heard, answers)
}

#[test]
fn an_answer_that_is_late_is_not_that_of_the_next_poll() {
    // So1 has 20 ms.
    let boards = Boards::with(&[SO1], Vec::new(), Duration::from_millis(30));
    let refused = boards.run(&["poll", "so1", "--count", "20", "--json"]);
    let json = &values(&refused.out)[0];
    assert_eq!((&json["good"], &json["silent"]), (&0.into(), &20.into()), "{json}");
    // A busy machine may make one later than is waited for.
    assert!(json["late"].as_u64().unwrap() >= 15, "{json}");
    assert!(refused.bad().contains("gave no good answer"));
}

#[test]
fn scan_finds_and_identifies_the_boards_on_the_line() {
    let boards = Boards::new(&[SO1, STRANGER]);
    let told = boards.run(&["scan", "--first", "16", "--last", "127", "--timeout", "5"]).good();
    let lines: Vec<&str> = told.lines().collect();
    assert!(lines[1].starts_with("0x20     so1   SO1    1.4 "), "{told}");
    assert!(lines[2].starts_with("0x77     ?     ?      9.1 "), "{told}");
    assert_eq!(lines[3], format!("2 boards on {}; 112 addresses asked", boards.line()));
    let json = boards.run(&["scan", "--first", "32", "--last", "32", "--json"]).values();
    assert_eq!((json.len(), &json[0]["board"], &json[0]["version"]), (1, &"so1".into(), &"1.4".into()));
    let nobody = boards.run(&["scan", "--first", "1", "--last", "3", "--timeout", "5"]).bad();
    assert!(nobody.contains("nobody answers"), "{nobody}");
}

#[test]
fn an_interrupted_scan_lists_the_boards_found() {
    let boards = Boards::new(&[(0x01, SO1.1)]);
    let mut scan = boards.command(&["scan", "--timeout", "200"]).spawn().unwrap();
    while !boards.asked_on.load(Ordering::Relaxed) {
        assert!(scan.try_wait().unwrap().is_none(), "it ended before");
        sleep(std::time::Duration::from_millis(1));
    }
    signal(scan.id() as i32, "INT");
    let told = Outcome::of(scan.wait_with_output().unwrap());
    assert!(
        told.out.contains("0x01 ") && told.out.contains("1 board on ") && told.out.contains("interrupted"),
        "{told:?}"
    );
    assert_eq!(told.bad(), "advee: interrupted");
}

#[test]
fn version_and_reset_ask_one_board_by_name_or_address() {
    let boards = Boards::new(&[SO1, STRANGER]);
    for name in ["so1", "0x20", "32"] {
        let told = boards.run(&["version", name]).good();
        assert!(told.starts_with("so1 (0x20): version 1.4 ("), "{told}");
    }
    let json = boards.run(&["version", "0x77", "--json"]).values();
    assert_eq!((&json[0]["version"], &json[0]["more"]), (&"9.1".into(), &vec![0xAB].into()));
    assert!(boards.run(&["reset", "so1"]).good().starts_with("so1 (0x20): resets ("));
    assert!(boards.run(&["reset", "all"]).good().contains("all were told to reset"));
    assert_eq!(boards.run(&["reset", "0x77"]).bad(), "advee: board 0x77 answers UNKINSTR");
    let silent = boards.run(&["version", "0x21"]).bad();
    assert!(silent.contains("board 0x21 does not answer on ") && silent.contains("asked 3 times"), "{silent}");
    let unknown = boards.run(&["version", "so9"]).bad();
    assert!(unknown.contains("no board \"so9\": expected an address from 1 to 254"), "{unknown}");
}

#[test]
fn poll_counts_the_outcomes() {
    let boards = Boards::new(&[SO1]);
    let told = boards.run(&["poll", "so1", "--count", "50"]).good();
    assert!(told.starts_with("so1 (0x20) on ") && told.contains(": get_ticks, 115200 Bd"), "{told}");
    assert!(told.contains("  polls          50  in ") && told.contains("last        ticks 5 -2"), "{told}");
    let json = boards.run(&["poll", "so1", "--count", "50", "--json"]).values();
    // A busy machine may make a board miss its 20 ms.
    let (good, silent) = (json[0]["good"].as_u64().unwrap(), json[0]["silent"].as_u64().unwrap());
    assert!(good >= 40 && good + silent == 50, "{good} good, {silent} silent");
    let json = boards.run(&["poll", "so1", "--rate", "50", "--for", "0.5", "--json"]).values();
    let polls = json[0]["polls"].as_u64().unwrap();
    assert!((20..=26).contains(&polls), "{polls} at 50 Hz in 0.5 s");
    let times = &json[0]["round_trip_s"];
    assert!(times["min"].as_f64() <= times["p99"].as_f64() && times["p99"].as_f64() <= times["max"].as_f64());
    let refused = boards.run(&["poll", "so1", "0x55", "--data", "01 ff", "--count", "3", "--json"]);
    assert_eq!(values(&refused.out)[0]["refused"], 3);
    assert!(refused.bad().contains("gave no good answer"));
    let unknown = boards.run(&["poll", "so1", "get_srf_data", "--count", "1"]).bad();
    assert!(unknown.contains("it has get_ticks, reset_ticks, version, reset"), "{unknown}");
}

#[test]
fn monitor_reads_a_free_line_and_shows_damaged_frames() {
    let mut chatter = Vec::new();
    let mut say = |address, instruction, flags, data: &[u8], broken| {
        let mut words = Words::new();
        Frame { address, instruction, flags, data }.encode(Crc8::SAE_J1850, &mut words);
        words.last_mut().unwrap().byte ^= broken;
        chatter.extend_from_slice(&words);
    };
    say(so1::ADDRESS, 0x01, 0, &[], 0);
    say(so1::ADDRESS, 0x01, 0, &[7, 0, 8, 0], 0);
    say(psc1::ADDRESS, 0x80, 0, &[1, 0x20], 0);
    say(so1::ADDRESS, 0x01, 0, &[], 0x40);
    let boards = Boards::talking(&[], chatter);
    let frames = boards.run(&["monitor", "--for", "0.5", "--json"]).values();
    let ways: Vec<&str> = frames.iter().take(4).map(|frame| frame["way"].as_str().unwrap()).collect();
    assert_eq!(ways, ["request", "answer", "unasked", "damaged"]);
    assert_eq!(frames[1]["says"]["ticks"], serde_json::json!([7, 8]));
    assert_eq!(frames[2]["says"]["source"], "button");
    let told = boards.run(&["monitor", "--for", "0.3"]).good();
    assert!(told.contains("free: listened to"), "{told}");
    assert!(told.contains("← psc1    40  pause_changed"), "{told}");
    assert!(told.contains("wrong CRC: 01 00 00"), "{told}");
}

#[test]
fn a_port_that_cannot_be_opened_is_one_clear_line() {
    let boards = Boards::new(&[]);
    let parity = boards.run(&["scan", "--transport", "parity"]).bad();
    assert!(parity.contains("pseudo-terminal, whose driver (pty) drops PARENB"), "{parity}");
    let run = |args: &[&str]| {
        let mut command = advee("udpm://239.255.76.67:7667?ttl=0", &boards.folder);
        Outcome::of(command.arg("rs485").args(args).output().unwrap())
    };
    assert!(run(&["scan", "--port", "/no/such/port"]).bad().contains("No such file or directory"));
    assert!(run(&["scan", "--bus", "z"]).bad().contains("robot.toml has no bus [rs485.z]; it has a"));
    let mut poll = boards.command(&["poll", "0x10", "--for", "5"]).spawn().unwrap();
    sleep(std::time::Duration::from_millis(300));
    let held = boards.run(&["version", "0x10"]).bad();
    assert!(held.contains(&format!("is held by advee, process {}: end it first", poll.id())), "{held}");
    signal(poll.id() as i32, "INT");
    poll.wait().unwrap();
}

/// Lines of a command as they are printed.
fn lines(child: &mut Child) -> impl Iterator<Item = String> + use<> {
    BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok)
}

#[test]
fn a_port_held_by_a_module_is_monitored_through_it_and_otherwise_refused() {
    let mut robot = Robot::ready(&["--set", "rs485.a.raw=true"]);
    let driver = robot.view.pid("driver_rs485a");
    let mut monitor = advee(&robot.url, &robot.run_dir)
        .args(["rs485", "monitor", "--bus", "a", "--for", "1"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let told: Vec<String> = lines(&mut monitor).collect();
    assert!(monitor.wait().unwrap().success());
    assert!(told[0].contains(&format!("held by driver_rs485a, process {driver}: as it tells on LL_DATA_RAW_A")));
    for (what, least) in [("→ so1 ", 15), ("get_ticks        OK ", 15), ("→ sd1_front ", 3), (" m, floor ", 6)] {
        let count = told.iter().filter(|line| line.contains(what)).count();
        assert!(count >= least, "{count} of {what:?} in\n{}", told.join("\n"));
    }
    for command in [&["scan"][..], &["version", "so1"], &["reset", "so1"], &["poll", "so1"]] {
        let refused = Outcome::of(robot.advee(&[&["rs485"], command, &["--bus", "rs485.a"]].concat())).bad();
        assert!(refused.contains(&format!("is held by driver_rs485a, process {driver}: stop it first")), "{refused}");
    }
    // With the module stopped the port is free, and the boards of the simulator answer.
    assert!(robot.advee(&["state", "driver_rs485a", "TERMINATE"]).status.success());
    // It announces TERMINATE before it ends.
    robot.until("the driver has ended", 5.0, |_| !Path::new(&format!("/proc/{driver}")).exists());
    let told = Outcome::of(robot.advee(&["rs485", "scan", "--bus", "a", "--first", "16", "--last", "32"])).good();
    assert!(told.contains("0x10     sd1_front  SD1    1.0") && told.contains("3 boards on rs485.a"), "{told}");
    robot.stop();
}

#[test]
fn an_adapter_that_vanishes_is_an_error_of_its_module_which_recovers_when_it_returns() {
    let mut robot = Robot::ready(&[]);
    let simulator = robot.view.pid("simulator");
    let mut bus = support::listen(&robot.url);
    // With the process every pseudo-terminal disappears; the watchdog restarts it, which creates new ones.
    signal(simulator, "KILL");
    let mut states = Vec::new();
    let until = clock::now() + Duration::from_secs(10);
    while clock::now() < until && !states.ends_with(&[4, 3]) {
        bus.wait(std::time::Duration::from_millis(50)).unwrap();
        while let Some(received) = bus.recv().unwrap() {
            if received.channel == Channel::CmDataState.name()
                && let Ok(Message::CmDataState(state)) = Message::decode(Channel::CmDataState, received.payload)
                && state.module == "driver_rs485a"
                && states.last() != Some(&state.state)
            {
                states.push(state.state);
            }
        }
    }
    assert!(states.ends_with(&[4, 3]), "ERROR, then RUN: {states:?}");
    robot.until("all modules RUN again", 10.0, |view| view.pid("simulator") != simulator && view.all_run());
    let names = |path: &Path| std::fs::read_link(path.join("rs485-a")).unwrap();
    assert!(names(&robot.run_dir).starts_with("/dev/pts"));
    robot.stop();
}
