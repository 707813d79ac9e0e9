//! Which channels may cross, and which of them only under their own name.

use base::{Duration, Instant};
use messages::Message;
use std::collections::BTreeMap;

/// Maximum number of channels of one entry whose rate is limited; further ones do not cross.
const LIMITED_MAX: usize = 64;

/// How a channel may be allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nature {
    /// Measurements, data and events: by its name, or by a prefix.
    Data,
    /// What commands, or may release a stop: by its whole name only.
    Named,
    /// Never: it is about one computer.
    Never,
}

/// Channels that never cross: by `CM_DATA_PROCESSES` the modules of a computer see that its watchdog lives.
const NEVER: [&str; 2] = ["CM_DATA_PROCESSES", "CM_DATA_BRIDGE"];
/// Channels that are commands, or release a stop, although their names do not contain `CMD`.
const NAMED: [&str; 2] = ["LL_DATA_ACTIVE_BEACONS", "LL_EVENT_STOP"];

/// How the channel of this name may be allowed. Of a name that is not formed as the robot's: by its whole name.
#[must_use]
pub fn nature(channel: &str) -> Nature {
    let kind = channel.split('_').nth(1).unwrap_or_default();
    match kind {
        _ if NEVER.contains(&channel) => Nature::Never,
        _ if NAMED.contains(&channel) => Nature::Named,
        "DATA" | "EVENT" => Nature::Data,
        _ => Nature::Named,
    }
}

/// Module that a message is about, of channels on which each module publishes about itself: these may cross both ways,
/// each computer's modules in one direction.
#[must_use]
pub fn subject(message: &Message) -> Option<&str> {
    match message {
        Message::CmDataState(state) => Some(&state.module),
        Message::CmDataFaults(faults) => Some(&faults.module),
        Message::CmEventError(error) => Some(&error.module),
        Message::CmEventText(text) => Some(&text.module),
        Message::LlDataHold(hold) => Some(&hold.module),
        _ => None,
    }
}

/// Channels of [`subject`].
pub const OF_MODULES: [&str; 5] =
    ["CM_DATA_STATE", "CM_DATA_FAULTS", "CM_EVENT_ERROR", "CM_EVENT_TEXT", "LL_DATA_HOLD"];

/// Entry of a list: `NAME` or `PREFIX*`, and `@RATE` where the rate is limited, Hz.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Name, or prefix.
    name: String,
    is_prefix: bool,
    /// Shortest time between two messages of a channel.
    period: Option<Duration>,
}

impl Entry {
    /// Reads an entry; `None` if it is none, or names what may not be named so.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (pattern, rate) = text.split_once('@').map_or((text, None), |(pattern, rate)| (pattern, Some(rate)));
        let (name, is_prefix) = pattern.strip_suffix('*').map_or((pattern, false), |name| (name, true));
        let is_word = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        let period = match rate {
            None => None,
            Some(rate) => {
                let hz: f64 = rate.parse().ok().filter(|hz| (0.01..=1000.0).contains(hz))?;
                Some(Duration::from_secs_f64(1.0 / hz))
            }
        };
        // A prefix names a level at least.
        let lengths = if is_prefix { 3..=62 } else { 1..=63 };
        let is_allowed = is_prefix || nature(name) != Nature::Never;
        let entry = Self { name: name.into(), is_prefix, period };
        (is_word && lengths.contains(&name.len()) && is_allowed).then_some(entry)
    }

    /// True if it allows the channel.
    #[must_use]
    pub fn allows(&self, channel: &str) -> bool {
        match self.is_prefix {
            true => nature(channel) == Nature::Data && channel.starts_with(&self.name),
            false => self.name == channel,
        }
    }

    /// Name of the channel; `None` for a prefix.
    #[must_use]
    pub fn channel(&self) -> Option<&str> {
        (!self.is_prefix).then_some(&self.name)
    }

    /// Pattern of the bus that matches the channels.
    #[must_use]
    pub fn pattern(&self) -> String {
        if self.is_prefix { format!("{}.*", self.name) } else { self.name.clone() }
    }

    /// True if some channel is allowed by both.
    fn meets(&self, other: &Self) -> bool {
        match (self.is_prefix, other.is_prefix) {
            (true, true) => self.name.starts_with(&other.name) || other.name.starts_with(&self.name),
            (true, false) => self.allows(&other.name),
            (false, _) => other.allows(&self.name),
        }
    }
}

/// A channel or prefix that a computer would both send and receive; `None` if there is none. Channels of [`OF_MODULES`]
/// named in full are no such channel.
#[must_use]
pub fn both_ways<'a>(sent: &'a [Entry], received: &[Entry]) -> Option<&'a str> {
    let is_of_modules = |entry: &Entry| entry.channel().is_some_and(|name| OF_MODULES.contains(&name));
    let is_both = |entry: &&Entry| {
        !is_of_modules(entry) && received.iter().any(|other| !is_of_modules(other) && entry.meets(other))
    };
    sent.iter().find(is_both).map(|entry| entry.name.as_str())
}

/// A list of channels, with the times of what passed.
#[derive(Clone, Debug)]
pub struct AllowList {
    entries: Vec<(Entry, BTreeMap<String, Instant>)>,
}

/// What a list decides about a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It crosses.
    Passes,
    /// Its channel is not allowed.
    Forbidden,
    /// Its channel is allowed, and its rate too high.
    TooOften,
}

