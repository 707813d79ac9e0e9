//! The PAUSE line as reported by `LL_EVENT_STOP`: engaged while any source reports it engaged, and latched until a
//! deliberate act.
//!
//! The power controller reports for the sources on its line (bumpers, floor sensors, the button, or without a name);
//! other senders report for themselves, whatever name they give. None of them releases what another one engaged: a
//! source is a name of a sender, as far as the host tells senders apart. A source other than the power controller that
//! engaged the line and fell silent stays engaged until its sender reports that it is open, or until a person overrules
//! it. The same holds for a power controller that the robot is not configured with.
//!
//! A lidar whose own fields stop the robot by the configuration is such a source as the power controller:
//! `driver_lidar` reports for it, the robot does not move without its report, and nobody overrules it. So is an input
//! of `[stop]`: `driver_io` reports a signal, this driver reads an input of a drive by itself. An input that was known
//! and is not any more counts as open, and so is latched.

use base::{Duration, Instant, earliest};
use messages::{Hold, StopSource, lowlevel};
use module::admission::{Origin, Process};

/// `LL_EVENT_STOP` is sent every 500 ms; after this time without it the state of its source is unknown.
pub(super) const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// `driver_lidar` reports ten times a second whether the fields of a lidar are free, `driver_io` whether a signal is
/// closed; after this time without it that is unknown. The same holds for an input that this driver reads.
pub(super) const FIELDS_TIMEOUT: Duration = Duration::from_millis(500);
/// Maximum number of sources beside the power controller and the lidars that are distinguished; a further one replaces
/// the last.
const OTHERS_MAX: usize = 8;

/// Reason why the PAUSE line stops the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paused {
    /// The state of the line is unknown.
    Unknown,
    /// The power controller reports this source.
    Engaged(StopSource),
    /// The state of a lidar's fields is not known: its place among those of the configuration.
    FieldsUnknown(usize),
    /// A field of a lidar is infringed, or not known, as its driver reports.
    Fields(usize),
    /// The state of an input is not known: its place among those of the configuration.
    InputUnknown(usize),
    /// An input is open.
    Input(usize),
    /// Another sender: its place among them.
    Other(usize),
    /// It was engaged, and no operator has released the robot since.
    Latched,
}

/// Last report of the power controller.
#[derive(Clone, Debug, PartialEq)]
enum Controller {
    /// Nothing has been received yet.
    Unknown,
    Open,
    /// Source, and its name as reported.
    Engaged(StopSource, String),
}

/// A source that must be known for the robot to move: a lidar whose own fields stop it, or an input.
#[derive(Clone, Debug, PartialEq)]
struct Watched {
    /// Its name as a source: `lidar.front`, `io.estop`, `drive.left.3`.
    name: String,
    /// This driver reads it: no message reports its state.
    own: bool,
    /// Last report; `None`: there was none, or it is too old.
    engaged: Option<bool>,
    /// Instant from which on it is too old.
    until: Instant,
}

impl Watched {
    fn new(name: &str, own: bool) -> Self {
        Self { name: name.into(), own, engaged: None, until: Instant::ZERO }
    }

    fn take(&mut self, at: Instant, engaged: bool) {
        (self.engaged, self.until) = (Some(engaged), at + FIELDS_TIMEOUT);
    }

    /// True if it stops the robot, false if its state is not known; `None` if it does not object.
    fn objects(&self, now: Instant) -> Option<bool> {
        match self.engaged.filter(|_| now < self.until) {
            Some(false) => None,
            Some(true) => Some(true),
            None => Some(false),
        }
    }
}

/// An input that stops the robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct InputName {
    /// As a source of PAUSE.
    pub name: String,
    /// This driver reads it by itself; otherwise `driver_io` reports it.
    pub own: bool,
}

/// Another sender that engages the line.
#[derive(Clone, Debug, PartialEq)]
struct Other {
    name: String,
    /// Its process, where it is known.
    process: Option<Process>,
    /// Time of its last report.
    at: Instant,
    /// It stands for several, so a report that one of them is open does not open it; only a person overrules it.
    shared: bool,
}

impl Other {
    fn is_of(&self, from: Origin) -> bool {
        self.process == from.process
    }
}

