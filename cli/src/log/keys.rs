//! A keyboard, when stdin is a terminal.

use nix::errno::Errno;
use nix::sys::termios::{self, LocalFlags, SetArg, SpecialCharacterIndices, Termios};
use std::io::{self, IsTerminal};
use std::os::fd::{AsFd, BorrowedFd};

/// Pressed key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    Pause,
    Back,
    Forward,
    Faster,
    Slower,
    Quit,
}

/// The terminal without lines and echo, until dropped.
pub struct Keys {
    stdin: io::Stdin,
    before: Termios,
    /// The beginning of a sequence.
    rest: Vec<u8>,
}

impl Keys {
    /// `None` where stdin is no terminal, or another is in front of it.
    pub fn open() -> Option<Self> {
        let stdin = io::stdin();
        if !stdin.is_terminal() || nix::unistd::tcgetpgrp(&stdin).ok()? != nix::unistd::getpgrp() {
            return None;
        }
        let before = termios::tcgetattr(&stdin).ok()?;
        let mut raw = before.clone();
        // Ctrl-C stays a signal.
        raw.local_flags.remove(LocalFlags::ICANON | LocalFlags::ECHO);
        raw.control_chars[SpecialCharacterIndices::VMIN as usize] = 0;
        raw.control_chars[SpecialCharacterIndices::VTIME as usize] = 0;
        termios::tcsetattr(&stdin, SetArg::TCSANOW, &raw).ok()?;
        Some(Self { stdin, before, rest: Vec::new() })
    }

    pub fn fd(&self) -> BorrowedFd<'_> {
        self.stdin.as_fd()
    }

    /// Keys pressed since the last call; does not wait.
    pub fn pressed(&mut self) -> Vec<Key> {
        let mut bytes = [0; 64];
        match nix::unistd::read(&self.stdin, &mut bytes) {
            Ok(len) => self.rest.extend_from_slice(&bytes[..len]),
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            // The terminal is gone.
            Err(_) => return vec![Key::Quit],
        }
        let (keys, used) = keys(&self.rest);
        self.rest.drain(..used);
        keys
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        let _ = termios::tcsetattr(&self.stdin, SetArg::TCSANOW, &self.before);
    }
}

/// Keys, and how many bytes they are; half an arrow waits for its end.
fn keys(bytes: &[u8]) -> (Vec<Key>, usize) {
    let (mut keys, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        let (key, len) = match &bytes[at..] {
            [0x1b, b'[' | b'O', b'D', ..] => (Some(Key::Back), 3),
            [0x1b, b'[' | b'O', b'C', ..] => (Some(Key::Forward), 3),
            [0x1b] | [0x1b, b'[' | b'O'] => break,
            [0x1b, b'[' | b'O', _, ..] => (None, 3),
            [b' ', ..] => (Some(Key::Pause), 1),
            [b'+' | b'=', ..] => (Some(Key::Faster), 1),
            [b'-', ..] => (Some(Key::Slower), 1),
            [b'q' | b'Q', ..] => (Some(Key::Quit), 1),
            _ => (None, 1),
        };
        keys.extend(key);
        at += len;
    }
    (keys, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_and_arrows_are_told_apart_and_half_an_arrow_waits() {
        use Key::{Back, Faster, Forward, Pause, Quit, Slower};
        assert_eq!(keys(b" \x1b[D\x1bOC+-xq"), (vec![Pause, Back, Forward, Faster, Slower, Quit], 11));
        assert_eq!(keys(b"=\x1b["), (vec![Faster], 1));
        assert_eq!(keys(b"\x1b[A\x1b"), (vec![], 3));
    }
}
