//! Requested objects of CANopen nodes, with their answers.

use crate::can::{standard, value};
use base::{Duration, Instant};
use canopen::Abort;
use canopen::dictionary::DataType;
use messages::lowlevel::{CmdSdo, DataSdo};
use std::collections::VecDeque;

/// Maximum number kept for the screen.
const KEPT: usize = 20;
/// Time limit of the driver: it reports a silent node earlier.
const PATIENCE: Duration = Duration::from_secs(5);

/// An object of a node, to be read or written.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// As `LL_CMD_SDO` names it: 1000 more for each CAN bus before its own.
    pub node: i32,
    pub index: u16,
    pub sub: u8,
    pub data_type: Option<DataType>,
    /// Data to write; `None` to read.
    pub data: Option<Vec<u8>>,
}

impl Object {
    fn name(&self) -> String {
        let name = standard::object(self.index, self.sub).map(|(name, _)| format!(" {name}")).unwrap_or_default();
        format!("node {} {}{name}", self.node, value::object(self.index, self.sub))
    }

    fn shows(&self, data: &[u8]) -> String {
        value::show(self.index, self.data_type, data).text
    }
}

#[derive(Debug)]
struct Asked {
    at: Instant,
    request: i32,
    object: Object,
    /// Instant and text of the answer; `None` while it is awaited.
    answer: Option<(Instant, String)>,
}

impl Asked {
    fn line(&self) -> String {
        let name = self.object.name();
        match &self.answer {
            None => format!("{name} ..."),
            Some((at, text)) => format!("{name} {text} ({:.0} ms)", at.since(self.at).as_secs_f64() * 1e3),
        }
    }
}

/// All requests, newest last.
#[derive(Debug, Default)]
pub struct Objects {
    asked: VecDeque<Asked>,
    count: u16,
}

impl Objects {
    /// Requests an object; returns the message, and a text for the meantime.
    pub fn ask(&mut self, now: Instant, timestamp: i64, object: Object) -> (CmdSdo, String) {
        self.count = self.count.wrapping_add(1);
        // Others number theirs, too: ours begin with our process.
        let request = ((std::process::id() & 0x7FFF) << 16 | u32::from(self.count)).cast_signed();
        let command = CmdSdo {
            timestamp,
            request,
            node: object.node,
            index: object.index.into(),
            subindex: object.sub.into(),
            write: object.data.is_some(),
            data: object.data.clone().unwrap_or_default(),
        };
        if self.asked.len() == KEPT {
            self.asked.pop_front();
        }
        let asked = Asked { at: now, request, object, answer: None };
        let said = asked.line();
        self.asked.push_back(asked);
        (command, said)
    }

    /// Takes an answer; returns its text if it is ours.
    pub fn hear(&mut self, at: Instant, answer: &DataSdo) -> Option<String> {
        let is_it = |asked: &&mut Asked| {
            let object = &asked.object;
            let heard = (answer.request, answer.node, answer.index, answer.subindex);
            asked.answer.is_none() && heard == (asked.request, object.node, object.index.into(), object.sub.into())
        };
        let asked = self.asked.iter_mut().find(is_it)?;
        let text = match (answer.abort_code, &asked.object.data) {
            (0, None) => format!("= {}", asked.object.shows(&answer.data)),
            (0, Some(data)) => format!("= {}, written", asked.object.shows(data)),
            (code, data) => {
                let abort = Abort(code as u32);
                let whose = match abort {
                    Abort::LOCAL_CONTROL if data.is_some() => ": driver_canbus lets nobody else write it",
                    Abort::DEVICE_STATE if data.is_some() => ": not while the robot moves",
                    _ => "",
                };
                format!("refused: {abort}{whose}")
            }
        };
        asked.answer = Some((at, text));
        Some(asked.line())
    }

    /// Text for requests without an answer.
    pub fn poll(&mut self, now: Instant) -> Option<String> {
        let late = |asked: &&mut Asked| asked.answer.is_none() && now.since(asked.at) >= PATIENCE;
        let asked = self.asked.iter_mut().find(late)?;
        asked.answer = Some((now, "no answer: is driver_canbus there?".into()));
        Some(asked.line())
    }

    /// For the screen, the latest first.
    pub fn lines(&self) -> impl ExactSizeIterator<Item = String> {
        self.asked.iter().rev().map(Asked::line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn status() -> Object {
        Object { node: 1, index: 0x6041, sub: 0, data_type: Some(DataType::U16), data: None }
    }

    #[test]
    fn an_answer_is_told_in_words_and_others_answers_are_not_ours() {
        let mut objects = Objects::default();
        let (asked, said) = objects.ask(at(0), 7, status());
        assert_eq!((said.as_str(), asked.node, asked.write), ("node 1 0x6041 Statusword ...", 1, false));
        let answer = DataSdo { request: asked.request, node: 1, index: 0x6041, data: vec![0x37, 2], ..<_>::default() };
        let others = [DataSdo { request: 1, ..answer.clone() }, DataSdo { node: 2, ..answer.clone() }];
        assert!(others.iter().all(|other| objects.hear(at(1), other).is_none()));
        let line = "node 1 0x6041 Statusword = 0x0237 operation enabled (4 ms)";
        assert_eq!(objects.hear(at(4), &answer).as_deref(), Some(line));
        assert_eq!(objects.hear(at(5), &answer), None, "once");
        assert_eq!(objects.lines().next().as_deref(), Some(line));
    }

    #[test]
    fn a_refusal_and_silence_are_told() {
        let mut objects = Objects::default();
        let (asked, _) = objects.ask(at(0), 7, Object { data: Some(vec![6, 0]), index: 0x6040, ..status() });
        let abort_code = i64::from(Abort::LOCAL_CONTROL.0);
        let answer = DataSdo { request: asked.request, node: 1, index: 0x6040, abort_code, ..<_>::default() };
        assert!(objects.hear(at(1), &answer).unwrap().contains("driver_canbus lets nobody else write it"));
        objects.ask(at(0), 7, status());
        assert_eq!(objects.poll(at(4999)), None);
        assert!(objects.poll(at(5000)).unwrap().contains("no answer"));
        assert_eq!(objects.poll(at(5000)), None);
        (0..100).for_each(|_| drop(objects.ask(at(0), 7, status())));
        assert_eq!(objects.lines().len(), KEPT);
    }
}
