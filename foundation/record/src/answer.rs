//! Encoding of a shell's answer: its actions and its next deadline.

use super::call::{before, since};
use super::wire::{self, Decoder};
use super::{Malformed, auxiliary, level, report, state, store, take_level, take_message, take_report, take_state};
use base::{Instant, Level};
use messages::Message;
use module::{Action, Condition, Output, PortId, ProcessCommand};

// The first byte of each action. Numbers are never reused.
const PUBLISH: u8 = 1;
const SEND_CAN: u8 = 2;
const SEND_WORDS: u8 = 3;
const RAISE: u8 = 4;
const CLEAR: u8 = 5;
const REPORT: u8 = 6;
const NOTE: u8 = 7;
const WORKING: u8 = 8;
const FAILED: u8 = 9;
const SPAWN: u8 = 10;
const TERMINATE: u8 = 11;
const KILL: u8 = 12;
const REMEMBER: u8 = 13;
const HEALTH: u8 = 14;
const RUN: u8 = 15;
const STATE: u8 = 16;
const EXIT: u8 = 17;
const SEND_I2C: u8 = 18;
const SEND_I2C_ANSWER: u8 = 19;
const SEND_ONE_WIRE: u8 = 20;
const SEND_ONE_WIRE_IS: u8 = 21;
const SEND_GAMEPAD: u8 = 22;
const SEND_STORE: u8 = 23;
// A text of another level than INFO, which is `NOTE`.
const TEXT: u8 = 24;
const SEND_GPIO: u8 = 25;
const SEND_THERMAL: u8 = 26;
const SEND_THERMAL_IS: u8 = 27;

// Next deadline: unchanged, none, or at an instant.
const SAME: u8 = 0;
const NEVER: u8 = 1;
const AT: u8 = 2;

/// Answer of a shell to one call.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Its actions, in order.
    pub actions: Vec<Action>,
    /// Next deadline; `None`: unchanged.
    pub wake: Option<Option<Instant>>,
}

/// Appends an answer; `wake` is `None` if unchanged.
pub(super) fn put(out: &mut Vec<u8>, now: Instant, actions: &[Action], wake: Option<Option<Instant>>) {
    wire::varint(out, actions.len() as u64);
    for action in actions {
        put_action(out, action);
    }
    match wake {
        None => out.push(SAME),
        Some(None) => out.push(NEVER),
        Some(Some(at)) => {
            out.push(AT);
            wire::signed(out, since(at, now));
        }
    }
}

/// Appends an action.
pub(super) fn put_action(out: &mut Vec<u8>, action: &Action) {
    match action {
        Action::Publish(message) => put_publish(out, message),
        Action::Send(PortId(port), Output::Can(frame)) => {
            out.extend([SEND_CAN, *port]);
            super::frame(out, frame);
        }
        Action::Send(PortId(port), Output::Words(words)) => {
            out.extend([SEND_WORDS, *port]);
            super::words(out, words);
        }
        Action::Send(PortId(port), Output::I2c(transfer)) => {
            out.extend([SEND_I2C, *port]);
            auxiliary::transfer(out, transfer);
        }
        Action::Send(PortId(port), Output::I2cAnswer(outcome)) => {
            out.extend([SEND_I2C_ANSWER, *port]);
            auxiliary::outcome(out, outcome);
        }
        Action::Send(PortId(port), Output::OneWire(request)) => {
            out.extend([SEND_ONE_WIRE, *port]);
            auxiliary::request(out, *request);
        }
        Action::Send(PortId(port), Output::OneWireState(answer)) => {
            out.extend([SEND_ONE_WIRE_IS, *port]);
            auxiliary::answer(out, answer);
        }
        Action::Send(PortId(port), Output::Thermal) => out.extend([SEND_THERMAL, *port]),
        Action::Send(PortId(port), Output::ThermalState(state)) => {
            out.extend([SEND_THERMAL_IS, *port]);
            auxiliary::thermal(out, state);
        }
        Action::Send(PortId(port), Output::Gamepad(event)) => {
            out.extend([SEND_GAMEPAD, *port]);
            super::gamepad(out, event.as_input());
        }
        Action::Send(PortId(port), Output::Gpio(signal)) => out.extend([SEND_GPIO, *port, signal.to_byte()]),
        Action::Send(PortId(port), Output::Store(request)) => {
            out.extend([SEND_STORE, *port]);
            store::request(out, request);
        }
        Action::Raise(about) => {
            out.push(RAISE);
            report(out, about);
        }
        Action::Clear(about) => {
            out.push(CLEAR);
            report(out, about);
        }
        Action::Report(about) => {
            out.push(REPORT);
            report(out, about);
        }
        Action::Note(Level::Info, line) => {
            out.push(NOTE);
            wire::text(out, line);
        }
        Action::Note(other, line) => {
            out.push(TEXT);
            level(out, *other);
            wire::text(out, line);
        }
        Action::Condition(Condition::Working) => out.push(WORKING),
        Action::Condition(Condition::Failed) => out.push(FAILED),
        Action::Process(command) => put_command(out, command),
        Action::Run(command) => {
            out.push(RUN);
            wire::varint(out, command.len() as u64);
            command.iter().for_each(|word| wire::text(out, word));
        }
        Action::State(to) => {
            out.push(STATE);
            state(out, *to);
        }
        Action::Exit(code) => out.extend([EXIT, *code]),
    }
}

