//! Timestamps never decrease on a channel of a process, whatever the wall clock does (docs/design.md, section 5).

use super::Verdict;
use messages::{Channel, Message};

/// Last timestamps of a process, by channel.
type Last = [i64; Channel::ALL.len()];

/// Living processes.
#[derive(Debug, Default)]
pub(super) struct Rule {
    living: Vec<(u32, Last)>,
}

impl Rule {
    /// A process is started.
    pub fn on_started(&mut self, pid: u32) {
        self.living.push((pid, [i64::MIN; Channel::ALL.len()]));
    }

    /// A process ended.
    pub fn on_exited(&mut self, pid: u32) {
        self.living.retain(|(living, _)| *living != pid);
    }

    /// A message was sent.
    pub fn on_message(&mut self, pid: u32, message: &Message) -> Verdict {
        let Some((_, last)) = self.living.iter_mut().find(|(living, _)| *living == pid) else { return Ok(()) };
        let (channel, timestamp) = (message.channel(), message.timestamp());
        let before = std::mem::replace(&mut last[channel as usize], timestamp);
        if timestamp < before {
            let by = before.saturating_sub(timestamp);
            return Err(format!("process {pid} sends {} with a timestamp {by} us back", channel.name()));
        }
        Ok(())
    }
}
