//! Inputs of modules, recorded and replayed: live and in virtual time, intact and damaged.

mod support;

use base::{Duration, Instant};
use messages::lowlevel;
use module::State;
use record::Sink;
use robot::place::RobotLocation;
use robot::topology::virtual_machine_recorded;
use serde_json::Value;
use sim::host::Config;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::rc::Rc;
use support::Robot;

const MODULES: [&str; 11] = [
    "driver_aux",
    "driver_canbus",
    "driver_joydev",
    "driver_power",
    "driver_rs485a",
    "driver_rs485b",
    "estimator",
    "guard",
    "planner",
    "simulator",
    "watchdog",
];

/// Folder of a run, removed at the end.
struct Run(PathBuf);

impl Drop for Run {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl Run {
    fn file(&self, name: &str) -> PathBuf {
        self.0.join("inputs").join(name)
    }

    /// Replays the run, or a file: exit code, and the report on each file.
    fn replay(path: &Path, extra: &[&str]) -> (i32, Vec<Value>) {
        let output = Command::new(env!("CARGO_BIN_EXE_advee"))
            .args(["replay", "--json"])
            .arg(path)
            .args(extra)
            .output()
            .expect("the executable is built");
        let text = String::from_utf8(output.stdout).expect("text");
        let lines = text.lines().map(|line| serde_json::from_str(line).expect("JSON"));
        (output.status.code().expect("it ends by itself"), lines.collect())
    }

