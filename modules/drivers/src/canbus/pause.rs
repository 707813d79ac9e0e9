//! The PAUSE line as reported by `LL_EVENT_STOP`: engaged while any source reports it engaged, and latched until a
//! deliberate act.
//!
//! The power controller reports for the sources on its line (bumpers, floor sensors, the button, or without a name);
//! other senders report for themselves, under their own names. None of them releases what another one engaged. A source
//! other than the power controller that engaged the line and fell silent stays engaged until it reports that it is
//! open, or until a person overrules it. The same holds for a power controller that the robot is not configured with.

use base::{Duration, Instant};
use messages::{Hold, StopSource, lowlevel};

/// `LL_EVENT_STOP` is sent every 500 ms; after this time without it the state of its source is unknown.
pub(super) const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// Maximum number of sources beside the power controller that are distinguished; a further one replaces the last.
const OTHERS_MAX: usize = 8;

/// Reason why the PAUSE line stops the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paused {
    /// The state of the line is unknown.
    Unknown,
    /// The power controller reports this source.
    Engaged(StopSource),
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

/// Another sender that engages the line.
#[derive(Clone, Debug, PartialEq)]
struct Other {
    name: String,
    /// Time of its last report.
    at: Instant,
    /// It stands for several, so a report that one of them is open does not open it; only a person overrules it.
    shared: bool,
}

/// State of the line.
#[derive(Debug)]
pub(super) struct PauseLine {
    controller: Controller,
    /// Time of its last report.
    reported: Instant,
    /// Instant from which on the controller's report is too old; absent without a controller.
    until: Option<Instant>,
    others: Vec<Other>,
    latched: bool,
}

impl PauseLine {
    /// `has_controller`: a power controller reports the line, and the robot does not move without its report.
    pub(super) fn new(has_controller: bool) -> Self {
        let controller = if has_controller { Controller::Unknown } else { Controller::Open };
        Self {
            controller,
            reported: Instant::ZERO,
            until: has_controller.then_some(Instant::ZERO + PAUSE_TIMEOUT),
            others: vec![],
            latched: false,
        }
    }

    /// Processes a report, received at `at`.
    pub(super) fn on_stop(&mut self, at: Instant, stop: &lowlevel::EventStop) {
        let source = StopSource::from_name(&stop.source);
        self.latched |= stop.engaged;
        if source == StopSource::Unknown && !stop.source.is_empty() {
            return self.on_other(at, stop);
        }
        self.controller =
            if stop.engaged { Controller::Engaged(source, stop.source.clone()) } else { Controller::Open };
        self.reported = at;
        if let Some(until) = &mut self.until {
            *until = at + PAUSE_TIMEOUT;
        }
    }

