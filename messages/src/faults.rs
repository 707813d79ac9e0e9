//! Names of active faults and reports.

use crate::common::{DataFaults, Fault};
use base::Fault as Code;
use std::borrow::Cow;

impl DataFaults {
    /// True for the list that the watchdog publishes in the name of a module without a process: the active faults of
    /// the module are then unknown.
    #[must_use]
    pub fn is_down(&self) -> bool {
        self.faults.iter().any(|fault| fault.number == Code::ModuleDown as i32 && fault.subject == self.module)
    }
}

impl Fault {
    /// Name and subject for people: `BoardLost sd1_front`.
    #[must_use]
    pub fn about(&self) -> String {
        let name = fault_name(self.number);
        if self.subject.is_empty() { name.into_owned() } else { format!("{name} {}", self.subject) }
    }
}

/// What a person does about a fault, by its number; `None` for those of foreign modules.
#[must_use]
pub fn fault_remedy(number: i32) -> Option<&'static str> {
    Code::ALL.iter().find(|code| **code as i32 == number).map(|code| code.what_to_do())
}

/// Name of a fault by its number (`docs/faults.md`); the number in hexadecimal for those of foreign modules.
#[must_use]
pub fn fault_name(number: i32) -> Cow<'static, str> {
    match Code::ALL.iter().find(|code| **code as i32 == number) {
        Some(code) => Cow::Borrowed(code.name()),
        None => Cow::Owned(format!("0x{number:04X}")),
    }
}