    fn text(&self, extra: &[&str]) -> String {
        let output = Command::new(env!("CARGO_BIN_EXE_advee")).arg("replay").arg(&self.0).args(extra).output();
        String::from_utf8(output.expect("the executable is built").stdout).expect("text")
    }
}

/// Output of a process so far.
type File = Rc<RefCell<Vec<u8>>>;

/// Recorded run in virtual time: homed, driven, with a killed module.
fn recorded(name: &str) -> Run {
    recorded_with(name, &[])
}

/// The same of a robot with this laid over its configuration.
fn recorded_with(name: &str, sets: &[&str]) -> Run {
    let run = Run(std::env::temp_dir().join(format!("advee-replay-{name}-{}", std::process::id())));
    fs::create_dir_all(run.0.join("inputs")).expect("a folder");
    let place = RobotLocation {
        config: support::workspace().join("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: sets.iter().map(|set| (*set).to_owned()).collect(),
        sim: true,
        world: None,
    };
    let files: Rc<RefCell<BTreeMap<String, File>>> = Rc::default();
    let keep = files.clone();
    let sink = move |module: &str| {
        let lives = keep.borrow().keys().filter(|name| name.split('.').next() == Some(module)).count();
        let name = if lives == 0 { module.to_string() } else { format!("{module}.{}", lives + 1) };
        let file = keep.borrow_mut().entry(name).or_default().clone();
        let sink: Sink = Box::new(move |record| {
            file.borrow_mut().extend_from_slice(record);
            true
        });
        Some(sink)
    };
    let config = Config { seed: 7, lcm_jitter: Duration::from_micros(200), ..Config::default() };
    let mut machine = virtual_machine_recorded(&place, config, sink).expect("the shipped configuration");
    machine.spawn("watchdog", State::Run).expect("the watchdog starts");
    let at = |ms: u64| Instant::from_millis(ms);
    for ms in (12_000..14_000).step_by(50) {
        let priority = lowlevel::CmdMotion::REMOTE;
        let command = lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.2, priority, source: "test".into() };
        machine.inject(at(ms), command);
    }
    machine.run_until(at(16_000));
    machine.kill(machine.pid("driver_rs485a").expect("it runs"));
    machine.run_until(at(18_000));
    drop(machine);
    for (name, file) in files.borrow().iter() {
        fs::write(run.file(name), &*file.borrow()).expect("written");
    }
    run
}

#[test]
fn a_run_in_virtual_time_is_replayed_bit_for_bit() {
    let run = recorded("virtual");
    let (code, lines) = Run::replay(&run.0, &[]);
    let results: Vec<(&str, &str)> =
        lines.iter().map(|line| (line["file"].as_str().unwrap(), line["result"].as_str().unwrap())).collect();
    let mut expected: Vec<(&str, &str)> = MODULES.map(|module| (module, "same")).to_vec();
    expected.push(("driver_rs485a.2", "same"));
    expected.sort_unstable();
    assert_eq!(results, expected, "{lines:?}");
    assert_eq!(code, 0);
    assert!(lines.iter().all(|line| line["events"].as_u64().unwrap() > 50), "{lines:?}");
    let (code, lines) = Run::replay(&run.0, &["--module", "driver_rs485a"]);
    assert_eq!((code, lines.len()), (0, 2), "both its lives");
}

#[test]
fn a_run_with_inertial_units_is_replayed_bit_for_bit() {
    let units = [
        "imu.base.model=witmotion",
        "imu.base.port=imu-base",
        "imu.chip.model=bno055",
        "imu.chip.bus=i2c.aux",
        "imu.rear.model=xsens-mti",
        "imu.rear.bus=can.main",
    ];
    let run = recorded_with("imu", &units);
    let (code, lines) = Run::replay(&run.0, &[]);
    assert_eq!(code, 0, "{lines:?}");
    assert!(lines.iter().all(|line| line["result"] == "same"), "{lines:?}");
    for module in ["driver_imu", "estimator", "simulator"] {
        let of = lines.iter().find(|line| line["file"] == module).unwrap_or_else(|| panic!("{module}: {lines:?}"));
        assert!(of["events"].as_u64().unwrap() > 1000, "{of}");
    }
}

/// Number of occurrences of `what` in the group of this name.
fn within(svg: &str, group: &str, what: &str) -> usize {
    let (_, from) = svg.split_once(&format!("<g class=\"{group}\">")).unwrap_or_else(|| panic!("no {group}"));
    from.split("</g>").next().map_or(0, |group| group.matches(what).count())
}

#[test]
fn a_run_is_drawn_from_its_recorded_messages() {
    let run = recorded("plot");
    let plot = |extra: &[&str]| {
        let advee = Command::new(env!("CARGO_BIN_EXE_advee")).arg("plot").arg(&run.0).args(extra).output().unwrap();
        (advee.status.code(), String::from_utf8(advee.stderr).unwrap())
    };
    let svg = run.0.join("plot.svg");
    assert_eq!(plot(&["--out", svg.to_str().unwrap()]), (Some(0), String::new()));
    let drawn = fs::read_to_string(&svg).unwrap();
    // It drove 0.8 m in the hall of thirteen walls, six columns and six beacons.
    assert_eq!((within(&drawn, "world", "<polyline"), within(&drawn, "world", "<circle")), (13, 6));
    assert_eq!((within(&drawn, "beacons", "<circle"), within(&drawn, "truth", "<polyline")), (6, 1));
    assert_eq!((within(&drawn, "robot", "<polygon"), within(&drawn, "speed", "polyline") > 4), (1, true));
    // Eleven modules, each with its name; one died, which the watchdog reported.
    assert_eq!(MODULES.map(|module| within(&drawn, "states", &format!(">{module}<"))), [1; 11]);
    assert!(drawn.contains("ERROR  watchdog ModuleDied: driver_rs485a ended by signal 9"));
    assert!(drawn.contains("the steering is being homed"));

    assert_eq!(plot(&[]), (Some(0), String::new()));
    let png = fs::read(run.0.join("plot.png")).unwrap();
    let mut decoder = png::Decoder::new(std::io::Cursor::new(&png));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(info.width == 2000 && info.height > 2000 && png.len() < 300_000, "{info:?}, {} bytes", png.len());
    assert!(pixels.chunks(3).filter(|pixel| pixel.iter().all(|part| *part < 128)).count() > 20_000);

    let (code, said) = plot(&["--from", "1e6"]);
    assert!(code == Some(1) && said.trim_end().ends_with("nothing was said of a robot in that time"), "{said}");
    let (code, said) = plot(&["--out", "picture.pdf"]);
    assert!(code == Some(2) && said.contains("expected a file .png or .svg") && said.lines().count() == 1, "{said}");

    // A damaged file is drawn up to the damage; a foreign file is reported in one line.
    let file = run.file("simulator");
    let mut bytes = fs::read(&file).unwrap();
    let half = bytes.len() / 2;
    bytes[half] ^= 0x40;
    fs::write(&file, bytes).unwrap();
    assert_eq!(plot(&["--out", svg.to_str().unwrap()]), (Some(0), String::new()));
    let drawn = fs::read_to_string(&svg).unwrap();
    assert!(within(&drawn, "remarks", "simulator: ") == 1 && within(&drawn, "truth", "<polyline") <= 1);
    for name in MODULES.into_iter().chain(["driver_rs485a.2"]) {
        fs::write(run.file(name), "something else").unwrap();
    }
    let (code, said) = plot(&[]);
    assert!(code == Some(1) && said.contains("none of its 12 files is a recording of inputs"), "{said}");
}

#[test]
fn a_changed_constant_is_shown_with_its_instant_channel_and_fields() {
    let run = recorded("constant");
    // The robot coasts as far as before: the set-points differ.
    let sets = ["--set", "limits.speed_manual_mps=0.1"];
    let (code, lines) = Run::replay(&run.0, &[&["--module", "driver_canbus"], &sets[..]].concat());
    assert_eq!(code, 1);
    let difference = &lines[0]["different"];
    assert_eq!(difference["on"], "message LL_CMD_MOTION", "{lines:?}");
    let time = difference["time"].as_f64().unwrap();
    assert!((11.5..13.0).contains(&time), "{difference}");
    assert_eq!(difference["channel"], "can.main", "{difference}");
    assert_eq!(difference["fields"][0]["field"], "data", "{difference}");

    // A shorter validity of commands shows when its end is the module's next deadline.
    let (code, lines) = Run::replay(&run.file("driver_canbus"), &["--set", "limits.command_ttl_s=0.2"]);
    assert_eq!(code, 1);
    let difference = &lines[0]["different"];
    assert_eq!(difference["channel"], "timer", "{difference}");
    let field = &difference["fields"][0];
    assert!(field["field"] == "due in s" && field["was"].as_f64() > field["is"].as_f64(), "{difference}");

    // Field of a message.
    let (code, lines) = Run::replay(&run.file("driver_rs485a"), &["--set", "geometry.wheel_radius_m=0.101"]);
    assert_eq!(code, 1);
    let difference = &lines[0]["different"];
    assert_eq!(difference["channel"], "LL_DATA_ODO", "{difference}");
    let fields: Vec<&str> =
        difference["fields"].as_array().unwrap().iter().map(|field| field["field"].as_str().unwrap()).collect();
    assert!(fields.contains(&"translation"), "{difference}");
    let text = run.text(&["--module", "driver_rs485a", "--set", "geometry.wheel_radius_m=0.101"]);
    assert!(text.contains("DIFFERENT") && text.contains("translation: 0."), "{text}");
    // An unaffected module has the same result.
    let (code, _) = Run::replay(&run.file("driver_power"), &["--set", "geometry.wheel_radius_m=0.101"]);
    assert_eq!(code, 0);
}

#[test]
fn a_truncated_damaged_or_incomplete_recording_is_refused_with_its_position() {
    let run = recorded("harmed");
    let whole = fs::read(run.file("driver_power")).unwrap();
    let harmed = run.file("harmed");
    let refused = |bytes: &[u8]| {
        fs::write(&harmed, bytes).unwrap();
        let (code, lines) = Run::replay(&harmed, &[]);
        assert_eq!((code, &lines[0]["result"]), (1, &"refused".into()), "{lines:?}");
        let refusal = &lines[0]["refused"];
        (refusal["why"].as_str().unwrap().to_string(), refusal["byte"].as_u64().unwrap(), lines[0]["events"].as_u64())
    };
    let half = whole.len() / 2;
    let (why, byte, before) = refused(&whole[..half]);
    assert_eq!(why, "cut off");
    assert!(byte as usize <= half && byte as usize > half - 1000 && before > Some(100), "{byte} of {half}: {before:?}");

    let mut damaged = whole.clone();
    damaged[half] ^= 0x40;
    let (why, ..) = refused(&damaged);
    assert!(why.starts_with("damaged") || why == "cut off", "{why}");

    // One whole record removed.
    let mut reader = record::Reader::open(&whole).unwrap();
    let mut places = Vec::new();
    while let Some(record::Item::Record(record)) = reader.read().unwrap() {
        places.push(record.place);
    }
    let (why, byte, _) = refused(&[&whole[..places[200]], &whole[places[201]..]].concat());
    assert!(why.starts_with("a gap: record "), "{why}");
    assert_eq!(byte as usize, places[200]);

    let mut newer = whole.clone();
    newer[8] = 3;
    assert_eq!(refused(&newer).0, "of version 3 of the format; this program reads 1 to 2");
    let mut older = whole.clone();
    older[8] = 1;
    assert!(refused(&older).0.starts_with("of version 1 of the format, when modules did not yet publish"));
    assert_eq!(refused(b"something else").0, "not a file of recorded inputs");
    assert_eq!(refused(b"").0, "cut off");
    let none = Command::new(env!("CARGO_BIN_EXE_advee")).args(["replay", "/nonexistent"]).output().unwrap();
    assert!(!none.status.success());
    let why = String::from_utf8_lossy(&none.stderr).into_owned();
    assert!(why.starts_with("advee: /nonexistent/inputs: ") && why.lines().count() == 1, "{why}");
}

#[test]
fn a_live_run_is_replayed_bit_for_bit() {
    support::undisturbed(|| {
        let mut robot = Robot::ready(&["--set", "guard.ranging=\"sonar\""]);
        robot.drive(0.4, 0.1, 2.0);
        assert!(robot.view.speed() > 0.3, "{}", robot.view.reason());
        let pid = robot.view.pid("driver_rs485a");
        robot.kill("driver_rs485a");
        robot.until("it is back", 5.0, |view| view.runs("driver_rs485a") && view.pid("driver_rs485a") != pid);
        robot.pass(1.0);
        assert_eq!(robot.stop(), 0);
        let runs: Vec<PathBuf> =
            fs::read_dir(support::logs(&robot.run_dir)).unwrap().map(|entry| entry.unwrap().path()).collect();
        let [run] = &runs[..] else { panic!("one run, one folder: {runs:?}") };
        let name = run.file_name().unwrap().to_string_lossy().into_owned();
        assert!(name.len() == 19 && name.starts_with("20") && name.split('_').count() == 6, "{name}");
        let (code, lines) = Run::replay(run, &[]);
        let results: Vec<(&str, &str)> =
            lines.iter().map(|line| (line["file"].as_str().unwrap(), line["result"].as_str().unwrap())).collect();
        let mut expected: Vec<(&str, &str)> = MODULES.map(|module| (module, "same")).to_vec();
        expected.push(("driver_rs485a.2", "same"));
        expected.sort_unstable();
        assert_eq!(results, expected, "{lines:?}");
        assert_eq!(code, 0);
        for line in &lines {
            // The killed process has no end record; all others exited normally.
            let end = if line["file"] == "driver_rs485a" { "open" } else { "exited" };
            assert_eq!(line["same"]["end"], end, "{line}");
            assert!(line["events"].as_u64().unwrap() > 30, "{line}");
        }
    });
}
