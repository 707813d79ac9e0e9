//! `advee action --list`, `--follow`: the actions that are under way, and each change.

use super::order::is_news;
use super::{Shown, status_json, status_line};
use crate::bus::{Heard, Tool};
use crate::{Common, Failed, Outcome, print};
use base::{Duration, Instant};
use host::clock;
use host::log::TimeOfDay;
use messages::action::{ActionStatus, PERIOD, SILENCE, check_status};
use messages::highlevel::DataAction;
use messages::{Channel, Message};
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Time within which each action that lasts has published its status.
const LISTEN: Duration = PERIOD.saturating_add(Duration::from_millis(300));
/// Interval of the check for actions whose modules have fallen silent.
const LOOK: Duration = Duration::from_millis(500);
/// Maximum number of actions; further ones are not shown.
const ACTIONS_MAX: usize = 256;

/// Lists the actions; with `follow` then each change, for `time` or until Ctrl-C.
pub fn list(common: &Common, follow: bool, time: Option<Duration>, json: bool) -> Outcome {
    let mut tool = Tool::join(common, "action", &[Channel::HlDataAction])?;
    let mut list = List::default();
    let begun = clock::now();
    if !receive(&mut tool, &mut list, begun + LISTEN, &mut |_, _| Ok(()))? {
        return Err("interrupted".into());
    }
    let lasting: Vec<_> = list.lasting().collect();
    if json {
        lasting.iter().try_for_each(|(status, data)| print(status_json(*status, data)))?;
    } else if lasting.is_empty() {
        print("no action is under way")?;
    } else {
        lasting
            .iter()
            .try_for_each(|(status, data)| print(format_args!("{}  {}", data.id, status_line(*status, data))))?;
    }
    if !follow {
        return Ok(ExitCode::SUCCESS);
    }
    let end = time.map_or(Instant::NEVER, |time| begun + time);
    let mut show = |status: Shown, data: &DataAction| match json {
        true => print(status_json(status, data)),
        false => print(format_args!("{} {}  {}", time_of(data), data.id, status_line(status, data))),
    };
    while clock::now() < end {
        if !receive(&mut tool, &mut list, end.min(clock::now() + LOOK), &mut show)? {
            break;
        }
        list.expire(clock::now()).iter().try_for_each(|data| show(Shown::Silent, data))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Receives until then, and hands news to `show`; false if it was interrupted.
fn receive(
    tool: &mut Tool,
    list: &mut List,
    until: Instant,
    show: &mut impl FnMut(Shown, &DataAction) -> Result<(), Failed>,
) -> Result<bool, Failed> {
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::HlDataAction(data)) => {
                if let Some(status) = list.on_status(clock::now(), &data) {
                    show(Shown::Status(status), &data)?;
                }
            }
            Heard::Message(_) => {}
            Heard::Nothing => return Ok(true),
            Heard::Interrupt => return Ok(false),
        }
    }
}

/// Time of the day of a status, to the second.
fn time_of(data: &DataAction) -> String {
    let mut text = TimeOfDay(u64::try_from(data.timestamp).unwrap_or_default().saturating_mul(1000)).to_string();
    text.truncate(8);
    text
}

/// Actions by their identifiers, with the time of the last status.
#[derive(Default)]
struct List(BTreeMap<String, (Instant, ActionStatus, DataAction)>);

impl List {
    /// Takes a status; returns it if it is news.
    fn on_status(&mut self, now: Instant, data: &DataAction) -> Option<ActionStatus> {
        let status = check_status(data).ok()?;
        if let Some((heard, last, before)) = self.0.get_mut(&data.id) {
            *heard = now;
            // An end is repeated, and nothing comes after it.
            if last.is_end() {
                return None;
            }
            let is_news = is_news(before, data);
            (*last, *before) = (status, data.clone());
            return is_news.then_some(status);
        }
        if self.0.len() >= ACTIONS_MAX {
            return None;
        }
        self.0.insert(data.id.clone(), (now, status, data.clone()));
        Some(status)
    }

    /// Actions that last, in the order of their identifiers.
    fn lasting(&self) -> impl Iterator<Item = (Shown, &DataAction)> {
        let all = self.0.values().filter(|(_, status, _)| !status.is_end());
        all.map(|(_, status, data)| (Shown::Status(*status), data))
    }

    /// Forgets the actions without a recent status; returns those that had not ended.
    fn expire(&mut self, now: Instant) -> Vec<DataAction> {
        let mut silent = Vec::new();
        self.0.retain(|_, (heard, status, data)| {
            let is_recent = now.since(*heard) < SILENCE;
            if !is_recent && !status.is_end() {
                silent.push(data.clone());
            }
            is_recent
        });
        silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(10_000 + millis)
    }

    fn said(id: &str, status: i8) -> DataAction {
        DataAction { timestamp: 3_600_000_000, id: id.into(), status, progress: 0.5, message: "Good\nmorning".into() }
    }

    #[test]
    fn an_action_is_listed_while_it_lasts_and_its_end_is_shown_once() {
        let mut list = List::default();
        assert_eq!(list.on_status(at(0), &said("a", 1)), Some(ActionStatus::Running));
        assert_eq!(list.on_status(at(1000), &said("a", 1)), None, "the same");
        assert_eq!(list.on_status(at(1000), &said("b", 77)), None, "no status");
        assert_eq!(list.lasting().count(), 1);
        assert_eq!(list.on_status(at(2000), &said("a", 2)), Some(ActionStatus::Succeeded));
        assert_eq!(list.on_status(at(3000), &said("a", 2)), None, "repeated");
        assert_eq!(list.on_status(at(3000), &said("a", 1)), None, "it has ended");
        assert_eq!((list.lasting().count(), list.expire(at(6000))), (0, vec![]));
    }

    #[test]
    fn an_action_that_is_not_heard_of_any_more_is_named() {
        let mut list = List::default();
        list.on_status(at(0), &said("a", 1));
        assert!(list.expire(at(2999)).is_empty());
        assert_eq!(list.expire(at(3000)), [said("a", 1)]);
        assert_eq!((list.lasting().count(), list.expire(at(9000))), (0, vec![]));
    }

    #[test]
    fn the_number_of_actions_is_bounded() {
        let mut list = List::default();
        for n in 0..2 * ACTIONS_MAX {
            list.on_status(at(0), &said(&n.to_string(), 1));
        }
        assert_eq!(list.lasting().count(), ACTIONS_MAX);
    }

    #[test]
    fn a_line_has_the_time_of_the_status() {
        assert_eq!(time_of(&said("a", 1)), "01:00:00");
        assert_eq!(time_of(&DataAction { timestamp: -1, ..said("a", 1) }), "00:00:00");
    }
}
