//! The PAUSE line as the driver was told: engaged while any source reports it engaged (docs/design.md, section 4).
//!
//! The power controller reports for the sources on its line, by their names in the contract or none; others report for
//! themselves, whatever name they give, each for what it engaged, and an operator's RUN overrules one that fell silent.
//! The module of a lidar's fields, or of an input, reports for it in each of its processes, and nobody overrules it.

use base::{Duration, Instant};
use messages::{StopSource, lowlevel};

/// Timeout of the power controller's `LL_EVENT_STOP`, which is sent every 500 ms; of another source, the silence after
/// which an operator overrules it.
pub(super) const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);

/// State of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Pause {
    #[default]
    Unheard,
    Open,
    /// Engaged since the driver was served that.
    Engaged(Instant),
}

impl Pause {
    fn engaged(self) -> Option<Instant> {
        if let Self::Engaged(since) = self { Some(since) } else { None }
    }
}

/// Who reports a source beside the power controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum By {
    /// A process of the module that is due to.
    Module,
    /// Another process, where it is known.
    Process(Option<u32>),
}

/// A source beside the power controller that engages the line.
#[derive(Debug)]
struct Other {
    name: Box<str>,
    by: By,
    since: Instant,
    /// Reception time of its last report.
    heard: Instant,
}

/// All sources.
#[derive(Debug, Default)]
pub(super) struct PauseLine {
    controller: Pause,
    heard: Instant,
    others: Vec<Other>,
    /// Sources that their module has reported, and reception times of its last reports.
    known: Vec<(Box<str>, Instant)>,
}

impl PauseLine {
    /// State of the line; engaged since the oldest report that still holds.
    pub fn state(&self) -> Pause {
        let others = self.others.iter().map(|other| other.since);
        others.chain(self.controller.engaged()).min().map_or(self.controller, Pause::Engaged)
    }

    /// True while the power controller reports its line engaged, which cuts the motors' feed. Other sources cut
    /// nothing.
    pub fn cuts_feed(&self) -> bool {
        self.controller.engaged().is_some()
    }

    /// Reception time of the power controller's last report.
    pub fn heard(&self) -> Instant {
        self.heard
    }

    /// Reception time of the last report of this source by its module.
    pub fn known(&self, source: &str) -> Option<Instant> {
        self.known.iter().find(|(name, _)| **name == *source).map(|(_, at)| *at)
    }

    /// True if this sender has engaged PAUSE as that source, beside the power controller, and not released it.
    pub fn is_engaged_by(&self, by: By, source: &str) -> bool {
        self.others.iter().any(|other| other.by == by && *other.name == *source)
    }

    /// The driver is served a report that was received at `at` from this sender; `is_due`: of the power controller, or
    /// of a robot without one.
    pub fn on_report(&mut self, now: Instant, at: Instant, by: By, is_due: bool, stop: &lowlevel::EventStop) {
        if is_due && (StopSource::from_name(&stop.source) != StopSource::Unknown || stop.source.is_empty()) {
            let since = self.controller.engaged().unwrap_or(now);
            self.controller = if stop.engaged { Pause::Engaged(since) } else { Pause::Open };
            self.heard = at;
            return;
        }
        if by == By::Module {
            self.known.retain(|(name, _)| **name != *stop.source);
            self.known.push((stop.source.as_str().into(), at));
        }
        let known = self.others.iter().position(|other| other.by == by && *other.name == *stop.source);
        match (stop.engaged, known) {
            (true, Some(place)) => self.others[place].heard = at,
            (true, None) => self.others.push(Other { name: stop.source.as_str().into(), by, since: now, heard: at }),
            (false, Some(place)) => drop(self.others.remove(place)),
            (false, None) => {}
        }
    }

    /// An operator's RUN, to a robot with a power controller or without.
    pub fn overrule(&mut self, now: Instant, has_controller: bool) {
        if !has_controller && now.since(self.heard) >= PAUSE_TIMEOUT {
            self.controller = Pause::Open;
        }
        self.others.retain(|other| other.by == By::Module || now.since(other.heard) < PAUSE_TIMEOUT);
    }
}
