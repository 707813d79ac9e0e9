//! Actions of the high level: the limits and times of `HL_CMD_ACTION` and `HL_DATA_ACTION` (docs/highlevel.md).
//!
//! ```
//! use messages::action::{self, ActionStatus};
//! use messages::highlevel::{CmdAction, DataAction, Parameter};
//!
//! let text = Parameter { name: "text".into(), value: "Good morning.".into() };
//! let (id, name, parameters) = ("web-1".into(), "present".into(), vec![text]);
//! let mut command = CmdAction { id, name, parameters, ..Default::default() };
//! assert_eq!(action::check(&command), Ok(()));
//! command.id.clear();
//! assert_eq!(action::check(&command), Err(action::Defect::Id));
//!
//! let status = DataAction { id: "web-1".into(), status: DataAction::SUCCEEDED, ..Default::default() };
//! assert!(ActionStatus::of(&status).is_some_and(ActionStatus::is_end));
//! ```

use std::fmt::{self, Display};

use base::{Duration, listed};

use crate::highlevel::{CmdAction, DataAction, Parameter};

/// Maximum length of an action's identifier, bytes.
pub const ID_MAX: usize = 128;
/// Maximum length of the name of an action or of a parameter, bytes.
pub const NAME_MAX: usize = 64;
/// Maximum number of parameters.
pub const PARAMETERS_MAX: usize = 32;
/// Maximum length of a parameter's value, bytes.
pub const VALUE_MAX: usize = 4096;
/// Maximum length of the message of a status, bytes.
pub const MESSAGE_MAX: usize = 512;

/// Period in which a commander repeats a command that is not answered.
pub const REPEAT: Duration = Duration::from_millis(500);
/// Time after which nobody offers the name of a command that is not answered: the action counts as rejected.
pub const ANSWER: Duration = Duration::from_secs(2);
/// Period of the status of an action that lasts.
pub const PERIOD: Duration = Duration::from_secs(1);
/// Silence after which an action that lasts counts as failed.
pub const SILENCE: Duration = Duration::from_secs(3);

listed! {
    /// Status of an action: `status` of `HL_DATA_ACTION`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    #[repr(i8)]
    pub enum ActionStatus {
        /// It waits for its start.
        Accepted = 0 => "accepted",
        /// It is under way.
        Running = 1 => "running",
        /// It has reached its aim.
        Succeeded = 2 => "succeeded",
        /// It has ended without reaching its aim.
        Failed = 3 => "failed",
        /// It has ended because it was cancelled.
        Cancelled = 4 => "cancelled",
        /// It has ended without a start.
        Rejected = 5 => "rejected",
    }
}

impl ActionStatus {
    /// Status of a message; `None` for a number outside the contract.
    #[must_use]
    pub fn of(data: &DataAction) -> Option<Self> {
        Self::ALL.into_iter().find(|status| *status as i8 == data.status)
    }

    /// True for a status after which nothing changes.
    #[must_use]
    pub const fn is_end(self) -> bool {
        !matches!(self, Self::Accepted | Self::Running)
    }
}

/// Share of an action that is done, 0 to 1; `None` if it is not known, or outside of that range.
#[must_use]
pub fn progress(data: &DataAction) -> Option<f64> {
    Some(data.progress).filter(|share| (0.0..=1.0).contains(share))
}

/// Reason for which a command or a status is outside the contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// The identifier is empty, too long, or has other than printable ASCII characters.
    Id,
    /// The name of the action is not one.
    Name,
    /// There are that many parameters.
    Count(usize),
    /// The name of the parameter at this index is not one.
    ParameterName(usize),
    /// The parameter at this index has the name of an earlier one.
    Twice(usize),
    /// The value of the parameter at this index has that many bytes.
    Value(usize, usize),
    /// The status has this unknown number.
    Status(i8),
    /// The message of a status has that many bytes.
    Message(usize),
}

impl Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Id => write!(f, "an id has 1 to {ID_MAX} printable ASCII characters and no spaces"),
            Self::Name => write!(f, "a name has a letter, then letters, digits, _, - and ., at most {NAME_MAX}"),
            Self::Count(count) => write!(f, "{count} parameters are more than {PARAMETERS_MAX}"),
            Self::ParameterName(index) => write!(f, "the name of parameter {index} is not one"),
            Self::Twice(index) => write!(f, "parameter {index} has the name of an earlier one"),
            Self::Value(index, len) => {
                write!(f, "the value of parameter {index} has {len} bytes, more than {VALUE_MAX}")
            }
            Self::Status(number) => write!(f, "{number} is no status"),
            Self::Message(len) => write!(f, "the message has {len} bytes, more than {MESSAGE_MAX}"),
        }
    }
}

