//! One action as its commander sees it: what is to be sent, and what becomes of it. Without bus and clock.

use base::{Duration, Instant};
use messages::action::{ANSWER, ActionStatus, REPEAT, SILENCE, check_status, progress};
use messages::highlevel::{CmdAction, DataAction};

/// What became of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Its module has reported an end.
    Reported(ActionStatus),
    /// Nobody has answered.
    Unanswered,
    /// Its module has answered, and was then silent.
    Silent,
}

/// A command or a cancel, repeated until it is answered, and the statuses after that.
#[derive(Debug)]
pub struct Order {
    /// What is sent.
    command: CmdAction,
    /// Since when an answer is waited for.
    asked: Instant,
    /// Time of the next transmission.
    next: Instant,
    /// Time at which the action is cancelled.
    limit: Instant,
    /// Newest status, and when it was received.
    last: Option<(Instant, ActionStatus, DataAction)>,
}

impl Order {
    /// Orders `command`, which is cancelled if it has not ended after `time`.
    pub fn new(now: Instant, command: CmdAction, time: Option<Duration>) -> Self {
        let limit = time.map_or(Instant::NEVER, |time| now + time);
        Self { command, asked: now, next: now, limit, last: None }
    }

    /// Identifier of the action.
    pub fn id(&self) -> &str {
        &self.command.id
    }

    /// Newest message about the action for people; empty before the first.
    pub fn words(&self) -> &str {
        self.last.as_ref().map_or("", |(.., data)| &data.message)
    }

    /// Cancels the action; may be repeated.
    pub fn cancel(&mut self, now: Instant) {
        if !self.command.cancel {
            (self.command.cancel, self.asked, self.next, self.limit) = (true, now, now, Instant::NEVER);
            self.command.parameters.clear();
        }
    }

    /// Takes a status; returns it if it is news of this action.
    pub fn on_status(&mut self, now: Instant, data: &DataAction) -> Option<ActionStatus> {
        let status = check_status(data).ok().filter(|_| data.id == self.command.id)?;
        match &mut self.last {
            Some((_, last, _)) if last.is_end() => None,
            Some((heard, last, _)) if status < *last => {
                *heard = now;
                None
            }
            last => {
                let is_news = last.as_ref().is_none_or(|(.., before)| is_news(before, data));
                *last = Some((now, status, data.clone()));
                is_news.then_some(status)
            }
        }
    }

    /// Message that is due for sending.
    pub fn poll(&mut self, now: Instant) -> Option<CmdAction> {
        if now >= self.limit {
            self.cancel(now);
        }
        if !self.asks() || now < self.next {
            return None;
        }
        self.next = now + REPEAT;
        Some(self.command.clone())
    }

    /// Time of the next call of [`Order::poll`] and [`Order::end`].
    pub fn timeout(&self) -> Instant {
        let next = if self.asks() { self.next } else { Instant::NEVER };
        next.min(self.limit).min(self.deadline())
    }

    /// What has become of the action; `None` while it lasts.
    pub fn end(&self, now: Instant) -> Option<End> {
        match &self.last {
            Some((_, status, _)) if status.is_end() => Some(End::Reported(*status)),
            last => (now >= self.deadline()).then_some(if last.is_some() { End::Silent } else { End::Unanswered }),
        }
    }

    /// True while the message is repeated: a command until it is answered, a cancel until the end.
    fn asks(&self) -> bool {
        self.last.as_ref().is_none_or(|(_, status, _)| self.command.cancel && !status.is_end())
    }

    /// Time by which the next status must have come.
    fn deadline(&self) -> Instant {
        self.last.as_ref().map_or(self.asked + ANSWER, |(heard, ..)| *heard + SILENCE)
    }
}

