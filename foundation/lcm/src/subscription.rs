//! Which channels a receiver wants.
//!
//! ```
//! use lcm::subscription::Pattern;
//!
//! let pattern = Pattern::new("POSE_.*|ODOMETRY")?;
//! assert!(pattern.matches("POSE_A") && !pattern.matches("ODOMETRY_2"));
//! # Ok::<(), lcm::subscription::PatternError>(())
//! ```

use core::fmt;
use regex_lite::Regex;

/// A set of channels: a plain name, or a regular expression that matches the **whole** name, as in LCM for Java.
///
/// `liblcm` puts `^` and `$` around the expression, which bind tighter than `|`: there `AB|CD` also matches `ABX` and
/// `XCD`, and `$` also matches before a final newline. Here it matches `AB` and `CD`. `.*` is every channel.
#[derive(Clone, Debug)]
pub struct Pattern(Kind);

#[derive(Clone, Debug)]
enum Kind {
    All,
    Literal(Box<str>),
    /// Part before a final `.*`: the common pattern, at a tenth of the cost of an expression.
    Prefix(Box<str>),
    Regex(Regex),
}

/// Why a pattern was refused. One line for people by `Display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PatternError {
    /// The pattern as given.
    pub pattern: String,
    /// Defect of the expression.
    pub why: String,
}

impl fmt::Display for PatternError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "channel pattern `{}`: {}", self.pattern, self.why)
    }
}

impl core::error::Error for PatternError {}

impl Pattern {
    /// Reads a pattern; one without any of `\ . + * ? ( ) | [ ] { } ^ $` is a plain name.
    ///
    /// # Errors
    /// It is not a regular expression of `regex-lite`.
    pub fn new(pattern: &str) -> Result<Self, PatternError> {
        if pattern == ".*" {
            return Ok(Self(Kind::All));
        }
        let plain =
            |text: &str| !text.contains(['\\', '.', '+', '*', '?', '(', ')', '|', '[', ']', '{', '}', '^', '$']);
        if plain(pattern) {
            return Ok(Self(Kind::Literal(pattern.into())));
        }
        if let Some(prefix) = pattern.strip_suffix(".*").filter(|prefix| plain(prefix)) {
            return Ok(Self(Kind::Prefix(prefix.into())));
        }
        let wrong = |error: regex_lite::Error| PatternError { pattern: pattern.into(), why: error.to_string() };
        // Alone first: `A)|(B` is wrong, and right only between our parentheses.
        Regex::new(pattern).map_err(wrong)?;
        let whole = Regex::new(&format!(r"\A(?:{pattern})\z")).map_err(wrong)?;
        Ok(Self(Kind::Regex(whole)))
    }

    /// The one channel that it names, if it is a plain name.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        match &self.0 {
            Kind::Literal(name) => Some(name),
            Kind::All | Kind::Prefix(_) | Kind::Regex(_) => None,
        }
    }

    /// True if `channel` is one of the set.
    #[must_use]
    pub fn matches(&self, channel: &str) -> bool {
        match &self.0 {
            Kind::All => true,
            Kind::Literal(name) => **name == *channel,
            Kind::Prefix(prefix) => channel.starts_with(&**prefix),
            Kind::Regex(regex) => regex.is_match(channel),
        }
    }
}

/// Queueing of a subscription's messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Queue {
    /// In the transport's own buffer; when it is full the newest are lost.
    #[default]
    Transport,
    /// At most this number; further messages are lost, as in `liblcm`.
    Oldest(usize),
    /// At most this number; for each further message the oldest is lost.
    Newest(usize),
    /// The last one of each channel waits, of at most [`LAST_MAX`](crate::queue::LAST_MAX) channels; for more, the
    /// oldest is lost.
    Last,
}

/// Names one subscription of a receiver; never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SubscriptionId(u32);

/// A subscription.
#[derive(Clone, Debug)]
pub struct Subscription {
    id: SubscriptionId,
    pattern: Pattern,
    /// Queueing of its messages.
    pub(crate) queue: Queue,
    /// Number of messages that wait for it.
    pub(crate) waiting: usize,
    /// Number of messages lost to its limit.
    pub(crate) dropped: u64,
    /// Maximum payload, bytes.
    pub(crate) size_max: usize,
}

impl Subscription {
    /// Name.
    #[must_use]
    pub fn id(&self) -> SubscriptionId {
        self.id
    }
}

/// The subscriptions of a receiver.
#[derive(Clone, Debug, Default)]
pub struct Subscriptions {
    entries: Vec<Subscription>,
    next: u32,
}

impl Subscriptions {
    /// Adds one.
    pub fn add(&mut self, pattern: Pattern, queue: Queue) -> SubscriptionId {
        let id = SubscriptionId(self.next);
        self.next += 1;
        self.entries.push(Subscription { id, pattern, queue, waiting: 0, dropped: 0, size_max: usize::MAX });
        id
    }