impl std::error::Error for Defect {}

/// True for an identifier within the contract.
#[must_use]
pub fn is_id(text: &str) -> bool {
    (1..=ID_MAX).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic())
}

/// True for the name of an action or of a parameter within the contract.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let is_of_name = |byte: u8| byte.is_ascii_alphanumeric() || b"_-.".contains(&byte);
    text.len() <= NAME_MAX && text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.bytes().all(is_of_name)
}

/// Checks a command against the contract. The name of a cancel may be empty, its parameters are ignored.
///
/// # Errors
/// The first [`Defect`], in the order of the members.
pub fn check(command: &CmdAction) -> Result<(), Defect> {
    let CmdAction { id, name, parameters, cancel, .. } = command;
    let may_be_empty = *cancel && name.is_empty();
    if !is_id(id) {
        return Err(Defect::Id);
    }
    if !may_be_empty && !is_name(name) {
        return Err(Defect::Name);
    }
    if *cancel {
        return Ok(());
    }
    if parameters.len() > PARAMETERS_MAX {
        return Err(Defect::Count(parameters.len()));
    }
    for (index, Parameter { name, value }) in parameters.iter().enumerate() {
        if !is_name(name) {
            return Err(Defect::ParameterName(index));
        }
        if parameters[..index].iter().any(|earlier| earlier.name == *name) {
            return Err(Defect::Twice(index));
        }
        if value.len() > VALUE_MAX {
            return Err(Defect::Value(index, value.len()));
        }
    }
    Ok(())
}

