//! Modules of the robot in other languages: `examples/modules`, built on the official LCM with the types of
//! `messages/*.lcm`, against our context.

use crate::official::{self, Language, Official, root};
use crate::{common, types};
use lcm::codec::Type;
use lcm::live::Lcm;
use messages::common::{CmdState, DataState, Error};
use messages::lowlevel::{DataSrfs, EventStop, Range};
use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Long enough for a loaded machine; on a healthy one nothing waits that long.
const PATIENCE: Duration = Duration::from_secs(20);
/// The sonars' period, as far as the module can tell.
const PERIOD: Duration = Duration::from_millis(100);

/// The number of a forbidden command in docs/faults.md, and the beeper's own.
const FORBIDDEN: i32 = 0x0001;
const SONARS_SILENT: i32 = 0x8001;

#[test]
fn modules_in_python_and_cpp_announce_obey_and_report() {
    for version in official::VERSIONS {
        let Some(official) = Official::find(version, "modules") else { continue };
        for &language in Language::of(version).iter().filter(|language| **language != Language::C) {
            println!("beeper in {language} {version}");
            let mut beeper = Beeper::start(&official, language);
            beeper.comes_up_and_beeps();
            beeper.obeys();
            beeper.is_silent_while_the_pause_line_holds();
            beeper.reports_that_the_sonars_are_lost_and_found();
            beeper.ends();
        }
    }
}

/// What a module says.
#[derive(Debug, PartialEq)]
enum Said {
    State(i8),
    Report { number: i32, severity: i8, message: String },
}

/// The module's process and the robot around it.
struct Beeper {
    process: Child,
    lcm: Lcm,
    beeps: mpsc::Receiver<String>,
    /// Whether there are any.
    sonars: bool,
}

impl Beeper {
    fn start(official: &Official, language: Language) -> Self {
        let folder = official.folder(language, "beeper");
        for file in types::robot_files() {
            official.generate(language, &file, &folder).unwrap();
        }
        let source = root().join("examples/modules").join(format!("beeper.{}", language.extension()));
        let program = official.program(language, &folder, source).unwrap();
        let url = common::url();
        let mut lcm = Lcm::new(&url.clone().into()).unwrap();
        lcm.subscribe("CM_DATA_STATE").unwrap();
        lcm.subscribe("CM_EVENT_ERROR").unwrap();
        let mut command = program.command();
        let mut process = command.env("LCM_DEFAULT_URL", url.to_string()).stdout(Stdio::piped()).spawn().unwrap();
        let (sender, beeps) = mpsc::channel();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        thread::spawn(move || lines.for_each(|line| drop(sender.send(line))));
        Self { process, lcm, beeps, sonars: true }
    }

    fn comes_up_and_beeps(&mut self) {
        self.expect(Said::State(DataState::INIT));
        self.expect(Said::State(DataState::RUN));
        self.expect_beep();
        self.expect(Said::State(DataState::RUN)); // again, though nothing has changed
    }

    fn obeys(&mut self) {
        self.command("another", DataState::STOP, true);
        self.command("beeper", DataState::PAUSE, false);
        self.expect_change(DataState::RUN, DataState::PAUSE);
        self.command("beeper", DataState::RUN, false);
        self.expect_change(DataState::PAUSE, DataState::RUN);
        self.command("*", DataState::STOP, false);
        self.expect_report(FORBIDDEN, Error::WARNING, "command STOP from interop refused in RUN");
        self.command("*", DataState::STOP, true);
        self.expect_change(DataState::RUN, DataState::STOP);
        self.command("beeper", DataState::RUN, false);
        self.expect_report(FORBIDDEN, Error::WARNING, "command RUN from interop refused in STOP");
        self.command("beeper", DataState::RUN, true);
        self.expect_change(DataState::STOP, DataState::RUN);
    }