    fn on_other(&mut self, at: Instant, stop: &lowlevel::EventStop) {
        let shared = self.others.iter().any(|other| other.name == stop.source && other.shared);
        if stop.engaged || !shared {
            self.others.retain(|other| other.name != stop.source);
        }
        if stop.engaged {
            let full = self.others.len() >= OTHERS_MAX;
            self.others.truncate(OTHERS_MAX - 1);
            self.others.push(Other { name: stop.source.clone(), at, shared: shared || full });
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
        let others = (0..self.others.len()).map(Paused::Other);
        let latched = self.latched && controller.is_none() && self.others.is_empty();
        controller.into_iter().chain(others).chain(latched.then_some(Paused::Latched))
    }

    /// Cause in `LL_DATA_HOLD` with its subject.
    pub(super) fn hold(&self, paused: Paused) -> (Hold, &str) {
        match (paused, &self.controller) {
            (Paused::Unknown, _) => (Hold::PauseUnknown, ""),
            (Paused::Latched, _) => (Hold::PauseLatched, ""),
            (Paused::Engaged(source), Controller::Engaged(_, name)) => (source.hold(), name),
            (Paused::Engaged(source), _) => (source.hold(), source.name()),
            (Paused::Other(place), _) => {
                (Hold::PauseOther, self.others.get(place).map_or("", |other| other.name.as_str()))
            }
        }
    }

    /// True while any source is known to engage the line.
    pub(super) fn is_engaged(&self) -> bool {
        matches!(self.controller, Controller::Engaged(..)) || !self.others.is_empty()
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

    /// A person overrules senders that engaged the line and have been silent since; never the robot's power controller.
    pub(super) fn overrule(&mut self, now: Instant) {
        if self.until.is_none() && now.since(self.reported) >= PAUSE_TIMEOUT {
            self.controller = Controller::Open;
        }
        self.others.retain(|other| now.since(other.at) < PAUSE_TIMEOUT);
    }

    /// Next deadline after `now`.
    pub(super) fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        self.until.filter(|until| now < *until)
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

    fn holds(line: &PauseLine, now: Instant) -> Vec<(Hold, &str)> {
        line.reasons(now).map(|paused| line.hold(paused)).collect()
    }

    #[test]
    fn a_source_is_not_released_by_another_one() {
        let mut line = PauseLine::new(true);
        line.on_stop(at(0), &stop(true, "a rope"));
        line.on_stop(at(10), &stop(true, "bumper2"));
        assert_eq!(holds(&line, at(20)), [(Hold::PauseBumper, "bumper2"), (Hold::PauseOther, "a rope")]);
        line.on_stop(at(500), &stop(false, ""));
        assert_eq!(holds(&line, at(510)), [(Hold::PauseOther, "a rope")], "the controller's next report");
        line.on_stop(at(600), &stop(false, "another rope"));
        assert_eq!(holds(&line, at(610)), [(Hold::PauseOther, "a rope")]);
        line.on_stop(at(700), &stop(false, "a rope"));
        assert_eq!(holds(&line, at(710)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_person_does_not_overrule_the_robots_power_controller() {
        let mut line = PauseLine::new(true);
        line.on_stop(at(0), &stop(true, "button"));
        line.overrule(at(1100));
        assert_eq!(holds(&line, at(1100)), [(Hold::PauseButton, "button")]);
        line.overrule(at(5000));
        assert_eq!(holds(&line, at(5000)), [(Hold::PauseUnknown, "")]);
    }

    #[test]
    fn reports_of_others_do_not_stand_in_for_the_power_controller() {
        let mut line = PauseLine::new(true);
        line.on_stop(at(100), &stop(false, ""));
        for ms in (200..2000).step_by(100) {
            line.on_stop(at(ms), &stop(false, "a rope"));
        }
        assert_eq!(holds(&line, at(1299)), []);
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseUnknown, "")]);
        assert_eq!(line.poll_timeout(at(100)), Some(at(1300)));
    }

    #[test]
    fn the_line_stays_latched_until_an_operator_acts_after_it_is_open() {
        let mut line = PauseLine::new(false);
        line.on_stop(at(0), &stop(true, "button"));
        line.release();
        line.on_stop(at(10), &stop(false, ""));
        assert_eq!(holds(&line, at(3_600_000)), [(Hold::PauseLatched, "")]);
        line.release();
        assert_eq!(holds(&line, at(3_600_000)), []);
    }

    #[test]
    fn more_sources_than_can_be_told_apart_stay_engaged_until_a_person_overrules_them() {
        let mut line = PauseLine::new(true);
        line.on_stop(at(0), &stop(false, ""));
        for n in 0..=OTHERS_MAX {
            line.on_stop(at(10), &stop(true, &format!("s{n}")));
        }
        // The last one took the place of the one before, which is still engaged.
        for n in (0..OTHERS_MAX - 1).chain([OTHERS_MAX]) {
            line.on_stop(at(20), &stop(false, &format!("s{n}")));
        }
        assert_eq!(holds(&line, at(30)), [(Hold::PauseOther, "s8")]);
        line.overrule(at(1300));
        line.on_stop(at(1300), &stop(false, ""));
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseLatched, "")]);
    }

    #[test]
    fn a_person_overrules_only_senders_that_fell_silent() {
        let mut line = PauseLine::new(false);
        line.on_stop(at(0), &stop(true, "a rope"));
        line.on_stop(at(1000), &stop(true, "a wire"));
        line.on_stop(at(1000), &stop(true, "button"));
        line.overrule(at(1300));
        assert_eq!(holds(&line, at(1300)), [(Hold::PauseButton, "button"), (Hold::PauseOther, "a wire")]);
        line.overrule(at(2300));
        assert_eq!(holds(&line, at(2300)), [(Hold::PauseLatched, "")], "nobody else could release it");
        for n in 0..100 {
            line.on_stop(at(2400), &stop(true, &format!("s{n}")));
        }
        assert_eq!(line.others.len(), OTHERS_MAX);
    }
}
