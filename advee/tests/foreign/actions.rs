//! Actions of foreign modules, the presentations in five languages: the contract of docs/highlevel.md, by messages of
//! the test and by `advee action`.

use crate::alone::command;
use crate::built::{Built, Foreign};
use crate::support::{advee, can_port, listen, signal};
use lcm::live::Lcm;
use messages::highlevel::{CmdAction, DataAction, Parameter};
use messages::{Message, common};
use module::State;
use std::process::{Child, Output};
use std::time::{Duration, Instant};

/// Those built on the Python package, without further tools.
const PRESENTATIONS: [Foreign; 3] = [("python", "presentation"), ("c", "presentation"), ("cpp", "presentation")];
const IN_JAVA: Foreign = ("java", "presentation");
const IN_CSHARP: Foreign = ("csharp", "presentation");
/// Timeout, long enough for a loaded machine.
const PATIENCE: Duration = Duration::from_secs(20);
/// Three sentences, each for half a second.
const THREE: [(&str, &str); 2] = [("text", "One. Two! Three?"), ("seconds", "1.5")];
/// A text that lasts longer than any test.
const LONG: [(&str, &str); 2] = [("text", "One. Two."), ("seconds", "600")];

#[test]
fn a_presentation_is_played_to_its_end_and_known_by_its_id() {
    on_each_stage(|mut stage| {
        stage.command("a", "present", &THREE);
        stage.until("the end, three times", |stage| stage.ends("a").len() >= 3);
        let all = stage.of("a");
        let known = ["One.", "Two!", "Three?", "3 sentences in 1.5 s"];
        let place = |data: &&DataAction| known.iter().position(|message| *message == data.message);
        let places: Vec<_> = all.iter().map(place).collect();
        // On a busy machine a sentence may have no status of its own.
        assert!(places.is_sorted() && places[0] == Some(0) && places.last() == Some(&Some(3)), "{all:?}");
        assert!(all.is_sorted_by_key(|data| data.progress) && all.is_sorted_by_key(|data| data.status), "{all:?}");
        assert_eq!((all[0].status, all.last().map(|data| data.progress)), (DataAction::RUNNING, Some(1.0)));
        assert_eq!(stage.ends("a"), [DataAction::SUCCEEDED; 3]);
        // The same id is the same action, whatever else is in the command.
        stage.heard.clear();
        stage.repeat("a", "present", &LONG);
        let again = stage.of("a");
        assert!(again.iter().all(|data| data.status == DataAction::SUCCEEDED), "{again:?}");
        // So it is free for another one.
        stage.command("b", "present", &LONG);
        stage.until("the next one", |stage| !stage.of("b").is_empty());
        assert_eq!(stage.of("b")[0].status, DataAction::RUNNING);
    });
}

#[test]
fn an_action_that_lasts_is_reported_again_and_again_and_cancelled_at_any_time() {
    on_each_stage(|mut stage| {
        stage.command("a", "present", &LONG);
        stage.until("its start", |stage| !stage.of("a").is_empty());
        stage.command("a", "present", &LONG);
        stage.command("second", "present", &LONG);
        stage.until("the rejection", |stage| stage.ends("second").contains(&DataAction::REJECTED));
        assert_eq!(stage.of("second")[0].message, "a is played");
        stage.heard.clear();
        stage.until("its status", |stage| stage.of("a").len() >= 3);
        stage.cancel("a", "");
        stage.until("its end", |stage| !stage.ends("a").is_empty());
        stage.cancel("a", "");
        stage.until("the answer", |stage| stage.ends("a").len() >= 2);
        assert!(stage.ends("a").iter().all(|status| *status == DataAction::CANCELLED));
        assert_eq!(stage.of("a").last().map(|data| data.message.as_str()), Some("after 1 of 2 sentences"));
        // A cancel that comes first.
        stage.cancel("b", "present");
        stage.until("the answer", |stage| stage.ends("b").contains(&DataAction::CANCELLED));
        stage.command("b", "present", &LONG);
        stage.until("the end again", |stage| stage.ends("b").len() >= 2);
        assert_eq!(stage.of("b").len(), stage.ends("b").len(), "it never ran");
    });
}

