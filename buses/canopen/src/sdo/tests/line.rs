//! A client and a server at the ends of one line, in virtual time, with somebody who may spoil frames on it.

use crate::sdo::{Client, Done, MAX_LEN, Objects, Server, TIMEOUT};
use crate::{Abort, Payload};
use base::{Duration, Instant};
use std::collections::VecDeque;
use std::vec::Vec;

pub(super) const INDEX: u16 = 0x2F00;

/// A frame on the line takes this long.
const FRAME: Duration = Duration::from_micros(130);

/// One object, 0x2F00:0, that takes up to [`MAX_LEN`] bytes.
#[derive(Default)]
pub(super) struct Store {
    pub(super) data: Vec<u8>,
    pub(super) writes: u32,
}

fn check(index: u16, sub: u8) -> Result<(), Abort> {
    match (index, sub) {
        (INDEX, 0) => Ok(()),
        (INDEX, _) => Err(Abort::NO_SUB_INDEX),
        _ => Err(Abort::NO_OBJECT),
    }
}

impl Objects for Store {
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort> {
        check(index, sub).map(|()| Payload::from(&self.data[..]))
    }

    fn check_write(&self, index: u16, sub: u8, size: Option<usize>) -> Result<Option<usize>, Abort> {
        check(index, sub)?;
        if size.is_some_and(|size| size > MAX_LEN) { Err(Abort::TOO_LONG) } else { Ok(None) }
    }

    fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort> {
        check(index, sub)?;
        (self.data, self.writes) = (data.to_vec(), self.writes + 1);
        Ok(())
    }
}

/// What becomes of a frame.
pub(super) enum Fate {
    Arrives([u8; 8]),
    Lost,
    Twice,
}

#[derive(Clone, Copy, PartialEq)]
enum To {
    Client,
    Server,
}

pub(super) struct Line {
    pub(super) now: Instant,
    pub(super) client: Client,
    pub(super) server: Server,
    pub(super) store: Store,
    /// True if all that an end has to send goes to a queue at once, or is taken as the line gets free.
    pub(super) greedy: bool,
    /// Frames sent.
    pub(super) frames: usize,
    wire: VecDeque<(Instant, To, [u8; 8])>,
}

impl Line {
    /// Blocks of `blksize` segments both ways.
    pub(super) fn new(blksize: u8) -> Self {
        Self {
            now: Instant::from_millis(1000),
            client: Client::new(TIMEOUT).with_block_size(blksize),
            server: Server::new(TIMEOUT * 4).with_block_size(blksize),
            store: Store::default(),
            greedy: false,
            frames: 0,
            wire: VecDeque::new(),
        }
    }

    fn put(&mut self, to: To, frame: [u8; 8], fate: &mut impl FnMut(usize, [u8; 8]) -> Fate) {
        let free = self.wire.back().map_or(self.now, |(at, ..)| *at);
        let arrives = match fate(self.frames, frame) {
            Fate::Arrives(frame) => [Some(frame), None],
            Fate::Lost => [None, None],
            Fate::Twice => [Some(frame); 2],
        };
        self.frames += 1;
        for (nth, frame) in (1..).zip(arrives.into_iter().flatten()) {
            self.wire.push_back((free + FRAME * nth, to, frame));
        }
    }

    fn drain(&mut self, fate: &mut impl FnMut(usize, [u8; 8]) -> Fate) {
        while self.greedy || self.wire.is_empty() {
            if let Some(frame) = self.client.poll_tx() {
                self.put(To::Server, frame, fate);
            } else if let Some(frame) = self.server.poll_tx() {
                self.put(To::Client, frame, fate);
            } else {
                return;
            }
        }
    }

    /// Lets time pass until nothing is to be done any more. Gives how the client's transfer ended.
    pub(super) fn run(&mut self, mut fate: impl FnMut(usize, [u8; 8]) -> Fate) -> Done {
        let mut done = None;
        for _ in 0..1_000_000 {
            self.drain(&mut fate);
            let ends = [self.wire.front().map(|(at, ..)| *at), self.client.poll_timeout(), self.server.poll_timeout()];
            let Some(next) = ends.into_iter().flatten().min() else {
                return done.expect("the client's transfer ended");
            };
            self.now = self.now.max(next);
            while let Some((_, to, frame)) = self.wire.pop_front_if(|(at, ..)| *at <= self.now) {
                match to {
                    To::Client => self.client.handle_rx(self.now, &frame),
                    To::Server => {
                        if let Some(answer) = self.server.handle_rx(self.now, &frame, &mut self.store) {
                            self.put(To::Client, answer, &mut fate);
                        }
                    }
                }
            }
            self.client.handle_timeout(self.now);
            if let Some(words) = self.server.handle_timeout(self.now) {
                self.put(To::Client, words, &mut fate);
            }
            done = done.or(self.client.poll_done());
            let due = [self.client.poll_timeout(), self.server.poll_timeout()];
            assert!(due.into_iter().flatten().all(|due| due > self.now), "nothing is due when all is served");
        }
        panic!("the transfer does not end");
    }

    /// A transfer that nobody spoils, or only the way `fate` says.
    pub(super) fn transfer(&mut self, write: Option<&[u8]>, fate: impl FnMut(usize, [u8; 8]) -> Fate) -> Done {
        self.frames = 0;
        let begun = match write {
            Some(data) => self.client.write_block(self.now, INDEX, 0, Payload::from(data)),
            None => self.client.read_block(self.now, INDEX, 0),
        };
        assert!(begun, "the channel is free");
        self.run(fate)
    }
}

/// Nothing happens on the way.
pub(super) fn clean(_: usize, frame: [u8; 8]) -> Fate {
    Fate::Arrives(frame)
}
