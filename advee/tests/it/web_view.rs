//! `/ws/view` and the logs of a simulated robot's web server, as used by a page: shape and rate of each part, stale
//! values, slow clients, hostile clients, recorded runs.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::page::{Frame, Socket, ask, free, get};
use crate::support::{Robot, listen, logs, signal, undisturbed};
use lcm::live::Lcm;
use messages::common::CmdLog;
use messages::lowlevel::DataSdo;
use serde_json::{Value, json};
use std::fs;
use std::net::SocketAddr;
use std::process::Child;
use std::time::{Duration, Instant};

/// `advee web` beside a robot; ended with it.
struct Web {
    at: SocketAddr,
    process: Child,
}

impl Web {
    fn beside(robot: &Robot) -> Self {
        let at = free();
        let (http, folder) = (at.to_string(), format!("log.folder={:?}", logs(&robot.run_dir)));
        let process = robot.spawn(&["web", "--http", &http, "--set", &folder]);
        let web = Self { at, process };
        let begin = Instant::now();
        while get(at, "/health").is_none() {
            assert!(begin.elapsed().as_secs() < 20, "the server is not there");
            std::thread::sleep(Duration::from_millis(30));
        }
        web
    }

    fn view(&self, query: &str) -> Socket {
        Socket::open(self.at, &format!("/ws/view{query}"), "").unwrap()
    }

    fn health(&self) -> Value {
        get(self.at, "/health").unwrap().json()
    }

    fn kib(&self, what: &str) -> u64 {
        let text = fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix(what)).unwrap();
        line.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap()
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        signal(self.process.id() as i32, "TERM");
        assert!(self.process.wait().unwrap().success() || std::thread::panicking(), "it ends in good order");
    }
}