    /// Limits the payloads of a subscription to `size_max` bytes from now on; false if it does not exist.
    pub fn set_size_max(&mut self, id: SubscriptionId, size_max: usize) -> bool {
        let entry = self.entries.iter_mut().find(|entry| entry.id == id);
        entry.map(|entry| entry.size_max = size_max).is_some()
    }

    /// Takes one away; false when it is not there.
    pub fn remove(&mut self, id: SubscriptionId) -> bool {
        let before = self.entries.len();
        self.entries.retain(|entry| entry.id != id);
        self.entries.len() < before
    }

    /// True if there are no subscriptions.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// True if any of them wants `channel`.
    #[must_use]
    pub fn wants(&self, channel: &str) -> bool {
        self.entries.iter().any(|entry| entry.pattern.matches(channel))
    }

    /// True if any of them wants `channel` and takes `len` bytes of payload.
    #[must_use]
    pub fn takes(&self, channel: &str, len: usize) -> bool {
        self.entries.iter().any(|entry| len <= entry.size_max && entry.pattern.matches(channel))
    }

    /// True if all messages wait in the transport's buffer alone.
    #[must_use]
    pub fn unlimited(&self) -> bool {
        self.entries.iter().all(|entry| entry.queue == Queue::Transport)
    }

    /// Number of messages lost to the limit of a subscription; `None` if it does not exist.
    #[must_use]
    pub fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        self.entries.iter().find(|entry| entry.id == id).map(|entry| entry.dropped)
    }

    /// The channels that are wanted, if they are all plain names.
    #[must_use]
    pub fn names(&self) -> Option<Vec<&str>> {
        self.entries.iter().map(|entry| entry.pattern.name()).collect()
    }

    /// True if one of them has `channel` as its plain name.
    #[must_use]
    pub fn names_it(&self, channel: &str) -> bool {
        self.entries.iter().any(|entry| entry.pattern.name() == Some(channel))
    }

    /// Subscriptions that match `channel`.
    pub(crate) fn matching(&mut self, channel: &str) -> impl Iterator<Item = &mut Subscription> {
        self.entries.iter_mut().filter(move |entry| entry.pattern.matches(channel))
    }

    /// A message that `id` held has left the line.
    pub(crate) fn taken(&mut self, id: SubscriptionId) {
        if let Some(entry) = self.entries.iter_mut().find(|entry| entry.id == id) {
            entry.waiting -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matched<'a>(pattern: &str, names: &[&'a str]) -> Vec<&'a str> {
        let pattern = Pattern::new(pattern).unwrap();
        names.iter().copied().filter(|name| pattern.matches(name)).collect()
    }

    #[test]
    fn a_plain_name_matches_itself_only() {
        assert_eq!(matched("LL_DATA_ODO", &["LL_DATA_ODO", "LL_DATA_ODO2", "XLL_DATA_ODO", ""]), ["LL_DATA_ODO"]);
        assert_eq!(matched("", &["", "A"]), [""]);
    }

    #[test]
    fn an_expression_matches_the_whole_name() {
        assert_eq!(matched("LL_.*", &["LL_", "LL_DATA", "XLL_"]), ["LL_", "LL_DATA"]);
        assert_eq!(matched("A.C", &["ABC", "ABCD", "AC"]), ["ABC"]);
        assert_eq!(matched("AB|CD", &["AB", "CD", "ABX", "XCD"]), ["AB", "CD"]);
        assert_eq!(matched("^AB$", &["AB", "AB\n", "ABX"]), ["AB"]);
        assert_eq!(matched("A|(?m)B$", &["A", "B", "B\nC"]), ["A", "B"]);
        assert_eq!(matched(".*", &["", "A", "A\nB"]), ["", "A", "A\nB"]);
    }

    #[test]
    fn what_is_no_expression_is_refused() {
        for pattern in ["A)|(B", "(", "[", "*", "A{2"] {
            let error = Pattern::new(pattern).unwrap_err();
            assert_eq!(error.pattern, pattern);
            assert!(!error.why.is_empty());
        }
    }

    #[test]
    fn a_channel_is_wanted_until_its_last_subscription_goes() {
        let mut subscriptions = Subscriptions::default();
        let name = subscriptions.add(Pattern::new("A").unwrap(), Queue::Transport);
        assert_eq!(subscriptions.names(), Some(vec!["A"]));
        let all = subscriptions.add(Pattern::new(".*").unwrap(), Queue::Transport);
        assert_eq!(subscriptions.names(), None);
        assert!(subscriptions.remove(all) && !subscriptions.remove(all));
        assert!(subscriptions.wants("A") && !subscriptions.wants("B"));
        assert!(subscriptions.remove(name) && !subscriptions.wants("A"));
    }
}
