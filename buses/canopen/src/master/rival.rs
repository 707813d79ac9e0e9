//! Detection of another master: commands on the bus that this master did not send.
//!
//! Where the bus returns own frames, each frame that was sent may come back once; any other command is another
//! master's. Where it does not, every received command is another master's.

use super::MasterConfig;
use super::events::Foreign;
use base::can::{Frame, Id};
use base::{Duration, Instant};

/// Another master is reported at most this often.
const REPORT_PERIOD: Duration = Duration::from_secs(10);
/// Maximum number of frames that may still come back: those of some ms at full load.
const OWED_MAX: usize = 64;

pub(super) struct Rival {
    /// Sent frames that have not come back, oldest first; `None` where the bus returns none.
    owed: Option<heapless::Vec<Frame, OWED_MAX>>,
    quiet_until: Instant,
}

impl Rival {
    pub(super) fn new(config: &MasterConfig) -> Self {
        Self { owed: config.own_frames_return.then(heapless::Vec::new), quiet_until: Instant::ZERO }
    }

    /// A frame of this master leaves.
    pub(super) fn sent(&mut self, frame: &Frame) {
        if let Some(owed) = &mut self.owed {
            if owed.is_full() {
                owed.remove(0);
            }
            let _fits = owed.push(*frame);
        }
    }

    /// A command was received. Returns it if another master is to be reported.
    pub(super) fn received(&mut self, now: Instant, frame: &Frame, command: Foreign) -> Option<Foreign> {
        if self.is_own(frame) {
            return None;
        }
        self.reported(now).then_some(command)
    }

    /// True if another master is to be reported now.
    pub(super) fn reported(&mut self, now: Instant) -> bool {
        let due = self.quiet_until <= now;
        if due {
            self.quiet_until = now + REPORT_PERIOD;
        }
        due
    }

    /// True for a frame of this master that comes back.
    fn is_own(&mut self, frame: &Frame) -> bool {
        let Some(owed) = &mut self.owed else { return false };
        let same = |own: &Frame| own.id() == frame.id() && own.data() == frame.data();
        let Some(place) = owed.iter().position(same) else { return false };
        owed.remove(place);
        true
    }
}

/// Node that an NMT command addresses; 0: all.
pub(super) fn nmt_target(frame: &Frame) -> Option<u8> {
    match (frame.id(), frame.data()) {
        (Id::Standard(0), &[_, node]) => Some(node),
        _ => None,
    }
}
