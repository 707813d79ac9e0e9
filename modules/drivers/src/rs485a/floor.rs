//! Which floor sensor of a distance board engages the PAUSE line: the board knows (`get_pause_src`), the power
//! controller reports the board only.
//!
//! A board is asked when `LL_EVENT_STOP` names it, and again, at most each [`ASK_PERIOD`], until it no longer engages
//! the line. Only its own answer ends the report: another source may engage the line meanwhile, and be the one that is
//! named.

use crate::rs485_bus::{Kind, Node};
use base::{Duration, Fault, Instant, Severity};
use messages::StopSource;
use messages::lowlevel::EventStop;
use module::Actions;
use rs485::boards::sd1::{self, PauseSource};

/// Minimum time between two questions to a board; the line is reported every 500 ms.
const ASK_PERIOD: Duration = Duration::from_millis(400);

#[derive(Debug)]
struct Board {
    address: u8,
    name: String,
    /// As the power controller names it.
    source: StopSource,
    /// Its last answer.
    engages: PauseSource,
    asked: Option<Instant>,
    /// Its answer was none: it is not asked again while it is named.
    unable: bool,
}

/// The distance boards of the bus.
#[derive(Debug)]
pub(super) struct Floor(Vec<Board>);

impl Floor {
    pub(super) fn new(nodes: &[Node]) -> Self {
        let board = |node: &Node| {
            // A board at another address is not wired to the power controller as one of these.
            let source = match node.address {
                sd1::FRONT => StopSource::Sd1Front,
                sd1::REAR => StopSource::Sd1Rear,
                _ => return None,
            };
            let (address, name) = (node.address, node.name.clone());
            Some(Board { address, name, source, engages: PauseSource::None, asked: None, unable: false })
        };
        Self(nodes.iter().filter(|node| node.kind == Kind::Sd1).filter_map(board).collect())
    }

    /// The state of the PAUSE line was reported: addresses of the boards to be asked. What others report says nothing
    /// of the boards.
    pub(super) fn on_stop(&mut self, now: Instant, stop: &EventStop) -> Vec<u8> {
        if !StopSource::is_of_line(&stop.source) {
            return Vec::new();
        }
        let named = if stop.engaged { StopSource::from_name(&stop.source) } else { StopSource::Unknown };
        let due = self.0.iter_mut().filter_map(|board| {
            board.unable &= board.source == named;
            let concerned = board.source == named || board.engages != PauseSource::None;
            let waits = board.asked.is_some_and(|asked| now.since(asked) < ASK_PERIOD);
            (concerned && !board.unable && !waits).then(|| {
                board.asked = Some(now);
                board.address
            })
        });
        due.collect()
    }

    /// A board answered what it cannot.
    pub(super) fn on_failure(&mut self, address: u8) {
        if let Some(board) = self.0.iter_mut().find(|board| board.address == address) {
            board.unable = true;
        }
    }

    /// A board answered which sensor engages the line.
    pub(super) fn on_answer(&mut self, address: u8, engages: PauseSource, out: &mut Actions) {
        let Some(board) = self.0.iter_mut().find(|board| board.address == address) else { return };
        let name = board.name.as_str();
        board.engages = engages;
        let side = match engages {
            PauseSource::None => {
                out.clear(Fault::FloorMissing, name, format!("{name} does not engage PAUSE any more"));
                return;
            }
            PauseSource::IrLeft => "left",
            PauseSource::IrRight => "right",
        };
        let end = if board.source == StopSource::Sd1Front { "front" } else { "rear" };
        let message = format!(
            "no floor at the {end} {side} corner: its floor sensor ({name}) engages PAUSE; push the robot back by hand \
             until it is over a flat floor, then command {} to RUN",
            super::NAME
        );
        out.raise(Severity::Warning, Fault::FloorMissing, name, message);
    }
}
