//! Web server of a simulated robot, from outside: by hand-made HTTP, and by an independent viewer in Python. Hostile
//! input is survived and counted, and does not affect other clients.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{Robot, python, signal, workspace};
use messages::{Message, Raw, lowlevel};
use module::State;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Unused address.
fn free() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// Answer to a request that is sent verbatim, until the connection is closed or idle for a while.
fn say(at: SocketAddr, request: &[u8]) -> Option<String> {
    let mut line = TcpStream::connect(at).ok()?;
    line.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    // A client that is refused early may not receive the rest.
    let _ = line.write_all(request);
    let mut answer = Vec::new();
    let _ = line.read_to_end(&mut answer);
    Some(String::from_utf8_lossy(&answer).into_owned())
}

/// Status, and headers with body.
fn get(at: SocketAddr, path: &str, headers: &str) -> Option<(u16, String)> {
    let request = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{headers}\r\n");
    let answer = say(at, request.as_bytes())?;
    let (status, rest) = answer.strip_prefix("HTTP/1.1 ")?.split_once(' ')?;
    Some((status.parse().unwrap(), rest.into()))
}

fn body(at: SocketAddr, path: &str) -> Option<String> {
    let (status, rest) = get(at, path, "")?;
    (status == 200).then(|| rest.split_once("\r\n\r\n").unwrap().1.into())
}

fn health(at: SocketAddr) -> Option<Value> {
    serde_json::from_str(&body(at, "/health")?).ok()
}

#[track_caller]
fn until<T>(what: &str, seconds: f64, mut ask: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(begin.elapsed().as_secs_f64() < seconds, "not within {seconds} s: {what}");
        std::thread::sleep(Duration::from_millis(30));
    }
}

/// `advee web` beside a robot; ended with it.
struct Web {
    at: SocketAddr,
    process: Child,
}

impl Web {
    fn beside(robot: &Robot, extra: &[&str]) -> Self {
        let at = free();
        let http = at.to_string();
        let process = robot.spawn(&[&["web", "--http", &http][..], extra].concat());
        let web = Self { at, process };
        until("the server is there", 10.0, || get(at, "/health", ""));
        web
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        signal(self.process.id() as i32, "TERM");
        assert!(self.process.wait().unwrap().success() || std::thread::panicking(), "it ends in good order");
    }
}

