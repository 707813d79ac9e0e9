//! What a lidar evaluates by itself and stops the robot: a field that is infringed or not known, and an output that is
//! not active or not known, engage PAUSE.

use super::config::Device;
use base::{Duration, Fault, Instant, Severity, earliest};
use lidar::{FieldResult, Zone};
use messages::lowlevel::EventStop;
use module::Actions;

/// Longest period of `LL_EVENT_STOP`; `driver_canbus` stops the robot if it is missing for 500 ms.
const PERIOD: Duration = Duration::from_millis(100);
/// Time after which a lidar that measures, and gives no result, is reported.
const REPORTED_AFTER: Duration = Duration::from_secs(1);

/// Fields and outputs of a lidar that stop the robot.
#[derive(Debug)]
pub(super) struct Stop {
    zones: Vec<Zone>,
    /// What was published last; `None`: nothing was known yet, and nothing published. Silence stops the robot as well,
    /// and ends when the results come, as of a power controller that has just started.
    engaged: Option<bool>,
    due: Instant,
    /// Since when it measures and one of them is not known.
    unknown: Option<Instant>,
    /// That was reported.
    reported: bool,
}

impl Stop {
    /// `None`: nothing of the lidar stops the robot.
    pub(super) fn new(device: &Device) -> Option<Self> {
        let zones: Vec<Zone> = device.stop.zones().collect();
        let (engaged, due, unknown, reported) = (None, Instant::NEVER, None, false);
        (!zones.is_empty()).then_some(Self { zones, engaged, due, unknown, reported })
    }

    /// Publishes and reports the present results. `evaluates`: the lidar measures, and the module is not in STOP; else
    /// nothing is known.
    pub(super) fn serve(
        &mut self,
        now: Instant,
        device: &Device,
        result: impl Fn(Zone) -> FieldResult,
        evaluates: bool,
        out: &mut Actions,
    ) {
        let result = |zone| if evaluates { result(zone) } else { FieldResult::Unknown };
        let first = |wanted| self.zones.iter().copied().find(|zone| result(*zone) == wanted);
        let (infringed, unknown) = (first(FieldResult::Infringed), first(FieldResult::Unknown));
        self.unknown = unknown.map(|_| self.unknown.unwrap_or(now));
        if self.engaged.is_none() && infringed.is_none() && unknown.is_some() {
            return;
        }
        let engaged = infringed.is_some() || unknown.is_some();
        if self.engaged != Some(engaged) || self.due <= now {
            self.due = now + PERIOD;
            out.publish(EventStop { timestamp: out.timestamp(now), engaged, source: device.bus.clone() });
        }
        if self.engaged.replace(engaged).is_some_and(|before| before != engaged) {
            out.note(words(&device.name, infringed, unknown));
        }
    }

    /// Reports a lidar that measures and gives no result; one that does not measure is reported as such.
    pub(super) fn report(&mut self, now: Instant, device: &Device, measures: bool, out: &mut Actions) {
        if !measures {
            // It has as long again once it measures.
            self.unknown = self.unknown.map(|_| now);
        }
        let (bus, name) = (device.bus.as_str(), &device.name);
        let is_due = self.unknown.is_some_and(|since| since + REPORTED_AFTER <= now);
        if !self.reported && is_due {
            let message = format!("lidar {name} gives no valid result of what is to stop the robot: PAUSE");
            out.raise(Severity::Error, Fault::LidarNoResult, bus, message);
            self.reported = true;
        } else if self.reported && self.unknown.is_none() {
            out.clear(Fault::LidarNoResult, bus, format!("lidar {name} gives results again"));
            self.reported = false;
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let report = self.unknown.filter(|_| !self.reported).map(|since| since + REPORTED_AFTER);
        earliest([Some(self.due), report])
    }
}

/// What happened, for people.
fn words(name: &str, infringed: Option<Zone>, unknown: Option<Zone>) -> String {
    match (infringed, unknown) {
        (Some(zone @ Zone::Field(_)), _) => format!("lidar {name}: {zone} is infringed: PAUSE"),
        (Some(zone @ Zone::Output(_)), _) => format!("lidar {name}: {zone} is not active: PAUSE"),
        (None, Some(zone)) => format!("lidar {name}: {zone} is not known: PAUSE"),
        (None, None) => format!("lidar {name}: all is free that stops the robot"),
    }
}