fn part<'a>(texts: &'a [(f64, Value)], name: &str) -> Vec<&'a Value> {
    texts.iter().map(|(_, text)| text).filter(|text| text["part"] == name).collect()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn sorted<const N: usize>(mut keys: [&'static str; N]) -> Vec<&'static str> {
    keys.sort_unstable();
    keys.to_vec()
}

#[test]
fn each_part_has_its_shape_and_its_rate() {
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot);
    let mut socket = web.view("");
    robot.drive(0.3, 0.0, 1.0);
    let scene = socket.json().unwrap();
    let of_scene = sorted([
        "part",
        "robot",
        "version",
        "simulated",
        "demo",
        "outline",
        "wheelbase",
        "limits",
        "blind",
        "sonar",
        "infrared",
        "beacons",
        "walls",
        "columns",
        "routes",
        "world",
        "power_channels",
        "publish",
        "temperature_limits",
        "drives",
        "faults",
    ]);
    assert_eq!(keys(&scene), of_scene);
    assert_eq!((&scene["part"], &scene["simulated"], &scene["demo"]), (&json!("scene"), &json!(true), &Value::Null));
    let limits = json!({ "speed": 0.6, "steering": 0.6109, "sideways": 0.0, "rotation": 0.0 });
    assert_eq!(scene["limits"], limits);
    assert_eq!(scene["drives"], json!([{ "name": "propulsion", "node": 1 }, { "name": "steering", "node": 2 }]));
    let limit = |name: &str, celsius: f64| json!({ "name": name, "celsius": celsius });
    let limits = [limit("box", 60.0), limit("drives", 75.0), limit("battery", 50.0)];
    assert_eq!(scene["temperature_limits"], json!(limits));
    let count = |name: &str| scene[name].as_array().unwrap().len();
    assert!(count("walls") >= 4 && count("beacons") == 6 && count("routes") >= 1 && count("power_channels") == 8);
    let faults = scene["faults"].as_array().unwrap();
    let of = |target: &str| faults.iter().find(|faults| faults["target"] == target).unwrap()["faults"].to_string();
    assert!(of("psc1").contains("bumper") && of("gamepad").contains("plug") && of("robot").contains("kidnap"));

    socket.during(1.0);
    let texts = socket.during(5.0);
    let rates = ["drive", "sensors", "map", "system"].map(|name| part(&texts, name).len());
    assert!((47..=53).contains(&rates[0]) && (23..=27).contains(&rates[1]), "{rates:?}");
    assert!((1..=10).contains(&rates[2]) && (4..=6).contains(&rates[3]), "{rates:?}");
    let drive = part(&texts, "drive");
    let of_drive = sorted([
        "part",
        "status",
        "concerns",
        "driver",
        "motion",
        "velocity",
        "holds",
        "commands",
        "velocity_commands",
        "guard",
        "bound",
        "stop",
        "odometry",
        "estimate",
        "ellipse",
        "goal",
        "mode",
        "truth",
        "gamepad",
        "holder",
        "play",
    ]);
    assert!(drive.iter().all(|drive| keys(drive) == of_drive));
    let last = drive[drive.len() - 1];
    assert!(last["status"]["word"].is_string() && !last["status"]["reason"].as_str().unwrap().is_empty(), "{last}");
    assert_eq!(keys(&last["motion"]), sorted(["age", "period", "freshness", "value"]));
    assert_eq!((&last["motion"]["period"], &last["motion"]["freshness"]), (&json!(0.05), &json!("fresh")));
    let truth = robot.view.truth.as_ref().unwrap();
    let x = last["truth"]["value"]["x"].as_f64().unwrap();
    assert!((x - truth.x).abs() < 1.0, "{x} {}", truth.x);
    // Every part is younger than its period plus a turn of the server, even on a loaded machine.
    let ages: Vec<f64> = drive.iter().map(|drive| drive["motion"]["age"].as_f64().unwrap()).collect();
    let fresh = ages.iter().filter(|age| **age <= 0.1).count();
    assert!(fresh * 10 >= ages.len() * 9, "{ages:?}");
    let sonars = &part(&texts, "sensors")[0]["sonars"]["value"]["srfs"];
    let measures = |sonar: &Value| sonar["valid"] == sonar["distance"].is_number();
    assert!(sonars.as_array().unwrap().iter().all(measures), "NaN is null: {sonars}");
    assert!(sonars.to_string().contains(r#""distance":null"#), "one looks along the hall: {sonars}");
    let of_sensors =
        sorted(["part", "sonars", "infrareds", "ranges", "scans", "beacons", "scanner", "imus", "persons", "people"]);
    let sensors = part(&texts, "sensors");
    assert!(sensors.iter().all(|sensors| keys(sensors) == of_sensors), "{:?}", keys(sensors[0]));
    assert_eq!(sensors[0]["persons"]["freshness"], "never", "it has no lidar");
    let system = part(&texts, "system")[3];
    let of_system = sorted([
        "part",
        "modules",
        "axes",
        "wheels",
        "power",
        "temperatures",
        "busses",
        "beacon_use",
        "parameters",
        "log",
        "clock",
        "run",
        "errors",
        "reports",
        "texts",
        "channels",
        "viewers",
    ]);
    assert_eq!(keys(system), of_system);
    assert_eq!(system["viewers"], 1);
    let modules = system["modules"].as_array().unwrap();
    let module = modules.iter().find(|module| module["module"] == "driver_canbus").unwrap();
    assert_eq!(
        (&module["state"], &module["wanted"], &module["critical"], &module["well"]),
        (&json!("RUN"), &json!("RUN"), &json!(true), &json!(true))
    );
    let beacons = system["beacon_use"]["value"]["beacons"].as_array().unwrap();
    assert!(beacons.len() == 6 && beacons.iter().all(|beacon| beacon["permitted"] == true), "{beacons:?}");
    let channels = system["channels"].as_array().unwrap();
    let odometry = channels.iter().find(|channel| channel["channel"] == "LL_DATA_ODO").unwrap();
    assert!((15.0..25.0).contains(&odometry["rate"].as_f64().unwrap()), "{odometry}");

    // Values that are not published any more are stale.
    assert!(robot.advee(&["state", "driver_aux", "STOP"]).status.success());
    let begin = Instant::now();
    loop {
        let texts = socket.during(1.1);
        let temperatures = &part(&texts, "system")[0]["temperatures"];
        if temperatures["freshness"] == "stale" {
            assert!(temperatures["age"].as_f64().unwrap() > 2.0 && temperatures["value"].is_object(), "{temperatures}");
            break;
        }
        assert!(begin.elapsed().as_secs() < 10, "{temperatures}");
    }
}

#[test]
fn a_watched_channel_delivers_its_newest_message() {
    undisturbed(|| {
        let mut robot = Robot::ready(&[]);
        let web = Web::beside(&robot);
        robot.publish(DataSdo { request: 77, data: vec![1, 2], ..Default::default() });
        robot.pass(0.5);
        let mut socket = web.view("");
        socket.say(r#"{"watch":["LL_DATA_ODO","LL_DATA_SDO","STRANGE","ML_DATA_PLAN"]}"#);
        let mut bus: Lcm = listen(&robot.url);
        let speak = std::thread::spawn(move || {
            for n in 0..300u32 {
                bus.publish("STRANGE", &n.to_be_bytes()).unwrap();
                std::thread::sleep(Duration::from_millis(10));
            }
            // Newer messages replace older ones: three times, of which the planner's own plan coincides with one at most.
            for _ in 0..3 {
                bus.publish("ML_DATA_PLAN", b"nonsense").unwrap();
                std::thread::sleep(Duration::from_millis(150));
            }
        });
        let texts = socket.during(4.0);
        speak.join().unwrap();
        let of = |channel: &str| -> Vec<&Value> {
            part(&texts, "message").into_iter().filter(|text| text["channel"] == channel).collect()
        };
        let odometry = of("LL_DATA_ODO");
        assert!((60..=84).contains(&odometry.len()), "{}", odometry.len());
        assert_eq!(odometry[0]["type"], "lowlevel.data_odo_t");
        assert!(odometry[0]["value"]["ticks_left"].is_number() && odometry[0].get("error").is_none());
        assert!(odometry.windows(2).all(|pair| pair[0]["at"].as_f64() < pair[1]["at"].as_f64()), "time only grows");
        let sdo = of("LL_DATA_SDO");
        assert_eq!((sdo.len(), &sdo[0]["value"]["request"]), (1, &json!(77)), "said before somebody looked, and once");
        let strange = of("STRANGE");
        assert!((30..=64).contains(&strange.len()), "20 Hz at most: {}", strange.len());
        assert_eq!(strange[0]["error"], "a message of none of the robot's types");
        assert!(strange.iter().all(|text| text["value"].is_null() && text["type"] == ""));
        assert!(of("ML_DATA_PLAN").iter().any(|text| text["error"].is_string() && text["value"].is_null()));

        socket.say(r#"{"watch":[]}"#);
        socket.during(0.5);
        let texts = socket.during(1.0);
        assert!(part(&texts, "message").is_empty() && !part(&texts, "drive").is_empty());
        // Malformed input is counted, and tolerated up to a limit.
        for wrong in ["", "{}", r#"{"watch":["1","2","3","4","5","6","7","8","9"]}"#, r#"{"type":"stop","id":1}"#] {
            socket.say(wrong);
        }
        socket.send(2, &[1, 2, 3]).unwrap();
        assert!(!part(&socket.during(1.0), "drive").is_empty());
        assert_eq!(web.health()["refused"]["malformed"], 5);
        for (opcode, payload) in [(1, vec![b' '; 5000]), (3, vec![1]), (1, vec![0xFF, 0xFE])] {
            let mut socket = web.view("");
            socket.send(opcode, &payload).unwrap();
            while let Some(frame) = socket.frame() {
                if let Frame::Close(code, _) = frame {
                    assert_eq!(code, 1008);
                }
            }
        }
        assert_eq!(web.health()["refused"]["frame"], 3);
        assert!(robot.view.all_run());
    });
}

#[test]
fn slow_viewers_get_the_newest_at_no_cost_and_their_number_is_limited() {
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot);
    let mut good = web.view("");
    good.during(1.0);
    let before = web.kib("VmRSS:");
    // A client that never answers gets only a few pictures, and so does one that reads nothing.
    let mut mute = web.view("");
    mute.answers = false;
    let mut slow = web.view("");
    slow.say(r#"{"watch":["LL_DATA_RAW_TEST"]}"#);
    let url = robot.url.clone();
    let flood = std::thread::spawn(move || {
        let mut bus = listen(&url);
        for _ in 0..150 {
            bus.publish("LL_DATA_RAW_TEST", &vec![7; 60_000]).unwrap();
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    let texts = good.during(3.0);
    flood.join().unwrap();
    assert!(part(&texts, "drive").len() >= 27, "the others go on: {}", part(&texts, "drive").len());
    mute.patience(Duration::from_millis(500));
    let mut pictures = 0;
    while let Some(frame) = mute.frame() {
        pictures += i32::from(matches!(frame, Frame::Text(text) if text.contains(r#""part":"drive""#)));
    }
    assert!((3..=6).contains(&pictures), "{pictures} pictures on their way");
    // On reading again: first the data in transit, then new data.
    let old = slow.during(0.3);
    let begin = part(&old, "drive")[0]["motion"]["value"]["timestamp"].as_i64().unwrap();
    let new = slow.during(1.0);
    let drive = part(&new, "drive");
    let newest = drive[drive.len() - 1]["motion"]["value"]["timestamp"].as_i64().unwrap();
    assert!(newest - begin > 2_500_000, "{} us", newest - begin);
    let seen = part(&old, "drive").len() + drive.len();
    assert!(seen <= 26, "{seen} pictures in 1.3 s: none of those that it slept through");
    let grown = web.kib("VmRSS:").saturating_sub(before);
    assert!(grown < 4096, "{grown} KiB");
    drop((mute, slow));

    let health = || web.health()["refused"].clone();
    let others: Vec<_> = (0..40)
        .map_while(|_| {
            // Places of disconnected clients are free a little later.
            std::thread::sleep(Duration::from_millis(20));
            Socket::open(web.at, "/ws/view", "").ok()
        })
        .collect();
    assert!((17..=19).contains(&others.len()), "{}", others.len());
    assert_eq!(health()["viewers"], 1);
    assert_eq!(get(web.at, "/ws/view").unwrap().status, 400, "no WebSocket");
    for header in ["Origin: https://evil.example\r\n", "Origin: https://app.foxglove.dev\r\n", "Host: evil.example\r\n"]
    {
        assert_eq!(Socket::open(web.at, "/ws/view", header).err(), Some(403), "{header}");
    }
    let texts = good.during(2.5);
    let viewers = part(&texts, "system").last().unwrap()["viewers"].as_u64().unwrap();
    assert_eq!(viewers, 1 + others.len() as u64);
    robot.pass(0.2);
    assert!(robot.view.all_run());
}

#[test]
fn recorded_runs_are_listed_downloaded_and_played() {
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot);
    let folder = logs(&robot.run_dir);
    let mut record = |action, seconds| {
        robot.publish(CmdLog { timestamp: 0, action, text: "here".into() });
        robot.pass(seconds);
    };
    // The run that began with the robot, a short one, and the one being written.
    record(CmdLog::STOP, 1.5);
    record(CmdLog::START, 1.2);
    record(CmdLog::MARK, 1.3);
    record(CmdLog::STOP, 1.5);
    record(CmdLog::START, 1.5);
    let runs = get(web.at, "/api/logs").unwrap();
    assert_eq!((runs.status, runs.header("content-type")), (200, Some("application/json")));
    let runs = runs.json();
    let recording: Vec<bool> = runs.as_array().unwrap().iter().map(|run| run["recording"] == true).collect();
    assert_eq!(recording, [true, false, false], "{runs}");
    let run = runs[1]["run"].as_str().unwrap().to_owned();
    assert!(runs[1]["bytes"].as_u64().unwrap() > 1000 && runs[0]["run"].as_str().unwrap() > run.as_str(), "{runs}");

    let path = format!("/api/logs/{run}/log_000.mcap");
    let disk = fs::read(folder.join(&run).join("log_000.mcap")).unwrap();
    let whole = get(web.at, &path).unwrap();
    assert!(whole.status == 200 && whole.body == disk, "{} of {} bytes", whole.body.len(), disk.len());
    assert_eq!(whole.header("content-disposition").unwrap(), format!("attachment; filename=\"{run}_log_000.mcap\""));
    assert_eq!(whole.header("content-length").unwrap(), disk.len().to_string());
    let some = ask(web.at, "GET", &path, "Range: bytes=10-19\r\n").unwrap();
    assert_eq!((some.status, &some.body[..]), (206, &disk[10..20]));
    assert_eq!(some.header("content-range").unwrap(), format!("bytes 10-19/{}", disk.len()));
    let beyond = ask(web.at, "GET", &path, &format!("Range: bytes={}-\r\n", disk.len())).unwrap();
    assert_eq!(beyond.status, 416);
    assert!(ask(web.at, "HEAD", &path, "").unwrap().body.is_empty());
    let written = runs[0]["run"].as_str().unwrap();
    assert_eq!(get(web.at, &format!("/api/logs/{written}/log_000.mcap")).unwrap().status, 200);
    fs::write(folder.join("secret"), "secret").unwrap();
    std::os::unix::fs::symlink("/etc/passwd", folder.join(&run).join("passwd")).unwrap();
    for path in [
        &format!("/api/logs/{run}/passwd"),
        &format!("/api/logs/{run}/../secret"),
        &format!("/api/logs/{run}/%2e%2e%2fsecret"),
        &format!("/api/logs/{run}/..%2fsecret"),
        &format!("/api/logs/{run}%2f..%2fsecret/x"),
        &format!("/api/logs/{run}//etc/passwd"),
        &format!("/api/logs/{run}/%00"),
        &format!("/api/logs/{run}/%ff"),
        &format!("/api/logs/{run}/"),
        &format!("/api/logs/{run}"),
        "/api/logs/../secret",
        "/api/logs/%2e%2e/secret",
    ] {
        let answer = get(web.at, path).unwrap();
        assert!([400, 404].contains(&answer.status) && !answer.text().contains("root:"), "{path} {}", answer.status);
        assert!(!answer.text().starts_with("secret"), "{path}");
    }
    for (method, path) in [("POST", "/api/logs"), ("DELETE", path.as_str()), ("PUT", path.as_str())] {
        assert!(ask(web.at, method, path, "").unwrap().status >= 400, "{method}");
    }

    // The newest finished run, in a loop.
    let mut socket = web.view("?demo=1");
    let scene = socket.json().unwrap();
    assert_eq!(scene["demo"]["run"], run.as_str());
    let seconds = scene["demo"]["seconds"].as_f64().unwrap();
    assert!((1.0..8.0).contains(&seconds) && scene["walls"].as_array().unwrap().len() >= 4, "{}", scene["demo"]);
    assert_eq!(scene["faults"], json!([]), "nothing can be broken in a recorded run");
    let texts = socket.during(seconds + 4.0);
    let said: Vec<i64> =
        part(&texts, "drive").iter().filter_map(|drive| drive["motion"]["value"]["timestamp"].as_i64()).collect();
    assert!(said.len() as f64 > 8.0 * seconds, "{} in {seconds} s", said.len());
    let back = said.windows(2).filter(|pair| pair[0] > pair[1]).count();
    assert!((1..=4).contains(&back), "it began anew {back} times");
    let live = part(&texts, "drive").iter().filter(|drive| drive["motion"]["freshness"] == "fresh").count();
    assert!(live * 2 > said.len(), "{live} of {}", said.len());
    assert!(!part(&texts, "sensors").is_empty() && !part(&texts, "system").is_empty());

    // It pauses at a position, and goes on from there, faster.
    let position = |socket: &mut Socket| loop {
        let text = socket.json().unwrap();
        if let (Some(at), Some(rate)) = (text["play"]["at"].as_f64(), text["play"]["rate"].as_f64()) {
            return (at, rate);
        }
    };
    let settled = |socket: &mut Socket, rate: f64| {
        let begin = Instant::now();
        while position(socket).1 != rate {
            assert!(begin.elapsed().as_secs() < 10, "it takes the rate");
        }
        position(socket).0
    };
    socket.say(r#"{"rate":0,"at":1}"#);
    assert_eq!((settled(&mut socket, 0.0), position(&mut socket)), (1.0, (1.0, 0.0)));
    let paused = socket.during(1.0);
    let drive = part(&paused, "drive");
    assert!(drive.len() >= 5 && drive.iter().all(|drive| drive["motion"]["freshness"] == "fresh"), "{}", drive.len());
    let stamps: Vec<_> = drive.iter().map(|drive| &drive["motion"]["value"]["timestamp"]).collect();
    assert!(stamps.windows(2).all(|pair| pair[0] == pair[1]), "{stamps:?}");
    socket.say(r#"{"rate":0.5}"#);
    let slow = settled(&mut socket, 0.5);
    assert!((1.0..1.5).contains(&slow), "{slow}");
    socket.say(r#"{"rate":20,"at":0}"#);
    settled(&mut socket, 20.0);
    socket.say(r#"{"rate":1}"#);
    settled(&mut socket, 1.0);

    // What happened in it, and its picture.
    let events = get(web.at, &format!("/api/runs/{run}/events")).unwrap();
    assert_eq!((events.status, events.header("content-type")), (200, Some("application/json")));
    let events = events.json();
    let marks: Vec<_> = events["events"].as_array().unwrap().iter().filter(|event| event["kind"] == "mark").collect();
    assert!(marks.len() == 1 && marks[0]["words"] == "here" && events["left_out"] == 0, "{events}");
    assert!((0.5..seconds).contains(&marks[0]["at"].as_f64().unwrap()), "{events} of {seconds} s");
    let summary = || get(web.at, &format!("/api/runs/{run}/summary")).unwrap().json();
    let figures = summary();
    assert!((figures["seconds"].as_f64().unwrap() - seconds).abs() < 0.1 && figures["contacts"] == 0, "{figures}");
    assert!(figures["distance"].as_f64().unwrap() >= 0.0 && figures["stops"].is_u64(), "{figures}");
    assert_eq!(summary(), figures, "also where it is known");
    let picture = get(web.at, &format!("/api/runs/{run}/report.png")).unwrap();
    assert_eq!((picture.status, picture.header("content-type")), (200, Some("image/png")));
    assert!(picture.body.starts_with(b"\x89PNG"));
    for path in ["/api/runs/2001_01_01_00_00_00/events", "/api/runs/..%2fsecret/report.png", "/api/runs/secret/summary"]
    {
        assert_eq!(get(web.at, path).unwrap().status, 404, "{path}");
    }

    // A viewer who goes while the run is read makes room for the next one.
    for viewer in 0..12 {
        let begin = Instant::now();
        while let Err(why) = web.view("?demo=1").json() {
            assert!(why.contains("as may be at once") && begin.elapsed().as_secs() < 10, "viewer {viewer}: {why}");
        }
    }

    let why = |query: &str| match web.view(query).json() {
        Err(why) => why,
        Ok(part) => panic!("{query}: {part}"),
    };
    // The place of a viewer who has just gone may not be free yet.
    let why_in_a_place = |query: &str| {
        let begin = Instant::now();
        loop {
            let why = why(query);
            if !why.contains("as may be at once") || begin.elapsed().as_secs() >= 10 {
                return why;
            }
        }
    };
    assert_eq!(why_in_a_place("?demo=../secret"), "1008 there is no recorded run of that name");
    assert_eq!(why_in_a_place("?demo=2001_01_01_00_00_00"), "1008 there is no recorded run of that name");
    for (run, content) in [("2001_01_01_00_00_00", None), ("2001_01_01_00_00_01", Some("x".repeat(100_000)))] {
        fs::create_dir(folder.join(run)).unwrap();
        if let Some(text) = content {
            fs::write(folder.join(run).join("log_000.mcap"), text).unwrap();
        }
        assert_eq!(why_in_a_place(&format!("?demo={run}")), format!("1008 the run {run} has no messages"));
    }
    let others: Vec<Socket> = (0..3)
        .map(|viewer| {
            let begin = Instant::now();
            loop {
                let mut other = web.view(&format!("?demo={run}"));
                match other.json() {
                    Ok(_) => break other,
                    Err(why) => assert!(begin.elapsed().as_secs() < 10, "viewer {viewer}: {why}"),
                }
            }
        })
        .collect();
    assert_eq!(why("?demo"), "1013 as many recorded runs are played as may be at once");
    drop((others, socket));
    let begin = Instant::now();
    while web.view("?demo").json().is_err() {
        assert!(begin.elapsed().as_secs() < 5, "those who have gone are not played for");
        std::thread::sleep(Duration::from_millis(100));
    }
}
