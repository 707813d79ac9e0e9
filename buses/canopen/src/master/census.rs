//! Census of all nodes on the bus, configured or not: the newest NMT state and the rate of frames.

use super::shared::Shared;
use super::{Event, MasterConfig};
use crate::wire::NmtState;
use base::can::{Frame, INTERMISSION};
use base::{Duration, Instant};

/// Over so long frames are counted before a node is called babbling, or quiet again.
const WINDOW: Duration = Duration::from_millis(100);

/// Frames of a node within the window.
#[derive(Clone, Copy, Default)]
struct Sent {
    frames: u32,
    bits: u32,
}

pub(super) struct Census {
    states: [Option<NmtState>; 128],
    /// One bit for each unconfigured node that has been reported.
    strangers: u128,
    since: Instant,
    /// By node id; 0: what belongs to none.
    sent: [Sent; 128],
    babbling: u128,
    most_frames: u64,
    most_bits: u64,
}

impl Census {
    pub(super) fn new(config: &MasterConfig) -> Self {
        Self {
            states: [None; 128],
            strangers: 0,
            since: Instant::ZERO,
            sent: [Sent::default(); 128],
            babbling: 0,
            most_frames: u64::from(config.babbling).max(1),
            most_bits: (u64::from(config.bit_rate) * u64::from(config.babbling_share) / 100).max(1),
        }
    }

    /// The state that a node named last.
    pub(super) fn state(&self, node: u8) -> Option<NmtState> {
        *self.states.get(usize::from(node))?
    }

    /// A node, configured or not, named its state.
    pub(super) fn named(&mut self, node: u8, state: NmtState) {
        if let Some(known) = self.states.get_mut(usize::from(node)) {
            *known = Some(state);
        }
    }

    /// Records an unconfigured node; returns true the first time.
    pub(super) fn is_new(&mut self, node: u8) -> bool {
        let bit = 1 << (node & 0x7F);
        let new = self.strangers & bit == 0;
        self.strangers |= bit;
        new
    }

    /// Counts an unsolicited frame of `node`, 0 if it belongs to no node.
    pub(super) fn count(&mut self, node: u8, frame: &Frame) {
        let sent = &mut self.sent[usize::from(node & 0x7F)];
        sent.frames += 1;
        sent.bits += 44 + 8 * u32::from(frame.dlc()) + INTERMISSION;
    }

    /// Evaluates the counters at the end of the window. No timer is armed for it: the heartbeat is frequent enough.
    pub(super) fn judge(&mut self, now: Instant, shared: &mut Shared) {
        let passed = now.since(self.since);
        if passed < WINDOW {
            return;
        }
        self.since = now;
        let passed = u64::try_from(passed.as_micros()).unwrap_or(u64::MAX).max(1);
        for (node, sent) in (0..).zip(&mut self.sent) {
            let Sent { frames, bits } = core::mem::take(sent);
            let per_second = |count: u32| u64::from(count) * 1_000_000 / passed;
            let (frames, bits) = (per_second(frames), per_second(bits));
            let bit = 1_u128 << node;
            if self.babbling & bit == 0 && (frames >= self.most_frames || bits >= self.most_bits) {
                self.babbling |= bit;
                shared.events.push(Event::Babbling { node, rate: u32::try_from(frames).unwrap_or(u32::MAX) });
            } else if self.babbling & bit != 0 && frames < self.most_frames / 2 && bits < self.most_bits / 2 {
                self.babbling &= !bit;
                shared.events.push(Event::BabblingOver { node });
            }
        }
    }
}