    fn is_silent_while_the_pause_line_holds(&mut self) {
        self.publish("LL_EVENT_STOP", &EventStop { timestamp: 0, engaged: true, source: "button".into() });
        // It has heard of the line when it obeys what came behind.
        self.command("beeper", DataState::PAUSE, false);
        self.expect_change(DataState::RUN, DataState::PAUSE);
        self.command("beeper", DataState::RUN, false);
        self.expect_change(DataState::PAUSE, DataState::RUN);
        self.beeps.try_iter().for_each(drop);
        self.expect(Said::State(DataState::RUN));
        assert_eq!(self.beeps.try_iter().count(), 0, "beeps within a second");
        self.publish("LL_EVENT_STOP", &EventStop::default());
        self.expect_beep();
    }

    fn reports_that_the_sonars_are_lost_and_found(&mut self) {
        self.sonars = false;
        self.expect_report(SONARS_SILENT, Error::ERROR, "no LL_DATA_SRFS: the sonars are silent");
        self.expect(Said::State(DataState::ERROR));
        self.sonars = true;
        self.expect_report(SONARS_SILENT, Error::NOTICE, "the sonars are heard again");
        self.expect_change(DataState::ERROR, DataState::RUN);
    }

    fn ends(mut self) {
        self.command("*", DataState::TERMINATE, false);
        self.expect_change(DataState::RUN, DataState::TERMINATE);
        let status = self.process.wait().unwrap();
        assert!(status.success(), "{status}");
    }

    fn command(&mut self, module: &str, state: i8, manual: bool) {
        let source = "interop".into();
        self.publish("CM_CMD_STATE", &CmdState { timestamp: 0, module: module.into(), state, manual, source });
    }

    fn publish<T: Type>(&mut self, channel: &str, message: &T) {
        let mut bytes = Vec::new();
        message.encode(&mut bytes).unwrap();
        self.lcm.publish(channel, &bytes).unwrap();
    }

    /// What the module says next; meanwhile the sonars see something at 0.2 m, if they are there.
    fn next(&mut self) -> Said {
        let end = Instant::now() + PATIENCE;
        let mut due = Instant::now();
        while Instant::now() < end {
            if let Some(received) = self.lcm.recv().unwrap() {
                if received.channel == "CM_DATA_STATE" {
                    let state = DataState::decode(received.payload).unwrap();
                    assert_eq!(state.module, "beeper");
                    return Said::State(state.state);
                }
                let Error { module, number, severity, message, .. } = Error::decode(received.payload).unwrap();
                assert_eq!(module, "beeper");
                return Said::Report { number, severity, message };
            }
            if self.sonars && due <= Instant::now() {
                let srfs = [(false, f64::NAN), (true, 0.2), (true, 3.0)];
                let srfs = srfs.map(|(valid, distance)| Range { distance, valid, ..Range::default() });
                self.publish("LL_DATA_SRFS", &DataSrfs { timestamp: 0, srfs: srfs.into() });
                due = Instant::now() + PERIOD;
            }
            self.lcm.wait(PERIOD).unwrap();
        }
        panic!("the module says nothing within {PATIENCE:?}");
    }

    fn expect(&mut self, wanted: Said) {
        assert_eq!(self.next(), wanted);
    }

    /// The state `to`; before it may come the announcement each second of `from`.
    fn expect_change(&mut self, from: i8, to: i8) {
        loop {
            match self.next() {
                Said::State(state) if state == from => {}
                said => return assert_eq!(said, Said::State(to)),
            }
        }
    }

    /// A report; before it may come the announcement each second.
    fn expect_report(&mut self, number: i32, severity: i8, message: &str) {
        let said = std::iter::repeat_with(|| self.next()).find(|said| matches!(said, Said::Report { .. }));
        assert_eq!(said, Some(Said::Report { number, severity, message: message.into() }));
    }

    /// It beeps within the next announcements.
    fn expect_beep(&mut self) {
        let beep = loop {
            match self.beeps.try_recv() {
                Ok(line) => break line,
                Err(error) => assert_eq!(error, mpsc::TryRecvError::Empty, "the module has ended"),
            }
            self.expect(Said::State(DataState::RUN));
        };
        assert_eq!(beep, "\u{7}beep 0.20 m");
    }
}

impl Drop for Beeper {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
