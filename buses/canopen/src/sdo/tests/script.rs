//! One end of a transfer, and a script of what it hears, what it says, and how time passes.

use super::line::Store;
use crate::sdo::{Client, Server};
use base::{Duration, Instant};
use std::borrow::ToOwned;
use std::format;
use std::string::String;
use std::vec::Vec;

/// An end of a transfer, as a script sees it.
pub(super) trait Side {
    fn hears(&mut self, now: Instant, frame: [u8; 8]) -> Option<[u8; 8]>;
    fn says(&mut self) -> Option<[u8; 8]>;
    fn timer(&mut self, now: Instant) -> Option<[u8; 8]>;
    /// News at the end of a step, as text.
    fn tells(&mut self) -> Option<String>;
}

impl Side for Client {
    fn hears(&mut self, now: Instant, frame: [u8; 8]) -> Option<[u8; 8]> {
        self.handle_rx(now, &frame);
        None
    }

    fn says(&mut self) -> Option<[u8; 8]> {
        self.poll_tx()
    }

    fn timer(&mut self, now: Instant) -> Option<[u8; 8]> {
        self.handle_timeout(now);
        None
    }

    fn tells(&mut self) -> Option<String> {
        Some(match self.poll_done()?.result {
            Ok(data) => format!("done {}", core::str::from_utf8(&data).unwrap()).trim().to_owned(),
            Err(error) => format!("failed {error}"),
        })
    }
}

pub(super) struct Node {
    pub(super) server: Server,
    pub(super) store: Store,
    pub(super) told: u32,
}

impl Side for Node {
    fn hears(&mut self, now: Instant, frame: [u8; 8]) -> Option<[u8; 8]> {
        self.server.handle_rx(now, &frame, &mut self.store)
    }

    fn says(&mut self) -> Option<[u8; 8]> {
        self.server.poll_tx()
    }

    fn timer(&mut self, now: Instant) -> Option<[u8; 8]> {
        self.server.handle_timeout(now)
    }

    fn tells(&mut self) -> Option<String> {
        let written = self.store.writes > self.told;
        self.told = self.store.writes;
        written.then(|| format!("written {}", core::str::from_utf8(&self.store.data).unwrap()))
    }
}

pub(super) fn hex(text: &str) -> [u8; 8] {
    let mut frame = [0; 8];
    for (at, word) in text.split_whitespace().enumerate() {
        frame[at] = u8::from_str_radix(word, 16).unwrap();
    }
    frame
}

/// `> frame` arrives; `< frame` and other lines are what the side says; `+ ms` lets time pass. Zeros at the end of
/// a frame, and what stands behind `#`, are left out.
pub(super) fn check(mut side: impl Side, script: &str) {
    let (mut now, mut expected, mut seen) = (Instant::from_millis(1000), Vec::new(), Vec::new());
    let lines = script.lines().map(|line| line.split('#').next().unwrap_or("").trim()).filter(|line| !line.is_empty());
    for line in ["+ 0"].into_iter().chain(lines) {
        let answer = match line.split_at(1) {
            (">", frame) => side.hears(now, hex(frame)),
            ("+", ms) => {
                now += Duration::from_millis(ms.trim().parse().unwrap());
                side.timer(now)
            }
            ("<", frame) => {
                expected.push(format!("< {:02X?}", hex(frame)));
                continue;
            }
            _ => {
                expected.push(line.to_owned());
                continue;
            }
        };
        expected.push(line.to_owned());
        seen.push(line.to_owned());
        seen.extend(
            answer.into_iter().chain(core::iter::from_fn(|| side.says())).map(|frame| format!("< {frame:02X?}")),
        );
        seen.extend(side.tells());
    }
    assert_eq!(seen.join("\n"), expected.join("\n"));
}
