//! Range finders as shown to people: from `LL_DATA_RANGES`, or as a fallback from the view of 2011.

use crate::{Model, Slot};
use base::Instant;
use messages::lowlevel::{Range, Reading};

/// Newest readings of one kind of range finder.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// Readings in order of the message.
    pub readings: Vec<Reading>,
    /// True if they come from `LL_DATA_SRFS` or `LL_DATA_IRS`, which cannot distinguish silence from a dead sensor:
    /// invalid ones are UNKNOWN here.
    pub of_2011: bool,
}

impl Model {
    /// Sonars; `beam` is the full opening angle for the view of 2011, rad. `None` before the first message.
    #[must_use]
    pub fn sonar_readings(&self, now: Instant, beam: f64) -> Option<Readings> {
        let old = self.sonars.get().map(|sonars| &sonars.srfs[..]);
        self.readings(now, Reading::SONAR, is_fresh(&self.sonars, now), old, beam)
    }

    /// Infrared range finders. `None` before the first message.
    #[must_use]
    pub fn infrared_readings(&self, now: Instant) -> Option<Readings> {
        let old = self.infrareds.get().map(|infrareds| &infrareds.irs[..]);
        self.readings(now, Reading::INFRARED, is_fresh(&self.infrareds, now), old, 0.0)
    }

    fn readings(
        &self,
        now: Instant,
        kind: i8,
        old_is_fresh: bool,
        old: Option<&[Range]>,
        beam: f64,
    ) -> Option<Readings> {
        let new = self.ranges.get().filter(|_| is_fresh(&self.ranges, now) || !old_is_fresh);
        match (new, old) {
            (Some(ranges), _) => {
                let own = ranges.readings.iter().filter(|reading| reading.kind == kind);
                Some(Readings { readings: own.cloned().collect(), of_2011: false })
            }
            (None, Some(old)) => {
                let reading = |range: &Range| {
                    let Range { id, x, y, theta, distance, valid } = *range;
                    let status = if valid { Reading::MEASURED } else { Reading::UNKNOWN };
                    Reading { timestamp: 0, id, kind, status, distance, x, y, theta, beam }
                };
                Some(Readings { readings: old.iter().map(reading).collect(), of_2011: true })
            }
            (None, None) => None,
        }
    }
}

fn is_fresh<T>(slot: &Slot<T>, now: Instant) -> bool {
    slot.fresh(now).is_some()
}