/// State of the line.
#[derive(Debug)]
pub(super) struct PauseLine {
    controller: Controller,
    /// Time of its last report.
    reported: Instant,
    /// Instant from which on the controller's report is too old; absent without a controller.
    until: Option<Instant>,
    fields: Vec<Watched>,
    inputs: Vec<Watched>,
    others: Vec<Other>,
    latched: bool,
}

impl PauseLine {
    /// `has_controller`: a power controller reports the line, and the robot does not move without its report; `fields`:
    /// lidars whose own fields stop it, likewise, by their names as sources; `inputs`: those that stop it, likewise.
    pub(super) fn new(has_controller: bool, fields: &[String], inputs: &[InputName]) -> Self {
        let controller = if has_controller { Controller::Unknown } else { Controller::Open };
        Self {
            controller,
            reported: Instant::ZERO,
            until: has_controller.then_some(Instant::ZERO + PAUSE_TIMEOUT),
            fields: fields.iter().map(|name| Watched::new(name, false)).collect(),
            inputs: inputs.iter().map(|input| Watched::new(&input.name, input.own)).collect(),
            others: vec![],
            latched: false,
        }
    }

    /// Processes a report, received at `at` from that sender. What is not from the power controller is not of its line,
    /// even under the name of one of its sources.
    pub(super) fn on_stop(&mut self, at: Instant, from: Origin, stop: &lowlevel::EventStop) {
        self.latched |= stop.engaged;
        if from.due && self.on_watched(at, from, stop) {
            return;
        }
        if !StopSource::is_of_line(&stop.source) || !from.due {
            return self.on_other(at, from, stop);
        }
        self.forget_early(from, StopSource::is_of_line);
        let source = StopSource::from_name(&stop.source);
        self.controller =
            if stop.engaged { Controller::Engaged(source, stop.source.clone()) } else { Controller::Open };
        self.reported = at;
        if let Some(until) = &mut self.until {
            *until = at + PAUSE_TIMEOUT;
        }
    }

    /// Processes a report of the driver of the lidars, or of the signals; false if it is another report, or of a source
    /// that does not stop this robot.
    fn on_watched(&mut self, at: Instant, from: Origin, stop: &lowlevel::EventStop) -> bool {
        self.expire(at);
        let mut watched = self.fields.iter_mut().chain(&mut self.inputs);
        let Some(watched) = watched.find(|watched| !watched.own && watched.name == stop.source) else { return false };
        watched.take(at, stop.engaged);
        self.forget_early(from, |name| name == stop.source);
        true
    }

    /// An input that this driver reads, by its place, was read at `at`.
    pub(super) fn on_input(&mut self, at: Instant, place: usize, open: bool) {
        self.expire(at);
        if let Some(input) = self.inputs.get_mut(place) {
            self.latched |= open;
            input.take(at, open);
        }
    }

    /// Latches PAUSE for inputs that were known and are not any more; also before each report, which would hide a gap
    /// in which this process was not served.
    pub(super) fn expire(&mut self, now: Instant) {
        for input in self.inputs.iter_mut().filter(|input| input.until <= now) {
            self.latched |= input.engaged.take().is_some();
        }
    }

    /// Forgets what a module reported before the watchdog listed its process.
    fn forget_early(&mut self, from: Origin, is_its_own: impl Fn(&str) -> bool) {
        self.others.retain(|other| other.process.is_none() || !other.is_of(from) || !is_its_own(&other.name));
    }

    fn on_other(&mut self, at: Instant, from: Origin, stop: &lowlevel::EventStop) {
        let same = |other: &Other| other.name == stop.source && other.is_of(from);
        let shared = self.others.iter().any(|other| same(other) && other.shared);
        if stop.engaged || !shared {
            self.others.retain(|other| !same(other));
        }
        if stop.engaged {
            let full = self.others.len() >= OTHERS_MAX;
            self.others.truncate(OTHERS_MAX - 1);
            let (name, process) = (stop.source.clone(), from.process);
            self.others.push(Other { name, process, at, shared: shared || full });
        }
    }

