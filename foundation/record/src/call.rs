//! Encoding of a host's calls to a shell.

use super::wire::{self, Decoder};
use super::{Malformed, auxiliary, level, report, state, store, take_level, take_message, take_report, take_state};
use base::serial::Word;
use base::{Duration, Instant, can, gamepad};
use messages::Message;
use module::admission::{Origin, Process};
use module::{Call, Event, ExitStatus, Input, PortId, ProcessEvent};

// The first byte of each call. Numbers are never reused.
const START: u8 = 1;
const MESSAGE: u8 = 2;
const TIMER: u8 = 3;
const STATE: u8 = 4;
const UP: u8 = 5;
const DOWN: u8 = 6;
const CAN: u8 = 7;
const HEALTH: u8 = 8;
const NO_ACKNOWLEDGE: u8 = 9;
const ERRORS: u8 = 10;
const LOST: u8 = 11;
const WORDS: u8 = 12;
const SENT: u8 = 13;
const STARTED: u8 = 14;
const EARLIER: u8 = 15;
const UNSTARTABLE: u8 = 16;
const EXITED: u8 = 17;
const KILLED: u8 = 18;
const BEATING: u8 = 19;
const SILENT: u8 = 20;
const BAD_BEATS: u8 = 21;
const USAGE: u8 = 22;
const TERMINATE: u8 = 23;
const RAISE: u8 = 24;
const CLEAR: u8 = 25;
const I2C: u8 = 26;
const I2C_ASKED: u8 = 27;
const ONE_WIRE: u8 = 28;
const GAMEPAD: u8 = 29;
const HEARD: u8 = 30;
const STORE: u8 = 31;
const SAY: u8 = 32;
const CHECK_LATE: u8 = 33;
/// A frame that arrived before the call; [`CAN`] is one that arrived with it.
const CAN_EARLIER: u8 = 34;
const GPIO: u8 = 35;
/// A message with its sender; [`MESSAGE`] is one whose sender makes no difference.
const MESSAGE_FROM: u8 = 36;
const THERMAL: u8 = 37;

// Bits of the first byte of a sender.
const IS_DUE: u8 = 1;
const IS_KNOWN: u8 = 2;

/// Appends a call. Instants are encoded relative to `now`.
pub(super) fn put(out: &mut Vec<u8>, now: Instant, call: &Call<'_>) {
    match call {
        Call::Event(Event::Start) => out.push(START),
        Call::Event(Event::Message { at, from, message }) => {
            out.push(if *from == Origin::DUE { MESSAGE } else { MESSAGE_FROM });
            wire::signed(out, since(now, *at));
            if *from != Origin::DUE {
                put_origin(out, *from);
            }
            super::message(out, message);
        }
        Call::Event(Event::RawMessage { at, channel, data }) => {
            out.push(HEARD);
            wire::signed(out, since(now, *at));
            wire::text(out, channel);
            wire::bytes(out, data);
        }
        Call::Event(Event::Timer) => out.push(TIMER),
        Call::Event(Event::State(to)) => {
            out.push(STATE);
            state(out, *to);
        }
        Call::Event(Event::Port { port, input }) => put_input(out, now, *port, input),
        Call::Event(Event::Process(event)) => put_process(out, now, event),
        Call::Terminate => out.push(TERMINATE),
        Call::Raise(about) => {
            out.push(RAISE);
            report(out, about);
        }
        Call::Clear(about) => {
            out.push(CLEAR);
            report(out, about);
        }
        Call::Say(of, text) => {
            out.push(SAY);
            level(out, *of);
            wire::text(out, text);
        }
    }
}

fn put_origin(out: &mut Vec<u8>, Origin { due, process }: Origin) {
    out.push(if due { IS_DUE } else { 0 } | if process.is_some() { IS_KNOWN } else { 0 });
    if let Some(Process { pid, uid }) = process {
        wire::varint(out, pid.into());
        wire::varint(out, uid.into());
    }
}

fn take_origin(take: &mut Decoder<'_>) -> Result<Origin, Malformed> {
    let flags = take.u8()?;
    if flags & !(IS_DUE | IS_KNOWN) != 0 {
        return Err(Malformed("a sender"));
    }
    let process = if flags & IS_KNOWN == 0 { None } else { Some(Process { pid: take.small()?, uid: take.small()? }) };
    Ok(Origin { due: flags & IS_DUE != 0, process })
}