impl AllowList {
    /// List of these entries.
    #[must_use]
    pub fn new(entries: Vec<Entry>) -> Self {
        Self { entries: entries.into_iter().map(|entry| (entry, BTreeMap::new())).collect() }
    }

    /// True if the channel is allowed.
    #[must_use]
    pub fn allows(&self, channel: &str) -> bool {
        self.entries.iter().any(|(entry, _)| entry.allows(channel))
    }

    /// Decides about a message of this channel by the first entry that allows it.
    pub fn judge(&mut self, now: Instant, channel: &str) -> Verdict {
        let Some((entry, next)) = self.entries.iter_mut().find(|(entry, _)| entry.allows(channel)) else {
            return Verdict::Forbidden;
        };
        let Some(period) = entry.period else { return Verdict::Passes };
        let is_full = next.len() >= LIMITED_MAX;
        match next.get_mut(channel) {
            Some(due) if *due > now => Verdict::TooOften,
            Some(due) => {
                *due = now + period;
                Verdict::Passes
            }
            None if is_full => Verdict::TooOften,
            None => {
                next.insert(channel.into(), now + period);
                Verdict::Passes
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Channel;

    fn entries(texts: &[&str]) -> Vec<Entry> {
        texts.iter().map(|text| Entry::parse(text).unwrap_or_else(|| panic!("{text}"))).collect()
    }

    #[test]
    fn a_prefix_allows_data_and_no_command() {
        let list = AllowList::new(entries(&["LL_*", "HL_DATA_*"]));
        for channel in Channel::ALL.iter().map(|channel| channel.name()) {
            let is_data = ["LL_DATA_", "LL_EVENT_", "HL_DATA_"].iter().any(|start| channel.starts_with(start));
            let is_data = is_data && !["LL_EVENT_STOP", "LL_DATA_ACTIVE_BEACONS"].contains(&channel);
            assert_eq!(list.allows(channel), is_data, "{channel}");
        }
        for channel in ["LL_CMD_MOTION", "LL_CMD_VELOCITY", "LL_CMD_CREEP", "LL_CMD_POWER", "LL_CMD_SDO", "LL_X"] {
            assert!(!list.allows(channel), "{channel}");
            assert!(AllowList::new(entries(&[channel])).allows(channel), "{channel}");
        }
    }

    #[test]
    fn what_is_about_one_computer_never_crosses() {
        assert_eq!(Entry::parse("CM_DATA_PROCESSES"), None);
        let list = AllowList::new(entries(&["CM_*", "CM_DATA_*"]));
        assert!(!list.allows("CM_DATA_PROCESSES") && !list.allows("CM_DATA_BRIDGE") && list.allows("CM_DATA_LOG"));
    }

    #[test]
    fn entries_that_are_none_are_refused() {
        let long = "X".repeat(64);
        for wrong in
            ["", "*", "L*", "LL", "LL_DATA_ODO@", "LL_DATA_ODO@0", "LL_DATA_ODO@x", "A B", "A.*", "ŽL_*", &long]
        {
            assert_eq!(Entry::parse(wrong).is_none(), wrong != "LL", "{wrong}");
        }
        assert_eq!(Entry::parse("LL_DATA_*").unwrap().pattern(), "LL_DATA_.*");
    }

    #[test]
    fn a_channel_goes_one_way() {
        let meet = |sent: &[&str], received: &[&str]| both_ways(&entries(sent), &entries(received)).is_some();
        assert!(meet(&["LL_DATA_ODO"], &["LL_DATA_*"]));
        assert!(meet(&["LL_*"], &["LL_DATA_ODO"]));
        assert!(meet(&["HL_DATA_*"], &["HL_*"]));
        assert!(meet(&["LL_CMD_MOTION"], &["LL_CMD_MOTION"]));
        assert!(!meet(&["LL_*"], &["LL_CMD_MOTION", "HL_*"]));
        assert!(!meet(&["CM_DATA_STATE", "CM_EVENT_TEXT"], &["CM_DATA_STATE", "CM_EVENT_TEXT"]));
        assert!(meet(&["CM_DATA_*"], &["CM_DATA_*"]));
    }

    #[test]
    fn a_rate_is_of_each_channel() {
        let mut list = AllowList::new(entries(&["LL_DATA_*@10"]));
        let mut judge = |ms, channel| list.judge(Instant::from_millis(ms), channel);
        assert_eq!(judge(0, "LL_DATA_ODO"), Verdict::Passes);
        assert_eq!(judge(50, "LL_DATA_ODO"), Verdict::TooOften);
        assert_eq!(judge(50, "LL_DATA_SRFS"), Verdict::Passes);
        assert_eq!(judge(100, "LL_DATA_ODO"), Verdict::Passes);
        assert_eq!(judge(100, "ML_DATA_PLAN"), Verdict::Forbidden);
    }

    #[test]
    fn channels_of_modules_are_those_whose_messages_name_one() {
        let subjects: Vec<&str> =
            Channel::ALL.iter().map(|channel| channel.name()).filter(|name| OF_MODULES.contains(name)).collect();
        assert_eq!(subjects.len(), OF_MODULES.len());
        let state = messages::common::DataState { module: "camera".into(), ..Default::default() };
        assert_eq!(subject(&Message::CmDataState(state)), Some("camera"));
    }
}