/// A message that LCM cannot encode is replaced by the host's text about it.
fn put_publish(out: &mut Vec<u8>, message: &Message) {
    let begin = out.len();
    out.push(PUBLISH);
    if let Err(error) = super::try_message(out, message) {
        out.truncate(begin);
        out.push(NOTE);
        wire::text(out, &format!("{} cannot be sent: {error}", message.channel_name()));
    }
}

fn put_command(out: &mut Vec<u8>, command: &ProcessCommand) {
    match command {
        ProcessCommand::Spawn { module, wanted } => {
            out.push(SPAWN);
            state(out, *wanted);
            wire::text(out, module);
        }
        ProcessCommand::Terminate { pid } => {
            out.push(TERMINATE);
            wire::varint(out, (*pid).into());
        }
        ProcessCommand::Kill { pid } => {
            out.push(KILL);
            wire::varint(out, (*pid).into());
        }
        ProcessCommand::Remember { module, wanted, held } => {
            out.extend([REMEMBER, u8::from(*held)]);
            state(out, *wanted);
            wire::text(out, module);
        }
        ProcessCommand::Health { healthy, status } => {
            out.extend([HEALTH, u8::from(*healthy)]);
            wire::text(out, status);
        }
    }
}

/// Parses an answer, which must fill the rest of the record.
pub(super) fn take(mut take: Decoder<'_>, now: Instant) -> Result<Answer, Malformed> {
    let count = take.count()?;
    let mut actions = Vec::new();
    for _ in 0..count {
        actions.push(take_action(&mut take)?);
    }
    let wake = match take.u8()? {
        SAME => None,
        NEVER => Some(None),
        AT => Some(Some(before(now, take.signed()?.wrapping_neg()))),
        _ => return Err(Malformed("a moment to be woken at")),
    };
    if take.0.is_empty() { Ok(Answer { actions, wake }) } else { Err(Malformed("the end of the record")) }
}

fn take_action(take: &mut Decoder<'_>) -> Result<Action, Malformed> {
    Ok(match take.u8()? {
        PUBLISH => Action::Publish(take_message(take)?),
        SEND_CAN => Action::Send(PortId(take.u8()?), Output::Can(super::take_frame(take)?)),
        SEND_WORDS => Action::Send(PortId(take.u8()?), Output::Words(super::take_words(take)?)),
        SEND_I2C => Action::Send(PortId(take.u8()?), Output::I2c(auxiliary::take_transfer(take)?)),
        SEND_I2C_ANSWER => Action::Send(PortId(take.u8()?), Output::I2cAnswer(auxiliary::take_outcome(take)?)),
        SEND_ONE_WIRE => Action::Send(PortId(take.u8()?), Output::OneWire(auxiliary::take_request(take)?)),
        SEND_STORE => Action::Send(PortId(take.u8()?), Output::Store(store::take_request(take)?)),
        SEND_ONE_WIRE_IS => Action::Send(PortId(take.u8()?), Output::OneWireState(auxiliary::take_answer(take)?)),
        SEND_THERMAL => Action::Send(PortId(take.u8()?), Output::Thermal),
        SEND_THERMAL_IS => Action::Send(PortId(take.u8()?), Output::ThermalState(auxiliary::take_thermal(take)?)),
        SEND_GAMEPAD => Action::Send(PortId(take.u8()?), Output::Gamepad(super::take_gamepad(take)?)),
        SEND_GPIO => Action::Send(PortId(take.u8()?), Output::Gpio(super::take_signal(take)?)),
        RAISE => Action::Raise(take_report(take)?),
        CLEAR => Action::Clear(take_report(take)?),
        REPORT => Action::Report(take_report(take)?),
        NOTE => Action::Note(Level::Info, take.text()?.into()),
        TEXT => Action::Note(take_level(take)?, take.text()?.into()),
        WORKING => Action::Condition(Condition::Working),
        FAILED => Action::Condition(Condition::Failed),
        SPAWN => {
            let wanted = take_state(take)?;
            Action::Process(ProcessCommand::Spawn { module: take.text()?.into(), wanted })
        }
        TERMINATE => Action::Process(ProcessCommand::Terminate { pid: take.small()? }),
        KILL => Action::Process(ProcessCommand::Kill { pid: take.small()? }),
        REMEMBER => {
            let (held, wanted) = (take.flag()?, take_state(take)?);
            Action::Process(ProcessCommand::Remember { module: take.text()?.into(), wanted, held })
        }
        HEALTH => {
            let healthy = take.flag()?;
            Action::Process(ProcessCommand::Health { healthy, status: take.text()?.into() })
        }
        RUN => {
            let count = take.count()?;
            Action::Run((0..count).map(|_| take.text().map(String::from)).collect::<Result<_, _>>()?)
        }
        STATE => Action::State(take_state(take)?),
        EXIT => Action::Exit(take.u8()?),
        _ => return Err(Malformed("a known kind of action")),
    })
}
