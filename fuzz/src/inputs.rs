//! Recorded inputs of a module: reader, writer, player.

use base::{Epoch, Instant};
use record::{Header, Item, MAGIC, Player, Reader, Recorder, VERSION};
use module::{Action, Actions, Event, Input, Module, Output, Shell, ShellConfig, State};
use std::cell::RefCell;
use std::rc::Rc;

/// Sends back what it gets.
struct Echo;

impl Module for Echo {
    fn handle(&mut self, _: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => out.working(),
            Event::Message { message, .. } => out.publish(message.clone()),
            Event::Port { port, input: Input::Can { frame, .. } } => out.send_can(port, frame),
            Event::Port { port, input: Input::Words(words) } => out.send_words(port, words),
            Event::Port { port, input: Input::I2c(outcome) } => {
                out.push(Action::Send(port, Output::I2cAnswer(outcome.clone())));
            }
            Event::Port { port, input: Input::I2cRequested(transfer) } => out.transfer(port, transfer.clone()),
            Event::Port { port, input: Input::OneWire(answer) } => {
                out.push(Action::Send(port, Output::OneWireState(answer.clone())));
            }
            Event::Port { port, input: Input::Gpio(signal) } => out.push(Action::Send(port, Output::Gpio(signal))),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn shell() -> Shell {
    Shell::new(ShellConfig::new("echo"), Box::new(Echo))
}

/// A file of recorded inputs: arbitrary, or arbitrary payloads with correct checksums.
///
/// A refusal has a place in the file; what is parsed is the same after it was written again, and the same shell gives
/// the same outputs.
pub fn inputs(data: &[u8]) {
    if data.starts_with(&MAGIC) {
        return read(data);
    }
    let Some(input) = crate::input::<(bool, Vec<u8>, Vec<Vec<u8>>)>(data) else { return };
    let (raw, bytes, payloads) = input;
    let mut file = Vec::new();
    if !raw {
        file.extend(MAGIC);
        file.extend(VERSION.to_le_bytes());
        let header = [&b"\0\0\x03\0"[..]].concat();
        for (number, payload) in std::iter::once(header).chain(payloads).enumerate() {
            record(&mut file, number as u32, &payload);
        }
    }
    file.extend(&bytes);
    read(&file);
}

/// As `docs/replay.md` has it.
fn record(file: &mut Vec<u8>, number: u32, payload: &[u8]) {
    let mut len = payload.len();
    while len >= 0x80 {
        file.push(len as u8 | 0x80);
        len >>= 7;
    }
    file.push(len as u8);
    let checked = [&number.to_le_bytes()[..], payload].concat();
    file.extend(number.to_le_bytes());
    file.extend(crc32fast::hash(&checked).to_le_bytes());
    file.extend(payload);
}

fn read(file: &[u8]) {
    let mut reader = match Reader::open(file) {
        Ok(reader) => reader,
        Err(refusal) => return assert!(refusal.place <= file.len() && !refusal.to_string().is_empty()),
    };
    let mut player = Player::new(shell());
    let (again, kept) = (Rc::new(RefCell::new(Vec::new())), Rc::new(RefCell::new(Vec::new())));
    let to = again.clone();
    let header = Header { program: String::new(), module: String::new(), wanted: State::Run, texts: Vec::new() };
    let mut recorded = shell();
    recorded.record(Recorder::new(&header, 1 << 24, move |bytes| {
        to.borrow_mut().extend_from_slice(bytes);
        true
    }));
    let mut out = Actions::new(Epoch::default());
    let mut place = 0;
    loop {
        match reader.read() {
            Ok(Some(Item::Record(item))) => {
                assert!(item.place >= place && item.place < file.len());
                place = item.place;
                let _ = item.answer();
                let _ = player.play(&item);
                let _ = item.call(|call| {
                    kept.borrow_mut().push(call.to_string());
                    call.tell(&mut recorded, item.at, &mut out);
                });
                out.drain().for_each(drop);
            }
            Ok(Some(Item::End(_))) => {}
            Ok(None) => break,
            Err(refusal) => {
                assert!(refusal.place >= place && refusal.place <= file.len() && !refusal.to_string().is_empty());
                break;
            }
        }
    }
    drop(recorded);
    let again = again.borrow();
    let mut reader = Reader::open(&again).expect("what was recorded is read");
    let (mut calls, mut player) = (kept.borrow().clone().into_iter(), Player::new(shell()));
    while let Some(item) = reader.read().expect("whole") {
        if let Item::Record(record) = item {
            let ((), _) = record.call(|call| assert_eq!(Some(call.to_string()), calls.next())).expect("understood");
            assert!(player.play(&record).expect("understood").is_ok(), "the same shell, told the same");
        }
    }
}
