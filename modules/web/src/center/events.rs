//! What happened in a recorded run, for its time line: marks, stops, reports and contacts.

use super::recorded::Recorded;
use super::summaries::RunSummary;
use messages::common::{CmdLog, Error};
use messages::{Channel, Hold, Message, StopReports, StopSource};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io;

/// Maximum number of events; the rest is counted.
const EVENTS_MAX: usize = 1000;
/// Maximum length of the words of an event, characters.
const WORDS_MAX: usize = 200;
/// A report that follows the last one of its kind within this time is not listed again, ns.
const AGAIN: u64 = 5_000_000_000;
/// Maximum number of kinds of reports that are compared with each other.
const KINDS_MAX: usize = 256;
/// Longest time between two measurements of the motion over which its speed counts, ns.
const GAP_MAX: u64 = 1_000_000_000;
/// Speeds beyond this are no measurement, m/s.
const SPEED_MAX: f64 = 20.0;

/// What happened in a recorded run. `GET /api/runs/RUN/events` (viewer).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunEvents {
    /// In order of time, at most 1000.
    pub events: Vec<RunEvent>,
    /// Number of events that are not listed.
    pub left_out: u32,
}

/// Event of a recorded run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunEvent {
    /// s after the begin of the run.
    pub at: f64,
    /// Kind.
    pub kind: EventKind,
    /// For people.
    pub words: String,
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// A person set a mark.
    Mark,
    /// The PAUSE line was engaged, or an operator stopped the robot.
    Stop,
    /// A module cannot do its work.
    Error,
    /// A module works with restrictions.
    Warning,
    /// The simulated robot touched something.
    Contact,
}

/// Reads the whole run.
///
/// # Errors
/// A file cannot be read.
pub fn of(run: &Recorded) -> io::Result<(RunEvents, RunSummary)> {
    let wants = |topic: &str| {
        matches!(
            Channel::from_name(topic),
            Some(
                Channel::CmCmdLog
                    | Channel::CmEventError
                    | Channel::LlEventStop
                    | Channel::LlDataHold
                    | Channel::LlDataMotion
                    | Channel::SimDataTruth
            )
        )
    };
    let mut messages = run.messages(0, wants)?;
    let mut scan = Scan::default();
    while let Some(entry) = messages.next_entry()? {
        if let Some(Ok(message)) = Message::receive(&entry.channel.topic, entry.message.data) {
            scan.take(run.timeline.position(entry.message.log_time), &message);
        }
    }
    let summary = scan.summary(run.timeline.length() as f64 / 1e9);
    Ok((scan.found, summary))
}

#[derive(Debug)]
struct Scan {
    found: RunEvents,
    stops: StopReports,
    /// True while the PAUSE line is engaged, and while an operator stops the robot.
    paused: bool,
    held: bool,
    contacts: Option<i32>,
    /// Position and measured speed of the last motion.
    motion: Option<(u64, f64)>,
    /// m.
    distance: f64,
    /// Number of events of each kind, with those that are not listed.
    counts: BTreeMap<EventKind, u32>,
    /// Position of the last report of each kind.
    reports: BTreeMap<(String, i32), u64>,
}

impl Default for Scan {
    fn default() -> Self {
        let found = RunEvents { events: Vec::new(), left_out: 0 };
        Self {
            found,
            stops: StopReports::default(),
            paused: false,
            held: false,
            contacts: None,
            motion: None,
            distance: 0.0,
            counts: BTreeMap::new(),
            reports: BTreeMap::new(),
        }
    }
}

impl Scan {
    fn take(&mut self, at: u64, message: &Message) {
        match message {
            Message::CmCmdLog(mark) if mark.action == CmdLog::MARK => self.add(at, EventKind::Mark, &mark.text),
            Message::CmEventError(error) if error.severity >= Error::WARNING => self.report(at, error),
            Message::LlEventStop(stop) => {
                let Some(stop) = self.stops.on_report(stop) else { return };
                if stop.engaged && !self.paused {
                    self.add(at, EventKind::Stop, &format!("PAUSE: {}", StopSource::in_words(&stop.source)));
                }
                self.paused = stop.engaged;
            }
            Message::LlDataHold(list) if list.is_of_motion() => {
                let is_stop = |hold: &messages::lowlevel::Hold| {
                    hold.cause() == Some(Hold::ModulePaused) && hold.subject == list.module
                };
                let held = list.holds.iter().any(is_stop);
                if held && !self.held {
                    self.add(at, EventKind::Stop, "an operator stopped the robot");
                }
                self.held = held;
            }
            Message::SimDataTruth(truth) => {
                if self.contacts.is_some_and(|before| before < truth.collisions) {
                    self.add(at, EventKind::Contact, "the robot touched something");
                }
                self.contacts = Some(truth.collisions);
            }
            Message::LlDataMotion(motion) => self.drive(at, motion.speed),
            _ => {}
        }
    }

    /// Adds what was driven since the last measurement; nothing over a gap.
    fn drive(&mut self, at: u64, speed: f64) {
        let before = self.motion.replace((at, speed));
        if let Some((begin, was)) = before
            && at.saturating_sub(begin) <= GAP_MAX
            && was.is_finite()
            && was.abs() <= SPEED_MAX
        {
            self.distance += was.abs() * (at.saturating_sub(begin) as f64 / 1e9);
        }
    }

