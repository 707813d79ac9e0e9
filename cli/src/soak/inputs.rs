//! What one module of an episode was told, in each of its lives: written while the disk takes it, played again at the
//! end.

use base::Instant;
use record::{Item, Player, Reader, Refusal, Sink, Why};
use robot::recording;
use sim::soak::{Disk, Violation};
use std::cell::RefCell;
use std::rc::Rc;

/// The recordings of an episode.
#[derive(Clone)]
pub struct Inputs {
    module: String,
    disk: Disk,
    lives: Rc<RefCell<Vec<Life>>>,
}

/// The recording of one process.
#[derive(Default)]
struct Life {
    bytes: Vec<u8>,
    /// What the disk did not take is missing at the end,
    missing: bool,
    /// or before what it took later.
    gap: bool,
}

impl Inputs {
    /// Nothing yet, of a module by its name.
    pub fn new(module: &str, disk: Disk) -> Self {
        Self { module: module.into(), disk, lives: Rc::default() }
    }

    /// Where a new process of a module is to write, if that is the recorded one.
    pub fn sink(&self, module: &str) -> Option<Sink> {
        if module != self.module {
            return None;
        }
        let (lives, disk) = (self.lives.clone(), self.disk.clone());
        let place = lives.borrow().len();
        lives.borrow_mut().push(Life::default());
        Some(Box::new(move |record| lives.borrow_mut()[place].take(record, disk.is_full())))
    }

    /// Plays all of it again: what the module answers now is what it answered then, and a recording with a gap is
    /// refused.
    pub fn violation(&self) -> Option<Violation> {
        self.lives.borrow().iter().enumerate().find_map(|(life, recording)| {
            // One that could not even be begun is none.
            let played = if recording.bytes.is_empty() { Ok(()) } else { play(&recording.bytes) };
            let (at, what) = match (played, recording.gap) {
                (Ok(()), false) | (Err(Stopped::Refused(Refusal { why: Why::Gap(_), .. })), true) => return None,
                (Ok(()), true) => (Instant::ZERO, "it has a gap and is not refused".into()),
                (Err(Stopped::Different(at, what)), _) => (at, what),
                (Err(Stopped::Refused(refusal)), _) => (refusal.after, refusal.to_string()),
                (Err(Stopped::Unmade(why)), _) => (Instant::ZERO, why),
            };
            Some(Violation { at, rule: "replay", what: format!("{}, life {}: {what}", self.module, life + 1) })
        })
    }
}

impl Life {
    fn take(&mut self, record: &[u8], full: bool) -> bool {
        if full {
            self.missing = true;
            return false;
        }
        self.gap |= self.missing;
        self.bytes.extend_from_slice(record);
        true
    }
}

/// Why a recording was not played to its end.
enum Stopped {
    Refused(Refusal),
    Different(Instant, String),
    Unmade(String),
}

fn play(bytes: &[u8]) -> Result<(), Stopped> {
    let mut reader = Reader::open(bytes).and_then(Reader::comparable).map_err(Stopped::Refused)?;
    let shell = recording::rebuild(reader.header(), &[]).map_err(|error| Stopped::Unmade(error.to_string()))?;
    let mut player = Player::new(shell);
    while let Some(item) = reader.read().map_err(Stopped::Refused)? {
        if let Item::Record(record) = item
            && let Err(difference) = player.play(&record).map_err(Stopped::Refused)?
        {
            let what = format!("record {}, on {}: {:?}", difference.record, difference.call, difference.first);
            return Err(Stopped::Different(difference.at, what));
        }
    }
    Ok(())
}
