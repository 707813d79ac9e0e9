//! `advee action …` as used from the shell, on a bus of its own, with a module that the test plays.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{advee, unique_port};
use lcm::live::Lcm;
use messages::Message;
use messages::highlevel::{CmdAction, DataAction};
use std::process::Stdio;
use std::time::Duration;

/// What the command printed and sent.
struct Run {
    code: Option<i32>,
    out: String,
    error: String,
    sent: Vec<CmdAction>,
}

/// Runs `advee action` beside a module that publishes `lasting` again and again, and answers each command by `answer`.
fn run(args: &[&str], lasting: &[DataAction], answer: impl Fn(&CmdAction) -> Vec<DataAction>) -> Run {
    let port = unique_port();
    let url = format!("udpm://239.255.76.67:{port}?ttl=0");
    let run_dir = std::env::temp_dir().join(format!("advee-action-{}-{port}", std::process::id()));
    let (bus_url, _) = lcm::Url::parse(&url).expect("a good url");
    let mut bus = Lcm::new(&bus_url).expect("the bus opens");
    // Its own messages would wake it.
    bus.subscribe("HL_CMD_ACTION").expect("a good pattern");
    let mut command = advee(&url, &run_dir);
    command.arg("action").args(args).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the executable is built");
    let mut sent = Vec::new();
    loop {
        let has_ended = child.try_wait().expect("it was started").is_some();
        lasting.iter().for_each(|data| publish(&mut bus, data.clone()));
        bus.wait(Duration::from_millis(20)).expect("the bus can be waited for");
        while let Some(message) = next(&mut bus) {
            if let Some(Message::HlCmdAction(command)) = message {
                answer(&command).into_iter().for_each(|data| publish(&mut bus, data));
                sent.push(command);
            }
        }
        if has_ended {
            break;
        }
    }
    let output = child.wait_with_output().expect("it has ended");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    Run { code: output.status.code(), out: text(output.stdout), error: text(output.stderr), sent }
}

fn publish(bus: &mut Lcm, data: DataAction) {
    let (message, mut bytes) = (Message::from(data), Vec::new());
    message.encode(&mut bytes).unwrap();
    bus.publish(message.channel().name(), &bytes).unwrap();
}

/// Next message of the bus; `None` within for one that is not the robot's.
fn next(bus: &mut Lcm) -> Option<Option<Message>> {
    let received = bus.recv().unwrap()?;
    Some(Message::receive(received.channel, received.payload).transpose().ok().flatten())
}

fn status(id: &str, status: i8, progress: f64, message: &str) -> DataAction {
    DataAction { timestamp: 1, id: id.into(), status, progress, message: message.into() }
}

#[test]
fn an_action_is_followed_to_its_end() {
    let answer = |command: &CmdAction| {
        let said = |number, share, message| status(&command.id, number, share, message);
        vec![
            said(DataAction::ACCEPTED, f64::NAN, ""),
            said(DataAction::RUNNING, 0.5, "Good\nmorning."),
            said(DataAction::SUCCEEDED, 1.0, "done"),
        ]
    };
    let run = run(&["present", "text=Good morning.", "seconds=2", "--id", "a-1"], &[], answer);
    assert_eq!(run.out, "accepted      -\nrunning    50 %  Good morning.\nsucceeded 100 %  done\n");
    assert_eq!((run.code, &*run.error), (Some(0), ""));
    let CmdAction { name, parameters, .. } = &run.sent[0];
    let parameters: Vec<_> = parameters.iter().map(|one| (&*one.name, &*one.value)).collect();
    assert_eq!((&**name, parameters), ("present", vec![("text", "Good morning."), ("seconds", "2")]));
    assert!(run.sent.iter().all(|command| command.id == "a-1" && !command.cancel), "{:?}", run.sent);
}

#[test]
fn every_other_end_is_an_error_with_the_words_of_the_module() {
    for (number, expected) in [
        (DataAction::FAILED, "advee: present has failed: the display is off\n"),
        (DataAction::CANCELLED, "advee: present was cancelled: the display is off\n"),
        (DataAction::REJECTED, "advee: present was rejected: the display is off\n"),
    ] {
        let run =
            run(&["present", "--json"], &[], |command| vec![status(&command.id, number, 0.1, "the display is off")]);
        assert_eq!((run.code, &*run.error), (Some(1), expected));
        let shown: serde_json::Value = serde_json::from_str(&run.out).unwrap();
        assert_eq!((&shown["action"]["status"], &shown["action"]["progress"]), (&number.into(), &0.1.into()));
    }
}

#[test]
fn an_action_that_nobody_offers_is_given_up_and_cancelled() {
    let run = run(&["dance"], &[], |_| vec![]);
    assert_eq!((run.code, &*run.out), (Some(1), ""));
    assert!(run.error.starts_with("advee: nobody offers dance on udpm://"), "{}", run.error);
    let [first, .., last] = &run.sent[..] else { panic!("{:?}", run.sent) };
    assert!(run.sent.len() >= 3 && first.id.starts_with("dance@") && !first.cancel, "{:?}", run.sent);
    assert!(last.cancel && last.id == first.id && last.name == "dance", "{last:?}");
}

#[test]
fn an_action_whose_module_falls_silent_counts_as_failed() {
    let run = run(&["present"], &[], |command| match command.cancel {
        true => vec![],
        false => vec![status(&command.id, DataAction::RUNNING, 0.0, "")],
    });
    assert_eq!(run.code, Some(1));
    assert_eq!(run.error, "advee: present counts as failed: its module has been silent for 3 s\n");
    assert!(run.sent.last().is_some_and(|last| last.cancel), "{:?}", run.sent);
}

#[test]
fn an_action_is_cancelled_after_its_time_or_by_its_id() {
    let answer = |command: &CmdAction| match command.cancel {
        true => vec![status(&command.id, DataAction::CANCELLED, 0.3, "after one of three sentences")],
        false => vec![status(&command.id, DataAction::RUNNING, 0.0, "")],
    };
    let limited = run(&["present", "--for", "0.5"], &[], answer);
    assert_eq!((limited.code, limited.sent.last().map(|last| last.cancel)), (Some(1), Some(true)));
    assert_eq!(limited.error, "advee: present was cancelled: after one of three sentences\n");
    let cancelled = run(&["--cancel", "a-1"], &[], answer);
    assert_eq!(cancelled.out, "cancelled  30 %  after one of three sentences\n");
    assert_eq!((cancelled.code, &*cancelled.error), (Some(0), ""));
    let unknown = run(&["--cancel", "a-1"], &[], |_| vec![]);
    assert_eq!((unknown.code, unknown.error.starts_with("advee: nobody runs a-1 on ")), (Some(1), true));
}

#[test]
fn actions_under_way_are_listed() {
    let lasting = [
        status("a-1", DataAction::RUNNING, 0.5, "Good morning."),
        status("b-1", DataAction::FAILED, 0.5, "the display is off"),
        status("", DataAction::RUNNING, 0.5, "no id"),
    ];
    for arguments in [&["--list"][..], &["--follow", "--for", "2"]] {
        let run = run(arguments, &lasting, |_| vec![]);
        assert_eq!((run.code, &*run.out, run.sent.len()), (Some(0), "a-1  running    50 %  Good morning.\n", 0));
    }
    let none = run(&["--list"], &[], |_| vec![]);
    assert_eq!((none.code, &*none.out), (Some(0), "no action is under way\n"));
}
