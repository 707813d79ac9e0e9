//! Authorization of commands over the web, and their effect: real sockets, a simulated robot, its bus.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::operator::{Page, Received, get, post, request};
use crate::support::{Robot, View};
use messages::{Channel, Hold, Message};
use serde_json::{Value, json};
use std::net::{SocketAddr, TcpListener};
use std::time::{Duration, Instant};
use web::ROUTES;
use web::center::access::Role;

/// Robot with a web server, and its pairing codes.
struct Bench {
    robot: Robot,
    at: SocketAddr,
}

impl Bench {
    fn start(extra: &[&str], ready: bool) -> Self {
        let at = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let http = at.to_string();
        let arguments = [&["--http", &http], extra].concat();
        let mut robot = if ready { Robot::ready(&arguments) } else { Robot::start(&arguments) };
        robot.until("the server is there", 20.0, |view| view.runs("web"));
        Self { robot, at }
    }

    /// Pairing codes, made by the command.
    fn codes(&self) -> Value {
        let told = self.robot.advee(&["web", "code", "--json"]);
        assert!(told.status.success(), "{told:?}");
        serde_json::from_slice(&told.stdout).unwrap()
    }

    /// Cookie of a newly paired device.
    fn pair(&self, role: &str, name: &str) -> String {
        let begun = Instant::now();
        loop {
            let code = self.codes()[role].clone();
            let answer = post(self.at, "/api/pair", "", &json!({ "code": code, "name": name }));
            if answer.status == 200 {
                assert_eq!(answer.json()["role"], role);
                return answer.cookie();
            }
            assert!(begun.elapsed() < Duration::from_secs(5), "{answer:?}");
            std::thread::sleep(Duration::from_millis(300));
        }
    }

    fn commands_seen(&self) -> u32 {
        let commands = self.robot.view.seen.iter().filter(|(channel, _)| channel.contains("_CMD_"));
        commands.map(|(_, count)| count).sum()
    }

    /// Speeds of the motion commands published within a time.
    fn motion(&mut self, seconds: f64) -> Vec<f64> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        let mut speeds = Vec::new();
        while let Some(left) = until.checked_duration_since(Instant::now()) {
            self.robot.bus.wait(left.min(Duration::from_millis(20))).unwrap();
            while let Some(received) = self.robot.bus.recv().unwrap() {
                if let Some(channel @ Channel::LlCmdMotion) = Channel::from_name(received.channel)
                    && let Ok(Message::LlCmdMotion(motion)) = Message::decode(channel, received.payload)
                    && motion.source.starts_with("web:")
                {
                    assert_eq!(motion.priority, 1);
                    speeds.push(motion.speed);
                }
            }
        }
        speeds
    }
}

