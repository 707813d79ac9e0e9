//! Timestamps never decrease on a channel of a process, whatever the wall clock does (docs/design.md, section 5). Those
//! of scans are of their first beams: they never decrease for a lidar.

use super::Verdict;
use messages::{Channel, Message};

/// Last timestamps of a process, by channel.
type Last = [i64; Channel::ALL.len()];

/// Living processes.
#[derive(Debug, Default)]
pub(super) struct Rule {
    living: Vec<(u32, Last)>,
    /// Process and lidar, and the last timestamp.
    lidars: Vec<(u32, String, i64)>,
}

impl Rule {
    /// A process is started.
    pub fn on_started(&mut self, pid: u32) {
        self.living.push((pid, [i64::MIN; Channel::ALL.len()]));
    }

    /// A process ended.
    pub fn on_exited(&mut self, pid: u32) {
        self.living.retain(|(living, _)| *living != pid);
        self.lidars.retain(|(living, ..)| *living != pid);
    }

    /// A message was sent.
    pub fn on_message(&mut self, pid: u32, message: &Message) -> Verdict {
        if let Message::LlDataScan(scan) = message {
            return self.on_scan(pid, &scan.name, scan.timestamp);
        }
        let Some((_, last)) = self.living.iter_mut().find(|(living, _)| *living == pid) else { return Ok(()) };
        let (channel, timestamp) = (message.channel(), message.timestamp());
        let before = std::mem::replace(&mut last[channel as usize], timestamp);
        if timestamp < before {
            let by = before.saturating_sub(timestamp);
            return Err(format!("process {pid} sends {} with a timestamp {by} us back", channel.name()));
        }
        Ok(())
    }

    fn on_scan(&mut self, pid: u32, lidar: &str, timestamp: i64) -> Verdict {
        let of_it = |(of, name, _): &&mut (u32, String, i64)| *of == pid && name == lidar;
        let Some((.., last)) = self.lidars.iter_mut().find(of_it) else {
            self.lidars.push((pid, lidar.into(), timestamp));
            return Ok(());
        };
        let before = std::mem::replace(last, timestamp);
        if timestamp < before {
            let by = before.saturating_sub(timestamp);
            return Err(format!("process {pid} sends a scan of {lidar} with a timestamp {by} us back"));
        }
        Ok(())
    }
}