/// Checks a status against the contract. A progress out of its range is one that is not known: [`progress`].
///
/// # Errors
/// The first [`Defect`], in the order of the members.
pub fn check_status(data: &DataAction) -> Result<ActionStatus, Defect> {
    if !is_id(&data.id) {
        return Err(Defect::Id);
    }
    let status = ActionStatus::of(data).ok_or(Defect::Status(data.status))?;
    if data.message.len() > MESSAGE_MAX {
        return Err(Defect::Message(data.message.len()));
    }
    Ok(status)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Channel, Message};

    fn command(parameters: &[(&str, &str)]) -> CmdAction {
        let parameter = |(name, value): &(&str, &str)| Parameter { name: (*name).into(), value: (*value).into() };
        let parameters = parameters.iter().map(parameter).collect();
        CmdAction { timestamp: 1, id: "a".into(), name: "present".into(), parameters, cancel: false }
    }

    #[test]
    fn the_types_have_the_fingerprints_of_the_official_generator() {
        assert_eq!(Channel::HlCmdAction.fingerprint(), 0xa4c0_0559_cf37_b46e);
        assert_eq!(Channel::HlDataAction.fingerprint(), 0xf7ff_f813_ee27_5d1e);
    }

    #[test]
    fn every_status_has_its_number_and_ends_at_succeeded() {
        let of = |status| ActionStatus::of(&DataAction { status, ..Default::default() });
        let numbers = [
            DataAction::ACCEPTED,
            DataAction::RUNNING,
            DataAction::SUCCEEDED,
            DataAction::FAILED,
            DataAction::CANCELLED,
            DataAction::REJECTED,
        ];
        assert_eq!(numbers.map(of), ActionStatus::ALL.map(Some));
        assert_eq!([of(-1), of(6)], [None; 2]);
        assert_eq!(ActionStatus::ALL.map(ActionStatus::is_end), [false, false, true, true, true, true]);
    }

    #[test]
    fn ids_and_names_are_bounded_and_safe_to_print() {
        for id in ["a", "present@advee:4711-123456", "7f3c/2", &"x".repeat(ID_MAX)] {
            assert!(is_id(id), "{id}");
        }
        for id in ["", "a b", "a\n", "ä", "\x7f", &"x".repeat(ID_MAX + 1)] {
            assert!(!is_id(id), "{id:?}");
        }
        for name in ["present", "Say.twice_2-x", &"n".repeat(NAME_MAX)] {
            assert!(is_name(name), "{name}");
        }
        for name in ["", "2x", "-x", "a b", "a=b", "é", &"n".repeat(NAME_MAX + 1)] {
            assert!(!is_name(name), "{name:?}");
        }
    }

    #[test]
    fn a_command_outside_the_limits_is_refused_with_the_reason() {
        assert_eq!(check(&command(&[("text", "Good morning."), ("seconds", "3.5"), ("empty", "")])), Ok(()));
        assert_eq!(check(&CmdAction { id: String::new(), ..command(&[]) }), Err(Defect::Id));
        assert_eq!(check(&CmdAction { name: "a b".into(), ..command(&[]) }), Err(Defect::Name));
        assert_eq!(check(&CmdAction { name: String::new(), ..command(&[]) }), Err(Defect::Name));
        assert_eq!(check(&command(&[("a", ""), ("", "")])), Err(Defect::ParameterName(1)));
        assert_eq!(check(&command(&[("a", "1"), ("b", "2"), ("a", "3")])), Err(Defect::Twice(2)));
        let long = "v".repeat(VALUE_MAX + 1);
        assert_eq!(check(&command(&[("a", &long[1..])])), Ok(()));
        assert_eq!(check(&command(&[("a", long.as_str())])), Err(Defect::Value(0, VALUE_MAX + 1)));
        let many: Vec<String> = (0..=PARAMETERS_MAX).map(|n| format!("p{n}")).collect();
        let mut many: Vec<(&str, &str)> = many.iter().map(|name| (name.as_str(), "")).collect();
        assert_eq!(check(&command(&many)), Err(Defect::Count(PARAMETERS_MAX + 1)));
        many.pop();
        assert_eq!(check(&command(&many)), Ok(()));
        assert_eq!(Defect::Value(0, 5000).to_string(), "the value of parameter 0 has 5000 bytes, more than 4096");
    }

    #[test]
    fn a_cancel_needs_its_id_alone() {
        let cancel = CmdAction { name: String::new(), cancel: true, ..command(&[("", ""), ("", "")]) };
        assert_eq!(check(&cancel), Ok(()));
        assert_eq!(check(&CmdAction { name: "a b".into(), ..cancel.clone() }), Err(Defect::Name));
        assert_eq!(check(&CmdAction { id: " ".into(), ..cancel }), Err(Defect::Id));
    }

    #[test]
    fn a_status_outside_the_limits_is_refused_and_a_progress_out_of_range_is_not_known() {
        let status = |status, message: &str| DataAction {
            id: "a".into(),
            status,
            message: message.into(),
            ..Default::default()
        };
        assert_eq!(check_status(&status(1, "")), Ok(ActionStatus::Running));
        assert_eq!(check_status(&status(9, "")), Err(Defect::Status(9)));
        assert_eq!(check_status(&status(1, &"m".repeat(MESSAGE_MAX + 1))), Err(Defect::Message(MESSAGE_MAX + 1)));
        assert_eq!(check_status(&DataAction { id: String::new(), ..status(1, "") }), Err(Defect::Id));
        let share = |progress| super::progress(&DataAction { progress, ..Default::default() });
        assert_eq!([0.0, 0.5, 1.0].map(share), [Some(0.0), Some(0.5), Some(1.0)]);
        assert_eq!([f64::NAN, -0.1, 1.1, f64::INFINITY].map(share), [None; 4]);
    }

    #[test]
    fn the_largest_messages_are_accepted_by_every_module() {
        let value = "v".repeat(VALUE_MAX);
        let name = |n| format!("{n:n>NAME_MAX$}");
        let parameters = (0..PARAMETERS_MAX).map(|n| Parameter { name: name(n), value: value.clone() }).collect();
        let command = CmdAction { id: "i".repeat(ID_MAX), parameters, ..command(&[]) };
        assert_eq!(check(&command), Ok(()));
        let (id, message) = ("i".repeat(ID_MAX), "m".repeat(MESSAGE_MAX));
        let status = DataAction { id, message, ..Default::default() };
        for message in [Message::from(command), status.into()] {
            let mut bytes = Vec::new();
            message.encode(&mut bytes).unwrap();
            assert!(bytes.len() <= message.channel().size_max(), "{} bytes", bytes.len());
        }
    }
}
