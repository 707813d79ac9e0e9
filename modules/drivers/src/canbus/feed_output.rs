//! Digital output that feeds the motors: a second way to stop that does not depend on the drive.
//!
//! An output of a CANopen node, or a GPIO line. It is read all the time, so that it is known in advance whether it
//! answers, and whether the motors are fed. An output that was cut, by this process or an earlier one, stays so until a
//! person switches it on.

mod line;
mod node;

pub use line::GpioConfig;
pub use node::OutputConfig;

use base::gpio::Signal;
use base::{Duration, Instant};
use canopen::Master;
use canopen::master::Ticket;
use messages::Hold;
use module::{Action, Actions, Input, Output, PortId};
use node::NodeOutput;

/// Period of reading, and of repeating an order that was not acknowledged.
const PERIOD: Duration = Duration::from_millis(400);
/// Age of the last answer from which the output counts as lost: three answers are missing.
pub(super) const ANSWER_AGE_MAX: Duration = Duration::from_millis(1200);

/// News of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum News {
    /// It does not answer, or does not obey.
    Lost,
    /// It answers again.
    Back,
}

/// How the output is reached.
#[derive(Debug)]
enum Place {
    /// By the CAN bus.
    Node(NodeOutput),
    /// By a port; with the reason why that is down, until the line answers again.
    Line(PortId, Option<String>),
}

/// The output.
#[derive(Debug)]
pub(super) struct FeedOutput {
    place: Place,
    /// Value with which the motors are fed, and the one that cuts their feed.
    on: u32,
    cut: u32,
    /// Value as it was last read, or written and acknowledged.
    value: Option<u32>,
    /// Value to be written, until the output has it.
    order: Option<u32>,
    /// Time of the last answer that was not against an order, or of the start.
    answered: Instant,
    due: Instant,
    lost: bool,
}

impl FeedOutput {
    /// The output of a node.
    pub(super) fn node(config: OutputConfig) -> Self {
        Self::new(Place::Node(NodeOutput::new(config)), config.on, config.cut)
    }

    /// The line at a port: active while the motors are fed.
    pub(super) fn line(port: PortId) -> Self {
        Self::new(Place::Line(port, None), 1, 0)
    }

    fn new(place: Place, on: u32, cut: u32) -> Self {
        let (answered, due) = (Instant::ZERO, Instant::ZERO);
        Self { place, on, cut, value: None, order: None, answered, due, lost: false }
    }

    /// Starts its time limits.
    pub(super) fn start(&mut self, now: Instant) {
        (self.answered, self.due) = (now, now);
    }

    /// Its node, if it is one's.
    pub(super) fn node_id(&self) -> Option<u8> {
        if let Place::Node(node) = &self.place { Some(node.config.node) } else { None }
    }

    /// True if the motors are known not to be fed.
    pub(super) fn is_off(&self) -> bool {
        self.value.is_some_and(|value| value != self.on)
    }

    /// Objection to any motion: the output does not answer, or it does not feed the motors.
    pub(super) fn objection(&self) -> Option<Hold> {
        match self.value {
            Some(_) if self.lost => Some(Hold::SecondWayLost),
            Some(_) => self.is_off().then_some(Hold::FeedOff),
            None => Some(Hold::SecondWayLost),
        }
    }

    /// State of the output that was just reported, for people.
    pub(super) fn words(&self, news: News) -> String {
        match (&self.place, news) {
            (Place::Node(node), News::Lost) => format!(
                "node {}, whose output cuts the motors' feed, does not answer or refuses: the robot stops",
                node.config.node
            ),
            (Place::Node(node), News::Back) => {
                format!("node {} answers: the motors' feed can be cut", node.config.node)
            }
            (Place::Line(_, Some(why)), News::Lost) => {
                format!("the GPIO line that cuts the motors' feed is down: {why}; the robot stops")
            }
            (Place::Line(..), News::Lost) => {
                "the GPIO line that cuts the motors' feed does not answer or obey: the robot stops".into()
            }
            (Place::Line(..), News::Back) => "the GPIO line answers: the motors' feed can be cut".into(),
        }
    }