fn put_input(out: &mut Vec<u8>, now: Instant, PortId(port): PortId, input: &Input<'_>) {
    match input {
        Input::Up => out.extend([UP, port]),
        Input::Down(why) => {
            out.extend([DOWN, port]);
            wire::text(out, why);
        }
        Input::Can { frame, at } if *at == now => {
            out.extend([CAN, port]);
            super::frame(out, frame);
        }
        Input::Can { frame, at } => {
            out.extend([CAN_EARLIER, port]);
            wire::signed(out, since(now, *at));
            super::frame(out, frame);
        }
        Input::CanNotice(can::Notice::Health(health)) => {
            out.extend([HEALTH, port, health.state as u8, health.transmit_errors, health.receive_errors]);
        }
        Input::CanNotice(can::Notice::NoAcknowledge) => out.extend([NO_ACKNOWLEDGE, port]),
        Input::CanNotice(can::Notice::Errors(count)) => {
            out.extend([ERRORS, port]);
            wire::varint(out, (*count).into());
        }
        Input::CanNotice(can::Notice::Lost(count)) => {
            out.extend([LOST, port]);
            wire::varint(out, (*count).into());
        }
        Input::Words(words) => {
            out.extend([WORDS, port]);
            super::words(out, words);
        }
        Input::Sent => out.extend([SENT, port]),
        Input::I2c(outcome) => {
            out.extend([I2C, port]);
            auxiliary::outcome(out, outcome);
        }
        Input::I2cRequested(transfer) => {
            out.extend([I2C_ASKED, port]);
            auxiliary::transfer(out, transfer);
        }
        Input::OneWire(answer) => {
            out.extend([ONE_WIRE, port]);
            auxiliary::answer(out, answer);
        }
        Input::Thermal(state) => {
            out.extend([THERMAL, port]);
            auxiliary::thermal(out, state);
        }
        Input::Gamepad(input) => {
            out.extend([GAMEPAD, port]);
            super::gamepad(out, *input);
        }
        Input::Gpio(signal) => out.extend([GPIO, port, signal.to_byte()]),
        Input::Store(answer) => {
            out.extend([STORE, port]);
            store::answer(out, answer);
        }
    }
}

fn put_process(out: &mut Vec<u8>, now: Instant, event: &ProcessEvent<'_>) {
    let mut begin = |tag: u8, pid: u32| {
        out.push(tag);
        wire::varint(out, pid.into());
    };
    match *event {
        ProcessEvent::Started { module, pid } => {
            begin(STARTED, pid);
            wire::text(out, module);
        }
        ProcessEvent::Earlier { module, wanted, held, pid } => {
            begin(EARLIER, pid.unwrap_or(0));
            out.extend([u8::from(pid.is_some()), u8::from(held)]);
            state(out, wanted);
            wire::text(out, module);
        }
        ProcessEvent::Unstartable { module, reason } => {
            out.push(UNSTARTABLE);
            wire::text(out, module);
            wire::text(out, reason);
        }
        ProcessEvent::Exited { pid, status } => {
            let (tag, number) = match status {
                ExitStatus::Code(code) => (EXITED, code),
                ExitStatus::Signal(signal) => (KILLED, signal),
            };
            begin(tag, pid);
            wire::signed(out, number.into());
        }
        ProcessEvent::HeartbeatStarted { pid } => begin(BEATING, pid),
        ProcessEvent::HeartbeatLate { pid, thread, last } => {
            begin(SILENT, pid);
            wire::signed(out, since(now, last));
            wire::text(out, thread);
        }
        ProcessEvent::BadHeartbeat { pid, why } => {
            begin(BAD_BEATS, pid);
            wire::text(out, why);
        }
        ProcessEvent::CheckLate { by } => {
            out.push(CHECK_LATE);
            wire::signed(out, by.as_nanos() as i64);
        }
        ProcessEvent::Usage { pid, cpu, rss } => {
            begin(USAGE, pid);
            out.extend(cpu.to_le_bytes());
            wire::signed(out, rss);
        }
    }
}