#[test]
fn what_cannot_be_done_is_rejected_and_what_is_no_command_is_dropped() {
    on_each_stage(|mut stage| {
        let long = "v".repeat(5000);
        let bad: [(&[(&str, &str)], &str); 6] = [
            (&[], "parameter text is missing"),
            (&[("text", " ")], "the text is empty"),
            (&[("text", "One."), ("seconds", "nan")], "parameter seconds is no number from 0.1 to 600"),
            (&[("text", long.as_str())], "the value of a parameter has more than 4096 bytes"),
            (&[("text", "One."), ("text", "Two.")], "a parameter has no valid name, or that of another one"),
            (&[("text", "One."); 33], "33 parameters are more than 32"),
        ];
        for (number, (parameters, why)) in bad.into_iter().enumerate() {
            let id = format!("bad-{number}");
            stage.command(&id, "present", parameters);
            stage.until(why, |stage| !stage.of(&id).is_empty());
            let DataAction { status, message, .. } = stage.of(&id)[0];
            assert_eq!((*status, message.as_str()), (DataAction::REJECTED, why));
        }
        // As many as are remembered, and one that is forgotten by then.
        for number in 0..70 {
            let id = format!("bad-more-{number}");
            stage.command(&id, "present", &[]);
            stage.until("the rejection", |stage| !stage.of(&id).is_empty());
        }
        stage.heard.clear();
        stage.command("bad-more-69", "present", &LONG);
        stage.command("bad-0", "present", &[("text", "é")]);
        stage.until("the forgotten one, begun anew", |stage| !stage.of("bad-0").is_empty());
        assert_eq!(stage.of("bad-0")[0].status, DataAction::RUNNING);
        assert!(stage.of("bad-more-69").iter().all(|data| data.status == DataAction::REJECTED));
        stage.cancel("bad-0", "");
        stage.until("its end", |stage| !stage.ends("bad-0").is_empty());
        // A message is cut between two characters.
        stage.command("bad-long", "present", &[("text", "é".repeat(400).as_str()), ("seconds", "600")]);
        stage.until("its start", |stage| !stage.of("bad-long").is_empty());
        assert_eq!(stage.of("bad-long")[0].message, "é".repeat(256));
        stage.cancel("bad-long", "");
        stage.until("its end", |stage| !stage.ends("bad-long").is_empty());
        for id in ["", "a b", "\u{e4}", &"i".repeat(129), &"i".repeat(60_000)] {
            stage.command(id, "present", &LONG);
        }
        stage.command("other", "dance", &LONG);
        stage.bus.publish("HL_CMD_ACTION", b"nonsense").expect("the bus takes it");
        stage.command("good", "present", &LONG);
        stage.until("the last one", |stage| !stage.of("good").is_empty());
        assert!(stage.heard.iter().all(|data| data.id == "good" || data.id.starts_with("bad-")), "{:?}", stage.heard);
    });
}

#[test]
fn a_module_that_leaves_run_fails_its_actions_and_resumes_none() {
    on_each_stage(|mut stage| {
        stage.command("a", "present", &LONG);
        stage.until("its start", |stage| !stage.of("a").is_empty());
        stage.state(State::Pause);
        stage.until("its end", |stage| stage.ends("a").contains(&DataAction::FAILED));
        assert_eq!(stage.of("a").last().map(|data| data.message.as_str()), Some("presentation is in PAUSE"));
        stage.command("b", "present", &LONG);
        stage.until("the rejection", |stage| stage.ends("b").contains(&DataAction::REJECTED));
        stage.state(State::Run);
        stage.command("c", "present", &LONG);
        stage.until("the next one", |stage| !stage.of("c").is_empty());
        assert_eq!(stage.of("a").last().map(|data| data.status), Some(DataAction::FAILED), "it is not resumed");
        assert_eq!(stage.of("b").len(), stage.ends("b").len(), "nor is the other one begun");
        stage.heard.clear();
        signal(stage.module.id() as i32, "TERM");
        stage.until("its end", |stage| stage.ends("c").contains(&DataAction::FAILED));
        assert!(stage.module.wait().expect("it is our child").success());
    });
}

#[test]
fn advee_action_commands_a_foreign_module() {
    on_each_stage(|mut stage| {
        let output = stage.advee(&["present", "text=One. Two.", "seconds=0.5"]);
        assert!(output.status.success(), "{}", error(&output));
        let shown = String::from_utf8_lossy(&output.stdout);
        let lines: Vec<&str> = shown.lines().collect();
        let [first, .., last] = &lines[..] else { panic!("{shown}") };
        assert!(first.starts_with("running ") && first.ends_with("One."), "{shown}");
        assert_eq!(*last, "succeeded 100 %  2 sentences in 0.5 s");
        let output = stage.advee(&["present"]);
        assert_eq!(error(&output), "advee: present was rejected: parameter text is missing\n");
        let output = stage.advee(&["present", "text=One. Two.", "seconds=600", "--for", "0.5"]);
        assert_eq!(error(&output), "advee: present was cancelled: after 1 of 2 sentences\n");

        stage.command("long", "present", &LONG);
        stage.until("its start", |stage| !stage.of("long").is_empty());
        let list = stage.advee(&["--list"]);
        let list = String::from_utf8_lossy(&list.stdout);
        assert!(list.starts_with("long  running ") && list.ends_with("One.\n"), "{list}");
        let output = stage.advee(&["--cancel", "long"]);
        assert!(output.status.success(), "{}", error(&output));

        // Stopped while it plays.
        let pid = stage.module.id() as i32;
        stage.command("hung", "present", &LONG);
        stage.until("its start", |stage| !stage.of("hung").is_empty());
        signal(pid, "STOP");
        let output = stage.advee(&["present", "--id", "hung"]);
        signal(pid, "CONT");
        assert!(error(&output).starts_with("advee: nobody offers present on udpm://"), "{}", error(&output));
        // It was cancelled then.
        stage.until("its end", |stage| stage.ends("hung").contains(&DataAction::CANCELLED));
    });
}

