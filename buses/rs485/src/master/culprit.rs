//! Detection of devices that disturb the bus: received frames are compared with requests.
//!
//! Each attempt at a request allows one answer, and no more words than that answer may have. What comes beyond is
//! surplus, and the address in it names who sent it:
//!
//! - *Babble*: [`FRAMES`] whole frames, right CRC, from one address that owes none; or more surplus words in a second
//!   than the longest frame has, and then nobody can be named.
//! - *Clash*: time and again an attempt brings the node's address twice, once more than asked, and never else: two
//!   answer. Or [`RUN`] attempts in a row end in damage while the other nodes' answers are clean: two talk at once, or
//!   one's transmitter is bad.
//!
//! What physics does not allow to tell: who sends words that are no frames; who uses another's address; two devices
//! that answer in step and alike (nobody hears them), or that answer each other (they babble under their one address);
//! two devices of one address from one that answers twice; a line held by a stuck driver from one that is cut: both are
//! silent, all nodes on it get lost.

use super::{EVENTS, Event, NODES_MAX};
use crate::frame::{MAX_WORDS, Status};
use base::serial::Word;
use base::{Duration, Instant, Queue};
use heapless::Vec;

/// Surplus is forgotten after so much time without any.
const MEMORY: Duration = Duration::from_secs(1);
/// Surplus frames of one address that are babble. Noise makes one in 256 damaged frames look right.
const FRAMES: u8 = 4;
/// Late answers that are waited for.
const OWED: u8 = 3;
/// Attempts, more with two answers than with one, that are a clash; most that are remembered.
const TWINS: u8 = 4;
const TWINS_MAX: u8 = 8;
/// Damaged attempts in a row that count as a clash, while the answers of other nodes are clean: at least this number of
/// good ones, and this multiple of the damaged ones.
const RUN: u8 = 16;
const CLEAN: u32 = 8;

/// Observations of one address.
#[derive(Clone, Copy, Debug)]
struct Talker {
    address: u8,
    /// Answers that may still come.
    owed: u8,
    /// Surplus frames, and when the last one came.
    frames: u8,
    last: Instant,
    babbles: bool,
    /// Attempts with two answers, less those with one.
    twins: u8,
    /// Damaged attempts in a row; answers of all nodes, good and damaged, before the first of them.
    run: u8,
    before: (u32, u32),
    clashes: bool,
}

impl Talker {
    const fn new(address: u8) -> Self {
        Self {
            address,
            owed: 0,
            frames: 0,
            last: Instant::ZERO,
            babbles: false,
            twins: 0,
            run: 0,
            before: (0, 0),
            clashes: false,
        }
    }
}

/// The attempt that was sent last.
#[derive(Clone, Copy, Debug)]
struct Asked {
    to: u8,
    /// Address words of the node beyond what it owed.
    surplus: u8,
    answered: bool,
}

#[derive(Debug)]
pub(super) struct Watch {
    talkers: Vec<Talker, NODES_MAX>,
    /// Last address that belongs to no node.
    stranger: Talker,
    asked: Option<Asked>,
    /// True if the last address word was owed.
    owed: bool,
    /// Words that may still come.
    owed_words: usize,
    surplus_words: usize,
    /// Start of the count of surplus words, and instant of the last one.
    since: Instant,
    last: Instant,
    babbles: bool,
    good: u32,
    damaged: u32,
}

type Events = Queue<Event, EVENTS>;

impl Watch {
    pub(super) const fn new() -> Self {
        Self {
            talkers: Vec::new(),
            stranger: Talker::new(0),
            asked: None,
            owed: false,
            owed_words: 0,
            surplus_words: 0,
            since: Instant::ZERO,
            last: Instant::ZERO,
            babbles: false,
            good: 0,
            damaged: 0,
        }
    }

    pub(super) fn add(&mut self, address: u8) {
        // Cannot fail: its capacity is the master's number of nodes.
        let _ = self.talkers.push(Talker::new(address));
    }

    /// An attempt goes out; its answer has at most `words` words, none when it is not answered.
    pub(super) fn on_sent(&mut self, now: Instant, to: u8, words: Option<usize>, events: &mut Events) {
        self.judge_twins(events);
        self.forget(now, events);
        self.asked = None;
        if let Some(words) = words {
            let talker = self.talker(to);
            talker.owed = (talker.owed + 1).min(OWED);
            self.owed_words = (self.owed_words + words).min(MAX_WORDS * usize::from(OWED));
            self.asked = Some(Asked { to, surplus: 0, answered: false });
        }
    }

