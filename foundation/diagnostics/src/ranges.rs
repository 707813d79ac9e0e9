//! Range finders as people are shown them: from `LL_DATA_RANGES`, or where only that comes, from the view of 2011.

use crate::{Model, Slot};
use base::Instant;
use messages::lowlevel::{Range, Reading};

/// The newest readings of one kind of range finder.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// In order of the message.
    pub readings: Vec<Reading>,
    /// They come from `LL_DATA_SRFS` or `LL_DATA_IRS`, which cannot tell silence from a dead sensor: what is not valid
    /// there is UNKNOWN here.
    pub of_2011: bool,
}

impl Model {
    /// The sonars; `beam`: full opening angle for the view of 2011, rad. `None` where nothing came yet.
    #[must_use]
    pub fn sonar_readings(&self, now: Instant, beam: f64) -> Option<Readings> {
        let old = self.sonars.get().map(|sonars| &sonars.srfs[..]);
        self.readings(now, Reading::SONAR, is_fresh(&self.sonars, now), old, beam)
    }

    /// The infrared rangers. `None` where nothing came yet.
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
