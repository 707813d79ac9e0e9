//! Answers as RPLIDARs frame them, and YDLIDARs too: a descriptor, and the bytes that it announces.

use crate::engine::Shared;
use crate::rplidar::wire::{DESCRIPTOR, Descriptor, SYNC, SYNC_2};
use heapless::Vec;

/// Longest answer that is taken.
pub const ANSWER_MAX: usize = 64;

/// Takes the bytes of an answer.
#[derive(Debug, Default)]
pub struct Receiver {
    rx: Vec<u8, ANSWER_MAX>,
    descriptor: Option<Descriptor>,
}

impl Receiver {
    /// Forgets what arrived.
    pub fn clear(&mut self) {
        self.rx.clear();
        self.descriptor = None;
    }

    /// Takes a byte. The answer is complete when this returns its descriptor: at once if answers follow for ever.
    pub fn receive(&mut self, byte: u8, shared: &mut Shared) -> Option<Descriptor> {
        // There is room: the buffer is emptied before it is full.
        let _ = self.rx.push(byte);
        let Some(descriptor) = self.descriptor else {
            let is_begin = match self.rx[..] {
                [first] => first == SYNC,
                [_, second, ..] => second == SYNC_2,
                [] => true,
            };
            if !is_begin {
                let again = byte == SYNC;
                self.rx.clear();
                if again {
                    let _ = self.rx.push(byte);
                } else {
                    shared.reject();
                }
                return None;
            }
            let bytes = <&[u8; DESCRIPTOR]>::try_from(&self.rx[..]).ok()?;
            let descriptor = Descriptor::decode(bytes);
            self.rx.clear();
            let descriptor = descriptor.filter(|it| it.many || (it.len as usize) < ANSWER_MAX);
            if descriptor.is_none() {
                shared.reject();
            }
            self.descriptor = descriptor;
            return descriptor.filter(|descriptor| descriptor.many);
        };
        (self.rx.len() >= descriptor.len as usize).then_some(descriptor)
    }

    /// The answer that is complete.
    pub fn take(&mut self) -> Vec<u8, ANSWER_MAX> {
        self.descriptor = None;
        core::mem::take(&mut self.rx)
    }
}