    fn summary(&self, seconds: f64) -> RunSummary {
        let count = |kind| self.counts.get(&kind).copied().unwrap_or(0);
        RunSummary {
            seconds,
            distance: self.distance,
            contacts: self.contacts.map(|_| count(EventKind::Contact)),
            stops: count(EventKind::Stop),
            errors: count(EventKind::Error),
            warnings: count(EventKind::Warning),
        }
    }

    fn report(&mut self, at: u64, error: &Error) {
        let kind = (error.module.clone(), error.number);
        if self.reports.len() >= KINDS_MAX && !self.reports.contains_key(&kind) {
            self.reports.clear();
        }
        let before = self.reports.insert(kind, at);
        if before.is_none_or(|before| at.saturating_sub(before) > AGAIN) {
            let kind = if error.severity >= Error::ERROR { EventKind::Error } else { EventKind::Warning };
            self.add(at, kind, &format!("{}: {}", error.module, error.message));
        }
    }

    fn add(&mut self, at: u64, kind: EventKind, words: &str) {
        let count = self.counts.entry(kind).or_default();
        *count = count.saturating_add(1);
        if self.found.events.len() >= EVENTS_MAX {
            self.found.left_out = self.found.left_out.saturating_add(1);
            return;
        }
        let words = words.chars().take(WORDS_MAX).collect();
        self.found.events.push(RunEvent { at: at as f64 / 1e9, kind, words });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{DataHold, DataMotion, EventStop, Hold as Cause};
    use messages::simulation::DataTruth;

    const S: u64 = 1_000_000_000;

    #[test]
    fn each_event_is_listed_when_it_begins() {
        let mut scan = Scan::default();
        let error =
            |severity| Error { module: "m".into(), number: 1, message: "lost".into(), severity, ..Error::default() };
        let pause = |engaged| EventStop { engaged, source: "bumper2".into(), ..EventStop::default() };
        let subject = messages::MOTION_MODULE.to_owned();
        let cause = Cause { code: Hold::ModulePaused.code(), subject, ..Cause::default() };
        let held = |holds| DataHold { module: messages::MOTION_MODULE.into(), holds, ..DataHold::default() };
        let touched = |collisions| DataTruth { collisions, ..DataTruth::default() };
        let mark = CmdLog { action: CmdLog::MARK, text: "here".into(), ..CmdLog::default() };
        let said: [(u64, Message); 14] = [
            (1, touched(3).into()),
            (2, error(Error::NOTICE).into()),
            (3, error(Error::ERROR).into()),
            (4, error(Error::ERROR).into()),
            (5, pause(true).into()),
            (6, pause(true).into()),
            (7, pause(false).into()),
            (8, pause(true).into()),
            (9, held(vec![cause.clone()]).into()),
            (10, held(vec![cause]).into()),
            (11, held(vec![]).into()),
            (12, touched(4).into()),
            (13, mark.into()),
            (14, error(Error::WARNING).into()),
        ];
        for (at, message) in &said {
            scan.take(at * S, message);
        }
        let found: Vec<_> =
            scan.found.events.iter().map(|event| (event.at, event.kind, event.words.as_str())).collect();
        let wanted = [
            (3.0, EventKind::Error, "m: lost"),
            (5.0, EventKind::Stop, "PAUSE: bumper 2"),
            (8.0, EventKind::Stop, "PAUSE: bumper 2"),
            (9.0, EventKind::Stop, "an operator stopped the robot"),
            (12.0, EventKind::Contact, "the robot touched something"),
            (13.0, EventKind::Mark, "here"),
            (14.0, EventKind::Warning, "m: lost"),
        ];
        assert_eq!(found, wanted);
        let summary = scan.summary(20.0);
        let wanted = RunSummary { seconds: 20.0, distance: 0.0, contacts: Some(1), stops: 3, errors: 1, warnings: 1 };
        assert_eq!(summary, wanted);
        assert_eq!(Scan::default().summary(1.0).contacts, None, "nobody counts them");
    }

    #[test]
    fn the_distance_is_driven_either_way_and_not_over_a_gap() {
        let mut scan = Scan::default();
        let tenth = S / 10;
        for (at, speed) in [(0, 1.0), (1, -0.5), (2, f64::NAN), (3, 1e30), (4, 2.0), (40, 1.0), (41, 0.0), (42, 9.0)] {
            scan.take(at * tenth, &DataMotion { speed, ..DataMotion::default() }.into());
        }
        assert!((scan.summary(4.2).distance - 0.25).abs() < 1e-9, "{}", scan.summary(4.2).distance);
    }

    #[test]
    fn a_hostile_log_has_a_bounded_number_of_events() {
        let mut scan = Scan::default();
        for number in 0..3000 {
            let error = Error { number, severity: Error::ERROR, message: "x".repeat(1000), ..Error::default() };
            scan.take(u64::try_from(number).unwrap() * S, &error.into());
        }
        assert_eq!((scan.found.events.len(), scan.found.left_out), (EVENTS_MAX, 2000));
        assert_eq!(scan.summary(1.0).errors, 3000);
        assert!(scan.reports.len() <= KINDS_MAX && scan.found.events[0].words.len() <= WORDS_MAX);
    }
}