/// Viewer in Python.
struct Viewer {
    process: Child,
    asks: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Viewer {
    fn of(python: PathBuf, at: SocketAddr) -> Self {
        let mut process = Command::new(python)
            .arg(workspace().join("advee/tests/it/web/viewer.py"))
            .arg(format!("ws://{at}/foxglove"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (asks, answers) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let mut viewer = Self { process, asks, answers: BufReader::new(answers) };
        viewer.does(json!(["ready"]));
        viewer
    }

    fn ask(&mut self, command: Value) {
        writeln!(self.asks, "{command}").unwrap();
    }

    fn answer(&mut self) -> Value {
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        serde_json::from_str(&line).expect("the viewer answers; what went wrong stands above")
    }

    fn does(&mut self, command: Value) -> Value {
        self.ask(command);
        self.answer()
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn numbers(values: &Value) -> Vec<f64> {
    values.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

#[test]
fn the_motion_of_the_robot_is_decoded_by_independent_code() {
    let Some(python) = python() else { return };
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot, &[]);
    let mut viewer = Viewer::of(python, web.at);
    let fields = json!({
        "/LL_DATA_MOTION": ["speed"], "/SIM_DATA_TRUTH": ["x", "y"], "/LL_DATA_ODO": ["ticks_left", "path"],
        "/odometry": ["pose.pose.position.x"], "/battery": ["percentage"], "/tf": ["transforms.0.child_frame_id"],
    });
    viewer.ask(json!(["watch", 6, [], fields, true]));
    robot.pass(1.5);
    let [x, y] = robot.view.truth.as_ref().map(|truth| [truth.x, truth.y]).unwrap();
    robot.drive(0.4, 0.0, 3.0);
    robot.pass(1.5);
    let seen = viewer.answer();
    assert_eq!(seen["status"], json!([]));
    assert_eq!(seen["protocol"], "foxglove.sdk.v1");
    assert_eq!(seen["info"]["capabilities"], json!(["time"]));
    let counts = &seen["counts"];
    for (topic, schema, least) in [
        ("/LL_DATA_ODO", "lowlevel/msg/DataOdo", 60),
        ("/LL_DATA_MOTION", "lowlevel/msg/DataMotion", 60),
        ("/ML_DATA_ESTIMATE", "middlelevel/msg/DataEstimate", 60),
        ("/CM_DATA_STATE", "common/msg/DataState", 20),
        ("/odometry", "nav_msgs/msg/Odometry", 60),
        ("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", 60),
        ("/tf", "tf2_msgs/msg/TFMessage", 60),
        ("/scene", "visualization_msgs/msg/MarkerArray", 60),
        ("/range/0", "sensor_msgs/msg/Range", 10),
        ("/battery", "sensor_msgs/msg/BatteryState", 3),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 20),
    ] {
        assert_eq!(seen["schemas"][topic], schema);
        assert!(counts[topic].as_u64().unwrap_or(0) >= least, "{topic}: {counts}");
    }
    let values = &seen["values"];
    let truth = [numbers(&values["/SIM_DATA_TRUTH:x"]), numbers(&values["/SIM_DATA_TRUTH:y"])];
    assert!((truth[0][0] - x).hypot(truth[1][0] - y) < 1e-9, "it stood where it began");
    let last = robot.view.truth.as_ref().unwrap();
    let way = (last.x - x).hypot(last.y - y);
    let (end, count) = (truth[0].len() - 1, counts["/SIM_DATA_TRUTH"].as_u64().unwrap());
    assert!((truth[0][end] - x).hypot(truth[1][end] - y) > 0.9 * way && way > 0.5, "{way} m after {count}");
    let fastest = numbers(&values["/LL_DATA_MOTION:speed"]).into_iter().fold(0.0, f64::max);
    assert!((0.35..0.45).contains(&fastest), "{fastest} m/s");
    assert!(numbers(&values["/battery:percentage"]).iter().all(|charge| (0.1..=1.0).contains(charge)));
    assert!(seen["times"].as_u64().unwrap() > 50, "the robot's clock");

    // A client that joins later immediately receives what was published once.
    robot.publish(lowlevel::DataSdo { request: 77, data: vec![1, 2], ..Default::default() });
    robot.pass(1.0);
    let fields = json!({ "/LL_DATA_SDO": ["request", "data.1"] });
    let seen = viewer.does(json!(["watch", 1.5, ["/LL_DATA_SDO", "/plan", "/scene", "/tf", "/battery"], fields]));
    for topic in ["/LL_DATA_SDO", "/plan", "/scene", "/tf", "/battery"] {
        assert!(seen["first"][topic].as_f64().is_some_and(|first| first < 1.0), "{topic}: {}", seen["first"]);
    }
    assert_eq!(seen["counts"]["/LL_DATA_SDO"], 1);
    assert_eq!(
        [&seen["values"]["/LL_DATA_SDO:request"], &seen["values"]["/LL_DATA_SDO:data.1"]],
        [&json!([77]), &json!([2])]
    );
}

#[test]
fn strangers_are_refused_and_counted_and_do_no_harm() {
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot, &["--set", "web.hosts=[\"advee.local\"]"]);
    let at = web.at;
    for path in ["/", "/foxglove-help", "/layout.json", "/health"] {
        let (status, answer) = get(at, path, "").unwrap();
        assert!(status == 200 && answer.contains("content-security-policy: default-src 'none'"), "{answer}");
    }
    let page = body(at, "/foxglove-help").unwrap();
    assert!(page.contains("ws://localhost/foxglove") && !page.contains("src="), "nothing from elsewhere");
    let layout: Value = serde_json::from_str(&body(at, "/layout.json").unwrap()).unwrap();
    assert!(layout["configById"].as_object().unwrap().len() > 4);
    assert_eq!(get(at, "/../etc/passwd", "").unwrap().0, 404);
    assert_eq!(get(at, "/foxglove", "").unwrap().0, 400, "no WebSocket");

    let host = |host: &str| say(at, format!("GET / HTTP/1.1\r\nConnection: close\r\n{host}\r\n").as_bytes()).unwrap();
    assert!(host("Host: ADVEE.local:80\r\n").starts_with("HTTP/1.1 200"));
    for wrong in ["", "Host: evil.example\r\n", "Host: localhost\r\nHost: evil.example\r\n"] {
        let answer = host(wrong);
        assert!(answer.starts_with("HTTP/1.1 40") && !answer.contains("advee"), "{answer}");
    }
    for origin in ["https://evil.example", "null", "http://localhost:3000"] {
        assert_eq!(get(at, "/health", &format!("Origin: {origin}\r\n")).unwrap().0, 403);
    }
    for method in ["POST", "PUT", "DELETE", "CONNECT", "\u{1}"] {
        let answer = say(at, format!("{method} / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").as_bytes());
        assert!(!answer.unwrap().starts_with("HTTP/1.1 2"), "{method}");
    }
    let long = format!("GET / HTTP/1.1\r\nHost: localhost\r\nX: {}\r\n\r\n", "x".repeat(100_000));
    assert!(!say(at, long.as_bytes()).unwrap().starts_with("HTTP/1.1 2"));
    let many = format!("GET / HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "x: y\r\n".repeat(1000));
    assert!(!say(at, many.as_bytes()).unwrap().starts_with("HTTP/1.1 2"));
    // More connections than allowed, all silent: they give way to clients that send a request.
    let silent: Vec<_> = (0..80).map(|_| TcpStream::connect(at).unwrap()).collect();
    assert!(health(at).is_some(), "others are served");
    drop(silent);
    // A client behind a proxy may be anywhere.
    assert_eq!(get(at, "/health", "X-Forwarded-For: 192.0.2.1\r\n").unwrap().0, 403);

    let refused = &health(at).unwrap()["refused"];
    assert!(refused["host"] == 3 && refused["origin"] == 3 && refused["protocol"] == 1, "{refused}");
    assert!(refused["connections"].as_u64().unwrap() >= 10 && refused["http"].as_u64().unwrap() >= 3, "{refused}");
    let before = refused["frame"].as_u64().unwrap();
    if let Some(python) = python() {
        viewers_that_lie(&mut Viewer::of(python, at), at, before);
    }
    robot.pass(0.5);
    assert!(robot.view.all_run() && robot.view.processes.values().all(|process| process.restarts == 0));
}

fn viewers_that_lie(viewer: &mut Viewer, at: SocketAddr, frames: u64) {
    let mut status =
        |origin: Value, protocol: Value| viewer.does(json!(["status", origin, protocol]))["status"].clone();
    assert_eq!(status(json!("https://evil.example"), json!("foxglove.sdk.v1")), 403);
    assert_eq!(status(json!(null), json!("mqtt")), 400);
    assert_eq!(status(json!(null), json!(null)), 400);
    for protocol in ["foxglove.sdk.v1", "foxglove.websocket.v1"] {
        assert_eq!(status(json!("https://app.foxglove.dev"), json!(protocol)), 101);
        assert_eq!(status(json!("file://"), json!(protocol)), 101);
    }
    let said = viewer.does(json!(["bad"]));
    let answers = said["answers"].as_array().unwrap();
    let granted = |answer: &&Value| answer.as_str().unwrap().ends_with("is not granted: this server is read-only");
    assert_eq!((answers.len(), answers.iter().filter(granted).count()), (28, 9), "{said:#}");
    let closed = said["closed"].as_object().unwrap();
    assert!(closed.len() == 6 && closed.values().all(|code| *code == 1008 || *code == 0), "{said:#}");
    until("all have gone", 5.0, || health(at).filter(|health| health["viewers"] == 0));
    let crowd = viewer.does(json!(["crowd", 21]));
    assert_eq!(crowd, json!({ "in": 20, "refused": [503] }));
    let health = until("all have gone", 5.0, || health(at).filter(|health| health["viewers"] == 0));
    let refused = &health["refused"];
    assert_eq!((refused["viewers"].as_u64(), refused["not_granted"].as_u64()), (Some(1), Some(9)), "{health}");
    assert_eq!(refused["frame"].as_u64().unwrap(), frames + 5, "{health}");
    assert!(refused["malformed"].as_u64().unwrap() >= 19 + 99 && refused["sent_away"] == 1, "{health}");
}

#[test]
fn a_viewer_that_does_not_read_gets_the_newest_and_slows_no_other() {
    let Some(python) = python() else { return };
    let mut robot = Robot::ready(&[]);
    let web = Web::beside(&robot, &[]);
    let [mut slow, mut good] = [python.clone(), python].map(|python| Viewer::of(python, web.at));
    // Flood of messages that no other part of the robot receives.
    let flood = |robot: &mut Robot, seconds: f64| {
        for number in 0..(seconds * 50.0) as i64 {
            let frame = lowlevel::DataRaw { timestamp: number, direction: 0, id: 0, flags: 0, data: vec![7; 20_000] };
            let (message, mut bytes) = (Message::from(Raw { bus: "TEST".into(), frame }), Vec::new());
            message.encode(&mut bytes).unwrap();
            robot.bus.publish(&message.channel_name(), &bytes).unwrap();
            robot.pass(0.02);
        }
    };
    flood(&mut robot, 0.5);
    slow.ask(json!(["slow", 5]));
    good.ask(json!(["watch", 5, ["/LL_DATA_ODO", "/LL_DATA_RAW_TEST"], {"/LL_DATA_ODO": ["path"]}]));
    flood(&mut robot, 7.0);
    let good = good.answer();
    let [odometry, raw] =
        ["/LL_DATA_ODO", "/LL_DATA_RAW_TEST"].map(|topic| good["counts"][topic].as_u64().unwrap_or(0));
    assert!(odometry >= 70 && raw >= 150, "{good}");
    flood(&mut robot, 2.0);
    let slow = slow.answer();
    assert!(slow["youngest"].as_f64().unwrap() < 0.5 && slow["count"].as_u64().unwrap() > 100, "{slow}");
    let health = health(web.at).unwrap();
    assert!(health["messages"]["dropped"].as_u64().unwrap() > 50, "{health}");
    assert_eq!(health["refused"]["sent_away"], 0, "{health}");
}

#[test]
fn an_address_other_than_loopback_needs_credentials() {
    let robot = Robot::start(&[]);
    let refused = robot.advee(&["web", "--http", "0.0.0.0:0"]);
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && text.contains("a loopback address, or web.token_file"), "{text}");
    let file = std::env::temp_dir().join(format!("advee-test-token-{}", std::process::id()));
    let write = |mode| {
        std::fs::write(&file, "0123456789abcdef\n").unwrap();
        std::fs::set_permissions(&file, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
    };
    write(0o600);
    let set = format!("web.token_file={file:?}");
    let web = Web::beside(&robot, &["--set", &set]);
    assert_eq!(get(web.at, "/", "").unwrap().0, 200, "what pairs is for everybody");
    for path in ["/health", "/foxglove", "/layout.json"] {
        assert_eq!(get(web.at, path, "").unwrap().0, 401);
    }
    assert_eq!(get(web.at, "/health", "Authorization: Bearer 0123456789abcdef\r\n").unwrap().0, 200);
    assert_eq!(get(web.at, "/health?token=0123456789abcdef", "").unwrap().0, 200);
    assert_eq!(get(web.at, "/health?token=0123456789abcdee", "").unwrap().0, 401);
    if let Some(python) = python() {
        assert_eq!(Viewer::of(python, web.at).does(json!(["status", null, "foxglove.sdk.v1"]))["status"], 401);
    }
    // A file that others may read is not a secret: it is reported, and nothing is served.
    write(0o644);
    let at = free().to_string();
    let mut other = robot.spawn(&["web", "--http", &at, "--set", &set]);
    std::thread::sleep(Duration::from_secs(1));
    assert!(get(at.parse().unwrap(), "/", "").is_none());
    signal(other.id() as i32, "TERM");
    assert!(other.wait().unwrap().success());
    std::fs::remove_file(file).unwrap();
}

#[test]
fn the_robot_runs_it_as_a_module_and_works_without_it() {
    let at = free();
    let http = at.to_string();
    let mut robot = Robot::ready(&["--http", &http]);
    assert!(robot.view.runs("web"));
    assert_eq!(health(at).unwrap()["robot"], "advee");
    // Restarted after a kill.
    let pid = robot.view.pid("web");
    robot.kill("web");
    robot.until("it is back", 5.0, |view| view.runs("web") && view.pid("web") != pid);
    until("it serves", 5.0, || health(at));
    // Another robot that wants the same address runs without the server, reports it once, and takes the address when it
    // is free.
    let mut other = Robot::start(&["--http", &http]);
    other.until("all others run", 10.0, |view| {
        let runs = |(name, process): (&String, &messages::common::Process)| {
            process.state == (if name == "web" { State::Error } else { State::Run }) as i8
        };
        view.processes.len() > 5 && view.processes.iter().all(runs)
    });
    other.pass(3.0);
    let told: Vec<_> = other.view.errors.iter().filter(|error| error.module == "web").collect();
    assert!(told.len() == 1 && told[0].message.starts_with(&format!("{at} is in use: ")), "{told:?}");
    assert_eq!(robot.stop(), 0);
    assert!(robot.processes().is_empty());
    other.until("it has the address", 5.0, |view| view.runs("web"));
    until("it serves", 5.0, || health(at));
    // Ends and starts on command.
    assert!(other.advee(&["state", "web", "TERMINATE"]).status.success());
    until("nobody answers", 5.0, || TcpStream::connect(at).is_err().then_some(()));
    assert!(other.advee(&["state", "web", "RUN"]).status.success());
    until("it serves", 5.0, || health(at));
    // Started by hand it does not take an address in use.
    let refused = other.advee(&["web", "--http", &http]);
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("--http takes another"));
    assert_eq!(other.stop(), 0);
}