    /// Cuts the motors' feed, or switches it on: written at once, and again until the output has that value. False: an
    /// output that does not answer is not switched on, since nobody knows when it would be.
    pub(super) fn order(&mut self, now: Instant, on: bool) -> bool {
        if on && self.is_lost(now) {
            return false;
        }
        self.order = Some(if on { self.on } else { self.cut });
        self.due = now;
        if let Place::Node(node) = &mut self.place {
            node.drop_read();
        }
        true
    }

    /// True if the port is down, or no answer came for [`ANSWER_AGE_MAX`].
    fn is_lost(&self, now: Instant) -> bool {
        matches!(self.place, Place::Line(_, Some(_))) || now.since(self.answered) >= ANSWER_AGE_MAX
    }

    /// Does what is due; `up`: the CAN bus is up; `cut`: the feed must be cut.
    pub(super) fn advance(
        &mut self,
        now: Instant,
        up: bool,
        cut: bool,
        master: &mut Master,
        out: &mut Actions,
    ) -> Option<News> {
        if cut && self.order.is_none() && self.value.is_some_and(|value| value != self.cut) {
            self.order(now, false);
        }
        let lost = self.is_lost(now);
        if lost && self.order == Some(self.on) {
            // The order may be on its way, and be obeyed when the person who gave it has gone: a cut follows it.
            self.order(now, false);
        }
        let free = if let Place::Node(node) = &mut self.place { node.expire(now) } else { true };
        if free && self.due <= now {
            self.due = now + PERIOD;
            match &mut self.place {
                Place::Node(node) if up => node.request(now, self.order, master),
                Place::Node(_) => {}
                Place::Line(port, _) => {
                    let signal = self.order.map_or(Signal::Read, |value| Signal::Level(value == self.on));
                    out.push(Action::Send(*port, Output::Gpio(signal)));
                }
            }
        }
        let changed = std::mem::replace(&mut self.lost, lost) != lost;
        changed.then_some(if lost { News::Lost } else { News::Back })
    }

    /// A transfer has ended, with its data unless it failed; false if it does not concern this output.
    pub(super) fn on_sdo(&mut self, now: Instant, ticket: Ticket, result: Option<&[u8]>) -> bool {
        let Place::Node(node) = &mut self.place else { return false };
        let Some(value) = node.on_sdo(ticket, result) else { return false };
        if let Some(value) = value {
            self.on_value(now, value);
            // One that was given meanwhile.
            if self.order.is_some() {
                (self.due, self.answered) = (now, now);
            }
        }
        true
    }

    /// An input of the line's port; false if it is another port's.
    pub(super) fn on_port(&mut self, now: Instant, from: PortId, input: &Input<'_>) -> bool {
        let Place::Line(port, down) = &mut self.place else { return false };
        if *port != from {
            return false;
        }
        match input {
            // After a failure it is asked in its period.
            Input::Up if down.is_none() => self.due = now,
            Input::Down(why) => {
                *down = Some((*why).into());
                self.value = None;
            }
            Input::Gpio(Signal::Level(active)) => {
                *down = None;
                let value = if *active { self.on } else { self.cut };
                self.on_value(now, value);
            }
            _ => {}
        }
        true
    }

    fn on_value(&mut self, now: Instant, value: u32) {
        self.value = Some(value);
        self.order.take_if(|order| *order == value);
        if self.order.is_none() {
            self.answered = now;
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let lost = (!self.lost).then_some(self.answered + ANSWER_AGE_MAX);
        let pending = if let Place::Node(node) = &self.place { node.poll_timeout() } else { None };
        let next = pending.unwrap_or(self.due);
        Some(lost.map_or(next, |lost| lost.min(next)))
    }
}