/// Every command, well formed.
fn all() -> Vec<(Value, Role, bool)> {
    let operator = |command, authority| (command, Role::Operator, authority);
    vec![
        (json!({ "type": "take", "from": null }), Role::Operator, false),
        operator(json!({ "type": "release" }), true),
        operator(json!({ "type": "stop" }), false),
        operator(json!({ "type": "resume" }), true),
        operator(json!({ "type": "goal", "waypoints": [{ "x": 3, "y": 4, "theta": 1 }], "loop": false }), true),
        operator(json!({ "type": "route", "name": "patrol" }), true),
        operator(json!({ "type": "mode", "mode": "route" }), true),
        operator(json!({ "type": "parameter", "name": "speed_mps", "value": 0.3 }), true),
        operator(json!({ "type": "pose", "x": 1, "y": 2, "theta": 3 }), true),
        operator(json!({ "type": "beacon", "beacon": 2, "permitted": true }), true),
        operator(json!({ "type": "home", "axis": "steering" }), true),
        operator(json!({ "type": "cancel" }), false),
        operator(json!({ "type": "log", "action": "mark", "text": "here" }), false),
        (json!({ "type": "state", "module": "driver_joydev", "state": "PAUSE" }), Role::Engineer, false),
        (json!({ "type": "power", "channel": "monitor", "action": "off" }), Role::Engineer, false),
        (json!({ "type": "sdo", "node": 1, "index": 0x1000, "subindex": 0 }), Role::Engineer, false),
        (
            json!({ "type": "fault", "target": "fan1", "fault": "stall", "value": 0, "duration": 1 }),
            Role::Engineer,
            false,
        ),
        (json!({ "type": "simulation", "action": "run", "value": 0 }), Role::Engineer, false),
        (
            json!({ "type": "publish", "channel": "CM_CMD_LOG", "message": r#"{"action":2,"text":"by hand"}"# }),
            Role::Engineer,
            true,
        ),
    ]
}

#[test]
fn devices_are_paired_recognized_and_unpaired() {
    let mut bench = Bench::start(&[], false);
    let at = bench.at;
    let me = get(at, "/api/me", "").json();
    assert_eq!((&me["role"], &me["name"], &me["robot"]), (&json!("viewer"), &json!(""), &json!("advee")));
    let codes = bench.codes();
    let good = json!({ "code": codes["operator"], "name": "phone" }).to_string();
    let own = format!("Origin: http://{at}\r\n");
    let kind = "Content-Type: application/json\r\n";
    for (status, headers, body) in [
        (403, kind.to_string(), good.clone()),
        (403, format!("{kind}Origin: https://evil.example\r\n"), good.clone()),
        (403, format!("{kind}Origin: https://app.foxglove.dev\r\n"), good.clone()),
        (415, own.clone(), good.clone()),
        (415, format!("{own}Content-Type: text/plain\r\n"), good.clone()),
        (400, format!("{own}{kind}"), good.replace("phone", " ")),
        (400, format!("{own}{kind}"), "{}".into()),
        (400, format!("{own}{kind}"), "[".repeat(4000)),
        (413, format!("{own}{kind}"), "x".repeat(5000)),
        (403, format!("{own}{kind}"), json!({ "code": "12", "name": "x" }).to_string()),
    ] {
        let answer = request(at, "POST", "/api/pair", &headers, &body);
        assert!(answer.status == status && answer.json()["why"].is_string(), "{status} {headers} {answer:?}");
    }
    let answer = request(at, "POST", "/api/pair", &format!("{own}{kind}"), &good);
    assert_eq!(
        (answer.status, &answer.json()["role"], &answer.json()["name"]),
        (200, &json!("operator"), &json!("phone"))
    );
    let line = answer.head.lines().find(|line| line.starts_with("set-cookie")).unwrap();
    assert!(line.starts_with(&format!("set-cookie: advee-{}=", at.port())), "{line}");
    assert!(line.contains("; HttpOnly") && line.contains("; samesite=strict") && !line.contains("secure"), "{line}");
    let phone = answer.cookie();
    assert_eq!(get(at, "/api/me", &phone).json()["role"], "operator");
    assert_eq!(request(at, "POST", "/api/pair", &format!("{own}{kind}"), &good).status, 403, "a code pairs once");
    for stale in [format!("advee-{}=", at.port()), phone.replace('=', "=0"), phone.replace("advee-", "advee-1")] {
        assert_eq!(get(at, "/api/me", &stale).json()["role"], "viewer", "{stale}");
    }

    let desk = bench.pair("engineer", "desk");
    assert_eq!(get(at, "/api/devices", &phone).status, 403);
    assert_eq!(get(at, "/api/devices", "").status, 403, "a viewer");
    let devices = get(at, "/api/devices", &desk).json();
    assert_eq!(
        (devices.as_array().unwrap().len(), &devices[1]["you"], &devices[0]["name"]),
        (2, &json!(true), &json!("phone"))
    );

    // An engineer invites an operator's device. The page is at a loopback address here, so there is no link for a
    // phone.
    for nobody in [&phone, ""] {
        assert_eq!(post(at, "/api/invite", nobody, &json!({})).status, 403);
    }
    let invite = post(at, "/api/invite", &desk, &json!({})).json();
    assert_eq!((&invite["link"], &invite["picture"]), (&Value::Null, &json!([])));
    assert_eq!(invite["code"], bench.codes()["operator"], "the one that the robot shows");
    assert!(invite["valid_s"].as_u64().unwrap() > 299);
    let tablet = json!({ "code": invite["code"], "name": "tablet" });
    assert_eq!(post(at, "/api/pair", "", &tablet).json()["role"], "operator");
    assert_eq!(post(at, "/api/pair", "", &tablet).status, 403, "once");
    assert_eq!(post(at, "/api/devices/forget", &desk, &json!({ "id": 3 })).status, 200);

    // After a kill it is back with its paired devices. The pairing was written within a second.
    bench.robot.pass(1.5);
    let pid = bench.robot.view.pid("web");
    bench.robot.kill("web");
    bench.robot.until("it is back", 8.0, |view| view.runs("web") && view.pid("web") != pid);
    assert_eq!(get(at, "/api/me", &phone).json()["name"], "phone");
    assert_ne!(bench.codes()["engineer"], codes["engineer"]);

    let mut socket = Page::command(at, &phone);
    assert_eq!(socket.until("welcome")["role"], "operator");
    let devices = get(at, "/api/devices", &desk).json();
    assert_eq!(devices[0]["connected"], true, "{devices}");
    assert_eq!(post(at, "/api/devices/forget", &phone, &json!({ "id": 1 })).status, 403);
    assert_eq!(post(at, "/api/devices/forget", &desk, &json!({ "id": 99 })).status, 404);
    assert_eq!(post(at, "/api/devices/forget", &desk, &json!({ "id": 1 })).status, 200);
    assert_eq!(socket.closed(), (1008, "this device is not paired any more".into()));
    assert_eq!(get(at, "/api/me", &phone).json()["role"], "viewer");
    let gone = post(at, "/api/unpair", &desk, &json!({}));
    assert!(gone.status == 200 && gone.json()["role"] == "viewer" && gone.head.contains("max-age=0"), "{gone:?}");
    assert_eq!(get(at, "/api/me", &desk).json()["role"], "viewer");

    // Ten wrong codes a minute from an address; the codes stay, and no line of a log has them.
    let before = bench.codes();
    let wrong = json!({ "code": "00000000x", "name": "x" });
    let tried: Vec<u16> = (0..12).map(|_| post(at, "/api/pair", "", &wrong).status).collect();
    assert_eq!(tried, [[403; 10].as_slice(), &[429; 2]].concat());
    let code = json!({ "code": before["engineer"], "name": "x" });
    assert_eq!(post(at, "/api/pair", "", &code).status, 429);
    assert_eq!(bench.codes()["engineer"], before["engineer"]);
    let run = bench.robot.run_dir.clone();
    assert_eq!(bench.robot.stop(), 0);
    assert!(!run.join("web").exists(), "where nobody is paired nothing is left");
}

#[test]
fn a_paired_device_stops_the_robot_without_a_socket() {
    let mut bench = Bench::start(&[], true);
    let at = bench.at;
    assert_eq!(post(at, "/api/stop", "", &json!({})).status, 403, "a viewer");
    let cookie = bench.pair("operator", "phone");
    let answer = request(at, "POST", "/api/stop", &format!("Cookie: {cookie}\r\n"), "{}");
    assert_eq!(answer.status, 403, "not from the robot's own page");
    // All connections that an address may have are silent ones.
    let silent: Vec<_> = (0..80).map(|_| std::net::TcpStream::connect(at).unwrap()).collect();
    assert_eq!(post(at, "/api/stop", &cookie, &json!({})).status, 204);
    bench
        .robot
        .until("it is in PAUSE", 3.0, |view| view.processes["driver_canbus"].state == module::State::Pause as i8);
    drop(silent);
}

#[test]
fn only_paired_devices_can_write() {
    let file = std::env::temp_dir().join(format!("advee-command-token-{}", std::process::id()));
    std::fs::write(&file, "0123456789abcdef\n").unwrap();
    std::fs::set_permissions(&file, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let set = format!("web.token_file={file:?}");
    let mut bench = Bench::start(&["--set", &set], false);
    let at = bench.at;
    bench.robot.pass(1.0);
    let before = bench.commands_seen();
    let methods = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "PROPFIND"];
    let own = format!("Origin: http://{at}\r\nContent-Type: application/json\r\n");
    let mut asked = 0;
    for route in ROUTES {
        // A path with a placeholder name is not accessible either.
        let path = route.path.replace(['{', '}', '*'], "");
        for method in methods {
            for headers in
                ["", &own, "Cookie: advee-1=00000000000000000000000000000000\r\n", "Authorization: Bearer x\r\n"]
            {
                let status = request(at, method, &path, headers, "{}").status;
                asked += 1;
                let looks = ["GET", "HEAD"].contains(&method);
                match (route.role, looks) {
                    (Role::Nobody, true) => assert!(status < 500, "{method} {path}: {status}"),
                    // Pairing itself, with an invalid body.
                    (Role::Nobody, false) => assert!((400..500).contains(&status), "{method} {path}: {status}"),
                    _ => assert!([400, 401, 403, 405].contains(&status), "{method} {path}: {status}"),
                }
                assert!(route.role == Role::Nobody || !looks || status == 401, "{method} {path}: {status}");
            }
        }
    }
    assert!(asked >= ROUTES.len() * methods.len() * 4 && ROUTES.len() >= 9);
    for route in ROUTES.iter().filter(|route| route.path.starts_with("/ws") || route.path == "/foxglove") {
        for headers in ["", &own, "Origin: https://app.foxglove.dev\r\n", "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n"]
        {
            let refused = Page::open(at, at, route.path, headers).err();
            assert!(refused == Some(401) || refused == Some(403), "{} {headers}: {refused:?}", route.path);
        }
    }
    // In the address the credentials allow reading only.
    let token = "?token=0123456789abcdef";
    assert_eq!(get(at, &format!("/api/me{token}"), "").json()["role"], "viewer");
    let mut viewer = Page::open(at, at, &format!("/ws/command{token}"), "").unwrap_or_else(|code| panic!("{code}"));
    assert_eq!(viewer.until("welcome")["role"], "viewer");
    for (command, ..) in all() {
        assert!(viewer.ask(command.clone()).is_err(), "{command}");
    }
    viewer.drive(1, 0.2, 0.0);
    viewer.zero(1);
    assert_eq!(viewer.until("refused")["id"], Value::Null);
    let bearer = "Authorization: Bearer 0123456789abcdef\r\n";
    assert_eq!(request(at, "GET", "/api/me", bearer, "").json()["role"], "engineer");
    assert_eq!(
        Page::open(at, at, "/ws/command", &format!("{bearer}Origin: https://app.foxglove.dev\r\n")).err(),
        Some(403)
    );
    bench.robot.pass(1.0);
    assert_eq!(bench.commands_seen(), before, "nothing was said on the bus");
    std::fs::remove_file(file).unwrap();
}

#[test]
fn each_role_has_exactly_its_rights() {
    let mut bench = Bench::start(&[], true);
    let at = bench.at;
    let cookies = [String::new(), bench.pair("operator", "Ann"), bench.pair("engineer", "Eve")];
    for (cookie, role) in cookies.iter().zip([Role::Viewer, Role::Operator, Role::Engineer]) {
        let mut page = Page::command(at, cookie);
        let welcome = page.until("welcome");
        assert_eq!(welcome["role"], serde_json::to_value(role).unwrap());
        assert!(welcome["limits"]["speed"].as_f64().unwrap() > 0.1);
        for holds in [false, true] {
            for (command, least, authority) in all() {
                if holds && command["type"] != "take" && command["type"] != "release" {
                    let taken = page.ask(json!({ "type": "take", "from": null }));
                    assert_eq!(taken.is_ok(), role >= Role::Operator);
                }
                // Independent of each other: at first no page holds control.
                let _ = if holds { Ok(Value::Null) } else { page.ask(json!({ "type": "release" })) };
                let mine = authority && command["type"] == "release" && holds;
                if mine {
                    let _ = page.ask(json!({ "type": "take", "from": null }));
                }
                let answer = page.ask(command.clone());
                let may = role >= least && (!authority || holds);
                assert_eq!(answer.is_ok(), may, "{role:?} holds {holds} {command}: {answer:?}");
                if let Err(why) = answer {
                    assert!(why.len() > 10 && why.contains(' '), "in words: {why}");
                }
            }
        }
        let _ = page.ask(json!({ "type": "release" }));
    }
    // The commands were published.
    let mut page = Page::command(at, &cookies[2]);
    let object = page.ask(json!({ "type": "sdo", "node": 1, "index": 0x1000, "subindex": 0 })).unwrap();
    assert!(object["abort"] == 0 && object["data"].as_str().unwrap().len() == 8, "{object}");
    let none = page.ask(json!({ "type": "sdo", "node": 1, "index": 0x4321, "subindex": 0 })).unwrap();
    assert!(none["abort"] != 0 && none["data"] == "" && none["why"].as_str().unwrap().len() > 5, "{none}");
    page.ask(json!({ "type": "state", "module": "driver_joydev", "state": "PAUSE" })).unwrap();
    bench
        .robot
        .until("it is in PAUSE", 3.0, |view| view.processes["driver_joydev"].state == module::State::Pause as i8);
    page.ask(json!({ "type": "state", "module": "driver_joydev", "state": "RUN" })).unwrap();
    page.ask(json!({ "type": "level", "module": "driver_joydev", "print": "ERROR", "send": "DEBUG" })).unwrap();
    let answered = |view: &View| view.seen.get("CM_DATA_LEVEL").is_some_and(|count| *count > 0);
    bench.robot.until("the module answers with its levels", 3.0, answered);
    for channel in [
        "CM_CMD_LEVEL",
        "ML_CMD_GOAL",
        "ML_CMD_MODE",
        "ML_CMD_PARAMETER",
        "ML_CMD_ESTIMATE",
        "ML_CMD_BEACON_USE",
        "LL_CMD_HOMING",
        "CM_CMD_LOG",
        "CM_CMD_STATE",
        "LL_CMD_POWER",
        "SIM_CMD_FAULT",
    ] {
        assert!(bench.robot.view.seen.get(channel).is_some_and(|count| *count > 0), "{channel}");
    }
}

#[test]
fn one_device_drives_at_a_time_and_invalid_input_never_moves_the_robot() {
    let mut bench = Bench::start(&[], true);
    let at = bench.at;
    let cookies = [bench.pair("operator", "Ann"), bench.pair("operator", "Bob")];
    let [mut ann, mut bob] = [0, 1].map(|index| Page::command(at, &cookies[index]));
    let [id, other] = [&mut ann, &mut bob].map(|page| page.until("welcome")["you"].clone());
    assert_ne!(id, other);
    // Without control nothing moves.
    ann.drive(1, 0.2, 0.0);
    assert_eq!(ann.until("ended")["hold"], 1);
    ann.ask(json!({ "type": "take", "from": null })).unwrap();
    loop {
        let told = bob.until("authority");
        if told["holder"] != Value::Null {
            assert!(told["holder"]["id"] == id && told["holder"]["name"] == "Ann" && told["yours"] == false, "{told}");
            break;
        }
    }
    assert!(bob.ask(json!({ "type": "take", "from": null })).unwrap_err().starts_with("Ann holds the robot"));
    let drive = |page: &mut Page, hold: u64, times: u32, speed: f64| {
        for _ in 0..times {
            page.drive(hold, speed, 0.0);
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    bench.motion(0.1);
    // She drives; a hold begins with zero; after the release zero is sent at once, twice more, and then nothing.
    drive(&mut ann, 2, 6, 0.2);
    ann.zero(2);
    let said = bench.motion(0.6);
    assert_eq!(said, [&[0.0], [0.2; 6].as_slice(), &[0.0; 3]].concat());
    // Silence ends it too.
    drive(&mut ann, 3, 2, 0.2);
    assert_eq!(ann.until("ended")["hold"], 3);
    assert_eq!(bench.motion(0.5), [0.0, 0.2, 0.2, 0.0, 0.0, 0.0]);
    // An exact repetition, a command out of order, one of a hold that has ended, one of the other page.
    let (seq, t) = (ann.seq, ann.clock());
    for seq in [seq, seq - 1, 1] {
        ann.send(&json!({ "type": "drive", "hold": 9, "seq": seq, "t": t, "speed": 0.2, "steering": 0 }));
    }
    ann.drive(3, 0.2, 0.0);
    bob.drive(1, 0.2, 0.0);
    assert_eq!(bob.until("ended")["hold"], 1);
    assert!(bench.motion(0.4).is_empty());
    // An invalid or excessive value ends the hold.
    for (hold, wrong) in [(10, "null"), (11, "NaN"), (12, "1e999"), (13, "99"), (14, "\"0.2\"")] {
        ann.drive(hold, 0.2, 0.0);
        ann.seq += 1;
        let (seq, t) = (ann.seq, ann.clock());
        ann.send_text(&format!(
            "{{\"type\":\"drive\",\"hold\":{hold},\"seq\":{seq},\"t\":{t},\"speed\":{wrong},\"steering\":0}}"
        ));
        assert_eq!(ann.until("ended")["hold"], hold, "{wrong}");
        ann.drive(hold, 0.2, 0.0);
        assert_eq!(bench.motion(0.4), [0.0, 0.2, 0.0, 0.0, 0.0], "{wrong}");
    }
    // After a takeover she is notified, and zeros are published for her.
    drive(&mut ann, 20, 2, 0.2);
    bob.ask(json!({ "type": "take", "from": id })).unwrap();
    assert_eq!(ann.until("ended")["hold"], 20);
    let told = ann.until("authority");
    assert!(told["yours"] == false && told["why"] == "Bob has taken over from you", "{told}");
    drive(&mut ann, 20, 2, 0.2);
    assert_eq!(bench.motion(0.4), [0.0, 0.2, 0.2, 0.0, 0.0, 0.0]);
    // Any page can stop the robot; the one in control resumes it.
    let steering = |bench: &Bench| bench.robot.view.reason();
    drive(&mut bob, 1, 2, 0.2);
    drive(&mut bob, 2, 4, 0.2);
    ann.ask(json!({ "type": "stop" })).unwrap();
    assert!(bob.until("ended")["why"].as_str().unwrap().contains("Ann"));
    bench.robot.until("it is held", 2.0, |view| view.causes().contains(&Hold::ModulePaused));
    assert!(ann.ask(json!({ "type": "resume" })).unwrap_err().contains("Bob"), "{}", steering(&bench));
    bob.ask(json!({ "type": "resume" })).unwrap();
    bench.robot.until("it goes on", 3.0, |view| !view.causes().contains(&Hold::ModulePaused));
    // Two sockets of one device are separate; control ends with its socket.
    let mut second = Page::command(at, &cookies[1]);
    assert!(second.ask(json!({ "type": "release" })).is_err());
    bench.motion(0.2);
    drive(&mut bob, 30, 2, 0.2);
    drop(bob);
    assert_eq!(bench.motion(0.5), [0.0, 0.2, 0.2, 0.0, 0.0, 0.0]);
    loop {
        let told = second.until("authority");
        if told["holder"] == Value::Null && told["why"] != "" {
            break;
        }
    }
    // Malformed input, a flood, an overlong message: each affects only its sender.
    second.send_text("hello");
    assert_eq!(second.until("refused")["id"], Value::Null);
    second.frame(2, b"\x00\x01");
    second.until("refused");
    for number in 0..150 {
        second.send(&json!({ "type": "ping", "t": number }));
    }
    assert_eq!(second.closed(), (1008, "more than 100 messages a second".into()));
    let mut third = Page::command(at, &cookies[1]);
    third.send_text(&" ".repeat(5000));
    assert_eq!(third.closed().0, 1009);
    assert_eq!(Page::open(at, at, "/ws/command?demo=1", &format!("Cookie: {}\r\n", cookies[1])).err(), Some(403));
    ann.send(&json!({ "type": "ping", "t": 5 }));
    assert_eq!(ann.until("pong")["t"], 5.0);
    // A silent client is disconnected after ten seconds.
    let begun = Instant::now();
    assert_eq!(ann.closed(), (1008, "nothing was heard for 10 s".into()));
    assert!((9.0..12.0).contains(&begun.elapsed().as_secs_f64()), "{:?}", begun.elapsed());
    bench.robot.pass(0.5);
    assert!(bench.robot.view.processes.values().all(|process| process.restarts == 0));
    assert!(matches!(Page::command(at, "").receive(Duration::from_secs(2)), Received::Message(_)));
}