    /// All reasons at `now`, main one first.
    pub(super) fn reasons(&self, now: Instant) -> impl Iterator<Item = Paused> + Clone + '_ {
        let controller = match &self.controller {
            _ if self.until.is_some_and(|until| until <= now) => Some(Paused::Unknown),
            Controller::Unknown => Some(Paused::Unknown),
            Controller::Engaged(source, _) => Some(Paused::Engaged(*source)),
            Controller::Open => None,
        };
        let field = move |(place, fields): (usize, &Watched)| {
            fields.objects(now).map(|known| if known { Paused::Fields(place) } else { Paused::FieldsUnknown(place) })
        };
        let input = move |(place, input): (usize, &Watched)| {
            input.objects(now).map(|known| if known { Paused::Input(place) } else { Paused::InputUnknown(place) })
        };
        let fields = self.fields.iter().enumerate().filter_map(field);
        let inputs = self.inputs.iter().enumerate().filter_map(input);
        let others = (0..self.others.len()).map(Paused::Other);
        let engaged = controller.into_iter().chain(inputs).chain(fields).chain(others);
        let latched = self.latched && engaged.clone().next().is_none();
        engaged.chain(latched.then_some(Paused::Latched))
    }

    /// Cause in `LL_DATA_HOLD` with its subject.
    pub(super) fn hold(&self, paused: Paused) -> (Hold, &str) {
        match (paused, &self.controller) {
            (Paused::Unknown, _) => (Hold::PauseUnknown, ""),
            (Paused::Latched, _) => (Hold::PauseLatched, ""),
            (Paused::Engaged(source), Controller::Engaged(_, name)) => (source.hold(), name),
            (Paused::Engaged(source), _) => (source.hold(), source.name()),
            (Paused::FieldsUnknown(place), _) => (Hold::PauseFieldUnknown, self.lidar(place)),
            (Paused::Fields(place), _) => (Hold::PauseField, self.lidar(place)),
            (Paused::InputUnknown(place), _) => (Hold::PauseInputUnknown, self.input(place)),
            (Paused::Input(place), _) => (Hold::PauseInput, self.input(place)),
            (Paused::Other(place), _) => {
                (Hold::PauseOther, self.others.get(place).map_or("", |other| other.name.as_str()))
            }
        }
    }

    fn lidar(&self, place: usize) -> &str {
        self.fields.get(place).map_or("", |fields| fields.name.as_str())
    }

    fn input(&self, place: usize) -> &str {
        self.inputs.get(place).map_or("", |input| input.name.as_str())
    }

    /// True while any source is known to engage the line, or an input is not known.
    pub(super) fn is_engaged(&self) -> bool {
        matches!(self.controller, Controller::Engaged(..))
            || self.fields.iter().any(|fields| fields.engaged == Some(true))
            || self.inputs.iter().any(|input| input.engaged != Some(false))
            || !self.others.is_empty()
    }

    /// True while the power controller reports that its line is engaged: the line cuts the motors' feed. Other sources
    /// cut nothing.
    pub(super) fn cuts_feed(&self) -> bool {
        self.until.is_some() && matches!(self.controller, Controller::Engaged(..))
    }

    /// True from the first engagement to the next release by an operator.
    pub(super) fn is_latched(&self) -> bool {
        self.latched
    }

    /// An operator releases the robot by a deliberate act; no effect while the line is engaged.
    pub(super) fn release(&mut self) {
        self.latched &= self.is_engaged();
    }

    /// A person overrules senders that engaged the line and have been silent since; never the robot's power controller,
    /// nor its lidars.
    pub(super) fn overrule(&mut self, now: Instant) {
        if self.until.is_none() && now.since(self.reported) >= PAUSE_TIMEOUT {
            self.controller = Controller::Open;
        }
        self.others.retain(|other| now.since(other.at) < PAUSE_TIMEOUT);
    }

    /// Next deadline after `now`.
    pub(super) fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        let watched = self.fields.iter().chain(&self.inputs).map(|watched| watched.until);
        let fields = watched.filter(|until| now < *until).min();
        earliest([self.until.filter(|until| now < *until), fields])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn stop(engaged: bool, source: &str) -> lowlevel::EventStop {
        lowlevel::EventStop { timestamp: 0, engaged, source: source.into() }
    }

    /// A sender by its process; `due`: the power controller, or nobody is.
    fn of(due: bool, pid: u32) -> Origin {
        Origin { due, process: Some(Process { pid, uid: 1000 }) }
    }

    fn holds(line: &PauseLine, now: Instant) -> Vec<(Hold, &str)> {
        line.reasons(now).map(|paused| line.hold(paused)).collect()
    }

    #[test]
    fn a_source_is_not_released_by_another_one() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), Origin::DUE, &stop(true, "a rope"));
        line.on_stop(at(10), Origin::DUE, &stop(true, "bumper2"));
        assert_eq!(holds(&line, at(20)), [(Hold::PauseBumper, "bumper2"), (Hold::PauseOther, "a rope")]);
        line.on_stop(at(500), Origin::DUE, &stop(false, ""));
        assert_eq!(holds(&line, at(510)), [(Hold::PauseOther, "a rope")], "the controller's next report");
        line.on_stop(at(600), Origin::DUE, &stop(false, "another rope"));
        assert_eq!(holds(&line, at(610)), [(Hold::PauseOther, "a rope")]);
        line.on_stop(at(700), Origin::DUE, &stop(false, "a rope"));
        assert_eq!(holds(&line, at(710)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn pause_in_the_power_controllers_name_is_not_undone_by_the_power_controller() {
        for name in ["", "button", "bumper3", "sd1_rear"] {
            let mut line = PauseLine::new(true, &[], &[]);
            line.on_stop(at(0), of(true, 7), &stop(false, ""));
            line.on_stop(at(100), of(false, 300), &stop(true, name));
            assert!(!line.cuts_feed(), "only the line itself does");
            let others = [(Hold::PauseOther, name)];
            for ms in (500..10_000).step_by(500) {
                line.on_stop(at(ms), of(true, 7), &stop(false, ""));
                assert_eq!(holds(&line, at(ms)), others, "{ms} ms");
            }
            // Another process, a sender that is not known, and a person while it reports.
            line.on_stop(at(10_000), of(false, 301), &stop(false, name));
            line.on_stop(at(10_000), Origin { due: false, process: None }, &stop(false, name));
            line.on_stop(at(10_000), of(false, 300), &stop(true, name));
            line.overrule(at(10_100));
            assert_eq!(holds(&line, at(10_100)), others);
            line.on_stop(at(10_200), of(false, 300), &stop(false, name));
            assert_eq!(holds(&line, at(10_200)), [(Hold::PauseLatched, "")]);
        }
    }

    #[test]
    fn a_sender_that_fell_silent_is_overruled_by_a_person_whatever_its_name() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), of(false, 300), &stop(true, "button"));
        line.on_stop(at(1000), of(true, 7), &stop(false, ""));
        line.overrule(at(1199));
        assert_eq!(holds(&line, at(1199)), [(Hold::PauseOther, "button")]);
        line.overrule(at(1200));
        assert_eq!(holds(&line, at(1200)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_name_of_its_own_is_of_each_sender_too() {
        let mut line = PauseLine::new(false, &[], &[]);
        line.on_stop(at(0), of(true, 300), &stop(true, "crane"));
        line.on_stop(at(10), of(true, 301), &stop(true, "crane"));
        line.on_stop(at(20), of(true, 301), &stop(false, "crane"));
        assert_eq!(holds(&line, at(30)), [(Hold::PauseOther, "crane")]);
        line.on_stop(at(40), of(true, 300), &stop(false, "crane"));
        assert_eq!(holds(&line, at(50)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_stranger_does_not_stand_in_for_a_silent_power_controller() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), of(true, 7), &stop(false, ""));
        for ms in (100..2000).step_by(100) {
            line.on_stop(at(ms), of(false, 300), &stop(ms % 200 == 0, "button"));
        }
        assert_eq!(line.reasons(at(1300)).next(), Some(Paused::Unknown));
    }

    #[test]
    fn what_the_power_controller_reported_before_it_was_listed_is_its_own() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), of(false, 7), &stop(true, "bumper2"));
        assert_eq!(holds(&line, at(0)), [(Hold::PauseUnknown, ""), (Hold::PauseOther, "bumper2")]);
        line.on_stop(at(500), of(true, 7), &stop(true, "bumper2"));
        assert_eq!(holds(&line, at(500)), [(Hold::PauseBumper, "bumper2")]);
        line.on_stop(at(1000), of(true, 7), &stop(false, ""));
        assert_eq!(holds(&line, at(1000)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_person_does_not_overrule_the_robots_power_controller() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), Origin::DUE, &stop(true, "button"));
        line.overrule(at(1100));
        assert_eq!(holds(&line, at(1100)), [(Hold::PauseButton, "button")]);
        line.overrule(at(5000));
        assert_eq!(holds(&line, at(5000)), [(Hold::PauseUnknown, "")]);
    }

    #[test]
    fn reports_of_others_do_not_stand_in_for_the_power_controller() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(100), Origin::DUE, &stop(false, ""));
        for ms in (200..2000).step_by(100) {
            line.on_stop(at(ms), Origin::DUE, &stop(false, "a rope"));
        }
        assert_eq!(holds(&line, at(1299)), []);
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseUnknown, "")]);
        assert_eq!(line.poll_timeout(at(100)), Some(at(1300)));
    }

    #[test]
    fn the_line_stays_latched_until_an_operator_acts_after_it_is_open() {
        let mut line = PauseLine::new(false, &[], &[]);
        line.on_stop(at(0), Origin::DUE, &stop(true, "button"));
        line.release();
        line.on_stop(at(10), Origin::DUE, &stop(false, ""));
        assert_eq!(holds(&line, at(3_600_000)), [(Hold::PauseLatched, "")]);
        line.release();
        assert_eq!(holds(&line, at(3_600_000)), []);
    }

    fn with_fields() -> PauseLine {
        PauseLine::new(false, &["lidar.front".into(), "lidar.rear".into()], &[])
    }

    #[test]
    fn the_fields_of_each_lidar_must_be_known_and_free() {
        let mut line = with_fields();
        let (front, rear) = ((Hold::PauseFieldUnknown, "lidar.front"), (Hold::PauseFieldUnknown, "lidar.rear"));
        assert_eq!(holds(&line, at(0)), [front, rear], "nothing was received yet");
        line.on_stop(at(0), Origin::DUE, &stop(false, "lidar.front"));
        line.on_stop(at(100), Origin::DUE, &stop(false, "lidar.rear"));
        assert_eq!((holds(&line, at(499)), line.poll_timeout(at(100))), (vec![], Some(at(500))));
        assert_eq!(holds(&line, at(500)), [front], "silence");
        assert_eq!(holds(&line, at(600)), [front, rear]);
        line.on_stop(at(700), Origin::DUE, &stop(false, "lidar.front"));
        line.on_stop(at(700), Origin::DUE, &stop(true, "lidar.rear"));
        assert_eq!(holds(&line, at(700)), [(Hold::PauseField, "lidar.rear")]);
        assert!(!line.cuts_feed(), "only the line itself does");
    }

    #[test]
    fn an_infringed_field_stays_latched_until_an_operator_acts_after_it_is_free() {
        let mut line = with_fields();
        let all = |line: &mut PauseLine, ms, front| {
            line.on_stop(at(ms), of(true, 7), &stop(front, "lidar.front"));
            line.on_stop(at(ms), of(true, 7), &stop(false, "lidar.rear"));
        };
        all(&mut line, 0, true);
        line.release();
        line.overrule(at(5000));
        assert_eq!(holds(&line, at(5000)).len(), 2, "it is silent, and nobody overrules that");
        all(&mut line, 5000, false);
        assert_eq!(holds(&line, at(5100)), [(Hold::PauseLatched, "")]);
        line.release();
        assert_eq!(holds(&line, at(5100)), []);
    }

    #[test]
    fn a_stranger_frees_no_field_and_what_it_engages_is_its_own() {
        let mut line = with_fields();
        for ms in (0..2000).step_by(100) {
            line.on_stop(at(ms), of(true, 7), &stop(true, "lidar.front"));
            line.on_stop(at(ms), of(true, 7), &stop(false, "lidar.rear"));
            line.on_stop(at(ms), of(false, 300), &stop(false, "lidar.front"));
            assert_eq!(holds(&line, at(ms)), [(Hold::PauseField, "lidar.front")]);
        }
        line.on_stop(at(2000), of(false, 300), &stop(true, "lidar.rear"));
        line.on_stop(at(2000), of(true, 7), &stop(false, "lidar.front"));
        line.on_stop(at(2000), of(true, 7), &stop(false, "lidar.rear"));
        assert_eq!(holds(&line, at(2000)), [(Hold::PauseOther, "lidar.rear")]);
        // What the driver reported before it was listed is its own.
        let mut line = with_fields();
        line.on_stop(at(0), of(false, 7), &stop(true, "lidar.front"));
        line.on_stop(at(10), of(true, 7), &stop(false, "lidar.front"));
        line.on_stop(at(10), of(true, 7), &stop(false, "lidar.rear"));
        assert_eq!(holds(&line, at(10)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn an_input_that_is_open_or_becomes_unknown_is_latched() {
        let input = |name: &str, own| InputName { name: name.into(), own };
        let inputs = [input("io.estop", false), input("drive.left.3", true)];
        let mut line = PauseLine::new(false, &[], &inputs);
        let unknown = [(Hold::PauseInputUnknown, "io.estop"), (Hold::PauseInputUnknown, "drive.left.3")];
        assert_eq!(holds(&line, at(0)), unknown);
        line.expire(at(0));
        assert!(!line.is_latched(), "a robot that starts");
        let closed = |line: &mut PauseLine, ms| {
            line.on_stop(at(ms), of(true, 7), &stop(false, "io.estop"));
            line.on_input(at(ms), 1, false);
        };
        closed(&mut line, 100);
        assert_eq!((holds(&line, at(599)), line.poll_timeout(at(100))), (vec![], Some(at(600))));
        // Both fall silent.
        line.expire(at(600));
        assert_eq!(holds(&line, at(600)), unknown);
        line.overrule(at(5000));
        line.release();
        closed(&mut line, 5000);
        assert_eq!(holds(&line, at(5000)), [(Hold::PauseLatched, "")], "a person does not overrule what is not known");
        line.release();
        assert_eq!(holds(&line, at(5000)), []);
        // This process was not served meanwhile: the first report after the gap does not hide it.
        closed(&mut line, 5550);
        assert_eq!(holds(&line, at(5550)), [(Hold::PauseLatched, "")]);
        line.release();
        let mut line = PauseLine::new(false, &[], &inputs);
        closed(&mut line, 5000);
        assert_eq!(holds(&line, at(5000)), []);
        // One opens.
        line.on_input(at(5100), 1, true);
        assert_eq!(holds(&line, at(5100)), [(Hold::PauseInput, "drive.left.3")]);
        assert!(!line.cuts_feed(), "only the power controller's line does");
        closed(&mut line, 5200);
        assert_eq!(holds(&line, at(5200)), [(Hold::PauseLatched, "")]);
        line.release();
        // Another program in its name, and in that of an input that this driver reads.
        line.on_stop(at(5300), of(false, 300), &stop(true, "io.estop"));
        line.on_stop(at(5300), of(true, 300), &stop(true, "drive.left.3"));
        assert_eq!(holds(&line, at(5300)), [(Hold::PauseOther, "io.estop"), (Hold::PauseOther, "drive.left.3")]);
        line.on_stop(at(5400), of(true, 300), &stop(false, "drive.left.3"));
        assert_eq!(holds(&line, at(5400)), [(Hold::PauseOther, "io.estop")]);
    }

    #[test]
    fn more_sources_than_can_be_told_apart_stay_engaged_until_a_person_overrules_them() {
        let mut line = PauseLine::new(true, &[], &[]);
        line.on_stop(at(0), Origin::DUE, &stop(false, ""));
        for n in 0..=OTHERS_MAX {
            line.on_stop(at(10), Origin::DUE, &stop(true, &format!("s{n}")));
        }
        // The last one took the place of the one before, which is still engaged.
        for n in (0..OTHERS_MAX - 1).chain([OTHERS_MAX]) {
            line.on_stop(at(20), Origin::DUE, &stop(false, &format!("s{n}")));
        }
        assert_eq!(holds(&line, at(30)), [(Hold::PauseOther, "s8")]);
        line.overrule(at(1300));
        line.on_stop(at(1300), Origin::DUE, &stop(false, ""));
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_person_overrules_only_senders_that_fell_silent() {
        let mut line = PauseLine::new(false, &[], &[]);
        line.on_stop(at(0), Origin::DUE, &stop(true, "a rope"));
        line.on_stop(at(1000), Origin::DUE, &stop(true, "a wire"));
        line.on_stop(at(1000), Origin::DUE, &stop(true, "button"));
        line.overrule(at(1300));
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseButton, "button"), (Hold::PauseOther, "a wire")]);
        line.overrule(at(2300));
        assert_eq!(holds(&line, at(2300)), [(Hold::PauseLatched, "")], "nobody else could release it");
        for n in 0..100 {
            line.on_stop(at(2400), Origin::DUE, &stop(true, &format!("s{n}")));
        }
        assert_eq!(line.others.len(), OTHERS_MAX);
    }
}