    /// True when the word is surplus.
    pub(super) fn on_word(&mut self, now: Instant, word: Word, events: &mut Events) -> bool {
        if word.ninth {
            let talker = self.talker(word.byte);
            self.owed = talker.owed > 0;
            let talker = self.talker(word.byte);
            talker.owed = talker.owed.saturating_sub(1);
            if let Some(asked) = self.asked.as_mut().filter(|asked| asked.to == word.byte && !self.owed) {
                asked.surplus = asked.surplus.saturating_add(1);
            }
        }
        if self.owed_words > 0 {
            self.owed_words -= 1;
            return false;
        }
        self.forget(now, events);
        if now.since(self.since) > MEMORY {
            (self.since, self.surplus_words) = (now, 0);
        }
        self.surplus_words += 1;
        self.last = now;
        let named = self.talkers.iter().chain([&self.stranger]).any(|talker| talker.babbles);
        if self.surplus_words > MAX_WORDS && !named && !self.babbles {
            self.babbles = tell(events, Event::Babble { who: None });
        }
        true
    }

    /// A frame with a right CRC that is no answer to what was asked, or not the first.
    pub(super) fn on_stray(&mut self, now: Instant, address: u8, status: u8, waiting: bool, events: &mut Events) {
        // A node whose neighbour was asked, by an address damaged on the way, finds the CRC wrong.
        let misread = waiting && status == Status::BadCrc as u8;
        let twin = self.asked.is_some_and(|asked| asked.to == address && asked.surplus <= 1);
        if self.owed || misread || twin {
            return;
        }
        let talker = self.talker(address);
        talker.frames = if now.since(talker.last) > MEMORY { 1 } else { talker.frames.saturating_add(1) };
        talker.last = now;
        talker.twins = 0;
        if talker.frames >= FRAMES && !talker.babbles {
            talker.babbles = tell(events, Event::Babble { who: Some(address) });
        }
    }

    /// A frame came that a node may send unasked: its words were allowed.
    pub(super) fn on_unasked(&mut self, words: usize) {
        self.owed_words = (self.owed_words + words).min(MAX_WORDS * usize::from(OWED));
    }

    pub(super) fn on_good(&mut self, node: u8, events: &mut Events) {
        self.good = self.good.wrapping_add(1);
        if let Some(asked) = &mut self.asked {
            asked.answered = true;
        }
        let talker = self.talker(node);
        talker.run = 0;
        if talker.clashes && talker.twins == 0 {
            talker.clashes = !tell(events, Event::ClashOver { node });
        }
    }

    pub(super) fn on_damaged(&mut self, node: u8, events: &mut Events) {
        let now = (self.good, self.damaged);
        self.damaged = self.damaged.wrapping_add(1);
        let explained = self.babbles || self.talkers.iter().chain([&self.stranger]).any(|talker| talker.babbles);
        let talker = self.talker(node);
        if talker.run == 0 {
            talker.before = now;
        }
        let own = u32::from(talker.run);
        talker.run = talker.run.saturating_add(1);
        let good = now.0.wrapping_sub(talker.before.0);
        let damaged = now.1.wrapping_sub(talker.before.1).saturating_sub(own);
        let clean = good >= u32::from(RUN) && damaged.saturating_mul(CLEAN) <= good;
        if talker.run >= RUN && clean && !explained && !talker.clashes {
            talker.clashes = tell(events, Event::Clash { node, certain: false });
        }
    }

    /// A node found the CRC of a request wrong: the wire is not clean.
    pub(super) fn on_misread(&mut self) {
        self.damaged = self.damaged.wrapping_add(1);
    }

    /// The transaction was cancelled: its result is not attributed.
    pub(super) fn on_cancel(&mut self) {
        self.asked = None;
        self.owed_words = MAX_WORDS * usize::from(OWED);
    }

    /// Evaluates the previous attempt: one answer, or two.
    fn judge_twins(&mut self, events: &mut Events) {
        let Some(Asked { to, surplus, answered }) = self.asked else {
            return;
        };
        let talker = self.talker(to);
        match surplus {
            0 if answered => talker.twins = talker.twins.saturating_sub(1),
            1 => talker.twins = (talker.twins + 1).min(TWINS_MAX),
            _ => {}
        }
        if talker.twins >= TWINS && !talker.clashes {
            talker.clashes = tell(events, Event::Clash { node: to, certain: true });
        }
    }

    /// Reports devices whose babble has ended.
    fn forget(&mut self, now: Instant, events: &mut Events) {
        if self.babbles && now.since(self.last) > MEMORY {
            self.babbles = !tell(events, Event::BabbleOver { who: None });
        }
        for talker in self.talkers.iter_mut().chain([&mut self.stranger]) {
            if talker.babbles && now.since(talker.last) > MEMORY {
                talker.babbles = !tell(events, Event::BabbleOver { who: Some(talker.address) });
            }
        }
    }

    fn talker(&mut self, address: u8) -> &mut Talker {
        if let Some(index) = self.talkers.iter().position(|talker| talker.address == address) {
            return &mut self.talkers[index];
        }
        if self.stranger.address != address && !self.stranger.babbles {
            self.stranger = Talker::new(address);
        }
        &mut self.stranger
    }
}

/// Half of the queue is reserved for results of transactions; an event without room is reported later.
fn tell(events: &mut Events, event: Event) -> bool {
    events.len() < EVENTS / 2 && events.push(event)
}
