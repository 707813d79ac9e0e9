//! How a drive comes to a stand: its ramps, its option codes, and what it does when the master is silent.

use super::draft::Draft;
use super::refusal::{Reason, Refusal};
use crate::axis::modes::Mode;
use crate::drives::cia402::{HEARTBEAT_LIMIT, Quantity};
use crate::master::{Expect, Guarding};
use base::Duration;

/// Requests to a drive that has no heartbeat, or watches none: it stops after four of them are missing.
const GUARDING: Guarding = Guarding { period: Duration::from_millis(50), factor: 4 };
/// Bits of an option code.
const CODE: u32 = 0xFFFF;

/// Codes of a range.
const fn codes(index: u16, min: u32, max: u32) -> Expect {
    Expect { index, sub: 0, mask: CODE, min, max }
}

/// Sets the ramps, and how commands and faults stop the drive; true if quick stop is kept.
pub(super) fn stops(draft: &mut Draft<'_>) -> Result<bool, Refusal> {
    let cyclic = matches!(draft.description.mode, Mode::CyclicVelocity | Mode::CyclicPosition | Mode::Interpolated);
    for (index, ramp) in [(0x6083, Quantity::Acceleration), (0x6084, Quantity::Deceleration)] {
        match draft.set(index, 0, ramp) {
            // Set-points at SYNC have no ramp.
            Err(_) if cyclic => {}
            result => drop(draft.excused(result)?),
        }
    }
    let result = draft.set(0x6085, 0, Quantity::QuickStop);
    let has_ramp = !draft.excused(result)? || draft.description.quirks.vouched.contains(&0x6085);
    let wanted: &[i64] = if has_ramp { &[6, 2] } else { &[5, 1] };
    let option = draft.option(wanted, codes(0x605A, 1, 8));
    let code = option.as_ref().ok().copied().flatten();
    draft.excused(option.map(drop))?;
    // Disable Operation and halt by their ramps; an axis is disabled when it stands.
    for index in [0x605B, 0x605C, 0x605D] {
        draft.set_where_there(index, 0, 1);
    }
    let option = draft.option(&[2, 1], codes(0x605E, 1, 4));
    draft.excused(option.map(drop))?;
    Ok(code.map_or(draft.description.quirks.keeps_quick_stop, |code| code >= 5))
}

/// Who watches whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Supervision {
    /// The drive watches the master's heartbeat.
    pub watches_master: bool,
    /// The drive is guarded, and watches the requests.
    pub guarding: Option<Guarding>,
}

/// Finds how the drive and the master notice that the other one is gone, and sets what the drive does then.
pub(super) fn supervision(draft: &mut Draft<'_>) -> Result<Supervision, Refusal> {
    let sheet = draft.sheet;
    let limit = i64::from(draft.description.master) << 16 | HEARTBEAT_LIMIT.as_millis() as i64;
    let produces = sheet.takes(0x1017, 0, 50).map(drop);
    let consumes = sheet.takes(0x1016, 1, limit).map(drop);
    let time = sheet.takes(0x100C, 0, GUARDING.period.as_millis() as i64);
    let guards = time.and_then(|_| sheet.takes(0x100D, 0, GUARDING.factor.into())).is_ok();
    let guarding = match (produces, &consumes) {
        (Ok(()), Ok(())) => None,
        _ if guards => Some(GUARDING),
        // The loss of the drive itself would not be noticed: no second way helps.
        (Err(refusal), _) => return Err(refusal),
        (Ok(()), Err(refusal)) => {
            draft.excused(Err(*refusal))?;
            None
        }
    };
    let reaction = reaction(draft);
    draft.excused(reaction)?;
    Ok(Supervision { watches_master: consumes.is_ok(), guarding })
}

/// Quick stop when the master is gone, or a fault, whose reaction brakes; else it leaves Operational.
fn reaction(draft: &mut Draft<'_>) -> Result<(), Refusal> {
    // 1 and 3.
    let sound = Expect::masked(0x6007, 0, CODE & !2, 1);
    match draft.option(&[3, 1], sound) {
        Err(refusal @ Refusal { reason: Reason::Missing, .. }) => {
            // 0: to Pre-operational.
            let leaves = draft.option(&[0], Expect { index: 0x1029, sub: 1, mask: 0xFD, min: 0, max: 0 });
            leaves.map(drop).map_err(|_| refusal)
        }
        result => result.map(drop),
    }
}