/// Parses a call and passes it to `f`.
pub(super) fn take<T>(take: &mut Decoder<'_>, now: Instant, f: impl FnOnce(Call<'_>) -> T) -> Result<T, Malformed> {
    let tag = take.u8()?;
    let event = match tag {
        START => Event::Start,
        TIMER => Event::Timer,
        STATE => Event::State(take_state(take)?),
        MESSAGE | MESSAGE_FROM => {
            let at = before(now, take.signed()?);
            let from = if tag == MESSAGE { Origin::DUE } else { take_origin(take)? };
            let message: Message = take_message(take)?;
            return Ok(f(Call::Event(Event::Message { at, from, message: &message })));
        }
        WORDS => {
            let port = PortId(take.u8()?);
            let words: Vec<Word> = super::take_words(take)?;
            return Ok(f(Call::Event(Event::Port { port, input: Input::Words(&words) })));
        }
        I2C => {
            let (port, outcome) = (PortId(take.u8()?), auxiliary::take_outcome(take)?);
            return Ok(f(Call::Event(Event::Port { port, input: Input::I2c(&outcome) })));
        }
        I2C_ASKED => {
            let (port, transfer) = (PortId(take.u8()?), auxiliary::take_transfer(take)?);
            return Ok(f(Call::Event(Event::Port { port, input: Input::I2cRequested(&transfer) })));
        }
        ONE_WIRE => {
            let (port, answer) = (PortId(take.u8()?), auxiliary::take_answer(take)?);
            return Ok(f(Call::Event(Event::Port { port, input: Input::OneWire(&answer) })));
        }
        THERMAL => {
            let (port, state) = (PortId(take.u8()?), auxiliary::take_thermal(take)?);
            return Ok(f(Call::Event(Event::Port { port, input: Input::Thermal(&state) })));
        }
        GAMEPAD => {
            let port = PortId(take.u8()?);
            let told: gamepad::Event = super::take_gamepad(take)?;
            return Ok(f(Call::Event(Event::Port { port, input: Input::Gamepad(told.as_input()) })));
        }
        STORE => {
            let (port, answer) = (PortId(take.u8()?), store::take_answer(take)?);
            return Ok(f(Call::Event(Event::Port { port, input: Input::Store(&answer) })));
        }
        HEARD => {
            let at = before(now, take.signed()?);
            Event::RawMessage { at, channel: take.text()?, data: take.bytes()? }
        }
        UP..=SENT | CAN_EARLIER | GPIO => Event::Port { port: PortId(take.u8()?), input: take_input(tag, take, now)? },
        STARTED..=USAGE => Event::Process(take_process(tag, take, now)?),
        CHECK_LATE => {
            Event::Process(ProcessEvent::CheckLate { by: Duration::from_nanos(take.signed()?.unsigned_abs()) })
        }
        TERMINATE => return Ok(f(Call::Terminate)),
        RAISE => return Ok(f(Call::Raise(&take_report(take)?))),
        CLEAR => return Ok(f(Call::Clear(&take_report(take)?))),
        SAY => return Ok(f(Call::Say(take_level(take)?, take.text()?))),
        _ => return Err(Malformed("a known kind of call")),
    };
    Ok(f(Call::Event(event)))
}

fn take_input<'a>(tag: u8, take: &mut Decoder<'a>, now: Instant) -> Result<Input<'a>, Malformed> {
    Ok(match tag {
        UP => Input::Up,
        DOWN => Input::Down(take.text()?),
        CAN => Input::Can { at: now, frame: super::take_frame(take)? },
        CAN_EARLIER => Input::Can { at: before(now, take.signed()?), frame: super::take_frame(take)? },
        HEALTH => Input::CanNotice(can::Notice::Health(can::Health {
            state: match take.u8()? {
                0 => can::BusState::Active,
                1 => can::BusState::Warning,
                2 => can::BusState::Passive,
                3 => can::BusState::Off,
                _ => return Err(Malformed("a state of a CAN controller")),
            },
            transmit_errors: take.u8()?,
            receive_errors: take.u8()?,
        })),
        NO_ACKNOWLEDGE => Input::CanNotice(can::Notice::NoAcknowledge),
        ERRORS => Input::CanNotice(can::Notice::Errors(take.small()?)),
        LOST => Input::CanNotice(can::Notice::Lost(take.small()?)),
        SENT => Input::Sent,
        GPIO => Input::Gpio(super::take_signal(take)?),
        _ => return Err(Malformed("a known input")),
    })
}

fn take_process<'a>(tag: u8, take: &mut Decoder<'a>, now: Instant) -> Result<ProcessEvent<'a>, Malformed> {
    if tag == UNSTARTABLE {
        return Ok(ProcessEvent::Unstartable { module: take.text()?, reason: take.text()? });
    }
    let pid = take.small()?;
    Ok(match tag {
        STARTED => ProcessEvent::Started { pid, module: take.text()? },
        EARLIER => {
            let (lives, held) = (take.flag()?, take.flag()?);
            let (wanted, module) = (take_state(take)?, take.text()?);
            ProcessEvent::Earlier { module, wanted, held, pid: lives.then_some(pid) }
        }
        EXITED => ProcessEvent::Exited { pid, status: ExitStatus::Code(take_i32(take)?) },
        KILLED => ProcessEvent::Exited { pid, status: ExitStatus::Signal(take_i32(take)?) },
        BEATING => ProcessEvent::HeartbeatStarted { pid },
        SILENT => ProcessEvent::HeartbeatLate { pid, last: before(now, take.signed()?), thread: take.text()? },
        BAD_BEATS => ProcessEvent::BadHeartbeat { pid, why: take.text()? },
        USAGE => ProcessEvent::Usage { pid, cpu: take.f64()?, rss: take.signed()? },
        _ => return Err(Malformed("a known kind of news")),
    })
}

fn take_i32(take: &mut Decoder<'_>) -> Result<i32, Malformed> {
    i32::try_from(take.signed()?).map_err(|_| Malformed("a number in its range"))
}

/// Time from `at` to `now`, ns; valid for any two instants.
pub(super) fn since(now: Instant, at: Instant) -> i64 {
    now.as_nanos().wrapping_sub(at.as_nanos()) as i64
}

/// Instant that is `since` ns before `now`.
pub(super) fn before(now: Instant, since: i64) -> Instant {
    Instant::from_nanos(now.as_nanos().wrapping_sub(since as u64))
}