fn error(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs a test with each of the modules that this machine can build, unless it is skipped.
fn on_each_stage(test: impl Fn(Stage)) {
    let wheel = Built::on_the_wheel().into_iter().flat_map(|built| PRESENTATIONS.map(|module| (built, module)));
    let java = Built::in_java().map(|built| (built, IN_JAVA));
    let csharp = Built::in_csharp().map(|built| (built, IN_CSHARP));
    for (built, module) in wheel.chain(java).chain(csharp) {
        test(Stage::start(built, module));
    }
}

/// The module, and what it says.
struct Stage {
    module: Child,
    url: String,
    bus: Lcm,
    heard: Vec<DataAction>,
    /// State of the module.
    state: Option<State>,
}

impl Stage {
    /// Starts the module and waits until it is in RUN.
    fn start(built: &Built, module: Foreign) -> Self {
        let url = format!("udpm://239.255.76.67:{}?ttl=0", can_port());
        let bus = listen(&url);
        let module = command(built, module).env("LCM_DEFAULT_URL", &url).spawn().expect("it was built");
        let mut stage = Self { module, url, bus, heard: Vec::new(), state: None };
        stage.until("RUN", |stage| stage.state == Some(State::Run));
        stage
    }

    /// Runs `advee action` on the bus of the module.
    fn advee(&self, args: &[&str]) -> Output {
        let run_dir = std::env::temp_dir().join(format!("advee-actions-{}", std::process::id()));
        advee(&self.url, &run_dir).arg("action").args(args).output().expect("the executable is built")
    }

    fn command(&mut self, id: &str, name: &str, parameters: &[(&str, &str)]) {
        let parameter = |(name, value): &(&str, &str)| Parameter { name: (*name).into(), value: (*value).into() };
        let parameters = parameters.iter().map(parameter).collect();
        self.publish(CmdAction { timestamp: 0, id: id.into(), name: name.into(), parameters, cancel: false });
    }

    fn cancel(&mut self, id: &str, name: &str) {
        self.publish(CmdAction { id: id.into(), name: name.into(), cancel: true, ..Default::default() });
    }

    /// Commands the state of the module, and waits for it.
    fn state(&mut self, state: State) {
        let (module, source) = ("presentation".into(), "test".into());
        self.publish(common::CmdState { timestamp: 0, module, state: state as i8, manual: true, source });
        self.until("the state", |stage| stage.state == Some(state));
    }

    fn publish(&mut self, message: impl Into<Message>) {
        let (message, mut bytes) = (message.into(), Vec::new());
        message.encode(&mut bytes).expect("encodable");
        self.bus.publish(message.channel().name(), &bytes).expect("the bus takes it");
    }

    /// Receives until `condition` is true.
    #[track_caller]
    fn until(&mut self, what: &str, condition: impl Fn(&Self) -> bool) {
        let met = self.receive(PATIENCE, condition);
        assert!(met, "not within {PATIENCE:?}: {what}; heard: {:?}", self.heard);
    }

    /// Receives until `condition` is true, or the time is over.
    fn receive(&mut self, time: Duration, condition: impl Fn(&Self) -> bool) -> bool {
        let end = Instant::now() + time;
        while !condition(self) {
            if Instant::now() >= end {
                return false;
            }
            self.bus.wait(Duration::from_millis(20)).expect("the bus can be waited for");
            while let Some(received) = self.bus.recv().expect("the bus can be read") {
                match Message::receive(received.channel, received.payload) {
                    Some(Ok(Message::HlDataAction(data))) => self.heard.push(data),
                    Some(Ok(Message::CmDataState(state))) => self.state = State::from_value(state.state),
                    _ => {}
                }
            }
        }
        true
    }

    /// Repeats a command until it is answered, as commanders do.
    #[track_caller]
    fn repeat(&mut self, id: &str, name: &str, parameters: &[(&str, &str)]) {
        let answered = (0..PATIENCE.as_secs() * 2).any(|_| {
            self.command(id, name, parameters);
            self.receive(Duration::from_millis(500), |stage| !stage.of(id).is_empty())
        });
        assert!(answered, "not within {PATIENCE:?}: a status of {id}; heard: {:?}", self.heard);
    }

    /// Statuses of an action.
    fn of(&self, id: &str) -> Vec<&DataAction> {
        self.heard.iter().filter(|data| data.id == id).collect()
    }

    /// Its ends, which are repeated.
    fn ends(&self, id: &str) -> Vec<i8> {
        let statuses = self.heard.iter().filter(|data| data.id == id).map(|data| data.status);
        statuses.filter(|status| *status >= DataAction::SUCCEEDED).collect()
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let _ = self.module.kill();
        let _ = self.module.wait();
    }
}
