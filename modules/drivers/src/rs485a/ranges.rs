//! The table of rangers, and what the boards last said of each.

use super::config::{Config, Kind, Ranger};
use base::Instant;
use messages::lowlevel::Range;
use rs485::boards::sd1::{Both, NO_ECHO, OUT_OF_RANGE};

/// What all SD1 boards last measured, published as one: when all have answered, failed, or are not waited for.
#[derive(Debug)]
pub struct Ranges {
    boards: Vec<Board>,
    /// In order of their numbers.
    srfs: Vec<Ranger>,
    irs: Vec<Ranger>,
    latest: Option<Instant>,
}

#[derive(Debug)]
struct Board {
    address: u8,
    last: Option<Both>,
    /// Has answered, or failed to, since the last publication.
    done: bool,
}

impl Ranges {
    pub fn new(config: &Config) -> Self {
        let sorted = |rangers: &[Ranger]| {
            let mut rangers = rangers.to_vec();
            rangers.sort_by_key(|ranger| ranger.id);
            rangers
        };
        let sd1 = config.nodes.iter().filter(|node| node.kind == Kind::Sd1);
        Self {
            boards: sd1.map(|node| Board { address: node.address, last: None, done: false }).collect(),
            srfs: sorted(&config.srfs),
            irs: sorted(&config.irs),
            latest: None,
        }
    }

    /// Whether the board's round was over already: what stands is to be published before its news.
    pub fn is_done(&self, address: u8) -> bool {
        self.boards.iter().any(|board| board.address == address && board.done)
    }

    /// The board measured this, or failed to say.
    pub fn put(&mut self, at: Instant, address: u8, both: Option<Both>) {
        if let Some(board) = self.boards.iter_mut().find(|board| board.address == address) {
            board.done = true;
            board.last = both;
            self.latest = Some(at);
        }
    }

    /// Whether all boards that are waited for have said something.
    pub fn complete(&self, waited_for: impl Fn(u8) -> bool) -> bool {
        let mut boards = self.boards.iter();
        boards.clone().any(|board| board.done) && boards.all(|board| board.done || !waited_for(board.address))
    }

    /// All sonars and all infrared rangers, and when the last board spoke; starts the next round.
    pub fn publish(&mut self) -> (Instant, Vec<Range>, Vec<Range>) {
        self.boards.iter_mut().for_each(|board| board.done = false);
        let srf = |both: &Both, channel: usize| both.srfs.get(channel).copied().filter(|mm| *mm != NO_ECHO);
        let ir = |both: &Both, channel: usize| {
            both.irs.get(channel).copied().filter(|mm| *mm != OUT_OF_RANGE).map(u16::from)
        };
        let at = self.latest.unwrap_or_default();
        (at, self.list(&self.srfs, srf), self.list(&self.irs, ir))
    }

    /// Nothing of what the boards said holds any more.
    pub fn forget(&mut self) {
        self.boards.iter_mut().for_each(|board| (board.last, board.done) = (None, false));
    }

    fn list(&self, rangers: &[Ranger], measured: impl Fn(&Both, usize) -> Option<u16>) -> Vec<Range> {
        let range = |ranger: &Ranger| {
            let board = self.boards.iter().find(|board| board.address == ranger.board);
            let both = board.and_then(|board| board.last.as_ref());
            let mm = both.and_then(|both| measured(both, usize::from(ranger.channel)));
            let Ranger { id, x, y, theta, .. } = *ranger;
            let distance = mm.map_or(f64::NAN, |mm| f64::from(mm) / 1000.0);
            Range { id: i32::from(id), x, y, theta, distance, valid: mm.is_some() }
        };
        rangers.iter().map(range).collect()
    }
}
