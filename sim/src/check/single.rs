//! At most one process of a module at a time (docs/design.md, section 6): two would use the same device.

use super::Verdict;

/// Living processes.
#[derive(Debug, Default)]
pub(super) struct Rule {
    living: Vec<(u32, Box<str>)>,
}

impl Rule {
    /// A process is started.
    pub fn on_started(&mut self, module: &str, pid: u32) -> Verdict {
        let other = self.living.iter().find(|(_, name)| **name == *module).map(|(other, _)| *other);
        self.living.push((pid, module.into()));
        match other {
            Some(other) => Err(format!("process {pid} of {module} is started, and process {other} lives")),
            None => Ok(()),
        }
    }

    /// A process ended.
    pub fn on_exited(&mut self, pid: u32) {
        self.living.retain(|(living, _)| *living != pid);
    }
}