/// True if a status differs for people: in more than a small part of the progress.
pub fn is_news(before: &DataAction, data: &DataAction) -> bool {
    let tenths = |data| progress(data).map(|share| (share * 10.0) as u8);
    (before.status, &before.message, tenths(before)) != (data.status, &data.message, tenths(data))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(10_000 + millis)
    }

    fn ordered(time: Option<u64>) -> Order {
        let command = CmdAction { id: "a".into(), name: "present".into(), ..Default::default() };
        Order::new(at(0), command, time.map(Duration::from_millis))
    }

    fn said(status: i8, share: f64, message: &str) -> DataAction {
        DataAction { timestamp: 1, id: "a".into(), status, progress: share, message: message.into() }
    }

    /// Times at which messages were sent until `end`, and whether they cancel.
    fn sent(order: &mut Order, from: u64, end: u64) -> Vec<(u64, bool)> {
        let mut sent = Vec::new();
        for millis in from..end {
            if order.timeout() <= at(millis) && order.end(at(millis)).is_none() {
                sent.extend(order.poll(at(millis)).map(|message| (millis, message.cancel)));
            }
        }
        sent
    }

    #[test]
    fn a_command_is_repeated_until_it_is_answered_and_given_up_after_two_seconds() {
        let mut order = ordered(None);
        assert_eq!(sent(&mut order, 0, 1200), [(0, false), (500, false), (1000, false)]);
        assert_eq!(order.on_status(at(1200), &said(0, f64::NAN, "")), Some(ActionStatus::Accepted));
        assert!(sent(&mut order, 1200, 4000).is_empty());
        let mut order = ordered(None);
        assert_eq!(sent(&mut order, 0, 3000).len(), 4);
        assert_eq!([1999, 2000].map(|millis| order.end(at(millis))), [None, Some(End::Unanswered)]);
    }

    #[test]
    fn an_action_ends_by_its_first_end_and_by_no_status_of_another() {
        let mut order = ordered(None);
        order.poll(at(0));
        let other = DataAction { id: "b".into(), ..said(2, 1.0, "") };
        assert_eq!(order.on_status(at(10), &other), None);
        assert_eq!(order.on_status(at(10), &said(99, 1.0, "")), None);
        assert_eq!(order.on_status(at(20), &said(1, 0.0, "begins")), Some(ActionStatus::Running));
        assert_eq!(order.on_status(at(30), &said(1, 0.04, "begins")), None, "no news");
        assert_eq!(order.on_status(at(30), &said(0, 0.04, "late")), None, "a status never goes back");
        assert_eq!(order.on_status(at(40), &said(1, 0.5, "begins")), Some(ActionStatus::Running));
        assert_eq!(order.end(at(50)), None);
        assert_eq!(order.on_status(at(50), &said(3, 0.5, "the display is off")), Some(ActionStatus::Failed));
        assert_eq!(order.on_status(at(60), &said(2, 1.0, "done")), None);
        assert_eq!(
            (order.end(at(9000)), order.words()),
            (Some(End::Reported(ActionStatus::Failed)), "the display is off")
        );
    }

    #[test]
    fn a_module_that_falls_silent_counts_as_failed() {
        let mut order = ordered(None);
        order.poll(at(0));
        for millis in [100, 1100, 2100] {
            order.on_status(at(millis), &said(1, 0.0, ""));
        }
        assert_eq!([5099, 5100].map(|millis| order.end(at(millis))), [None, Some(End::Silent)]);
        assert_eq!(order.timeout(), at(5100));
    }

    #[test]
    fn after_its_time_it_is_cancelled_until_it_has_ended() {
        let mut order = ordered(Some(700));
        order.poll(at(0));
        order.on_status(at(10), &said(1, 0.0, ""));
        assert_eq!(sent(&mut order, 10, 1000), [(700, true)]);
        order.on_status(at(1000), &said(1, 0.0, "stops"));
        assert_eq!(sent(&mut order, 1000, 1900), [(1200, true), (1700, true)]);
        order.on_status(at(1900), &said(4, 0.3, "stopped"));
        assert!(sent(&mut order, 1900, 4000).is_empty());
        assert_eq!(order.end(at(1900)), Some(End::Reported(ActionStatus::Cancelled)));
    }

    #[test]
    fn a_cancel_before_the_answer_waits_for_one_of_its_own() {
        let mut order = ordered(None);
        order.poll(at(0));
        order.cancel(at(1500));
        assert_eq!(sent(&mut order, 1500, 2600), [(1500, true), (2000, true), (2500, true)]);
        assert_eq!([3499, 3500].map(|millis| order.end(at(millis))), [None, Some(End::Unanswered)]);
    }
}
