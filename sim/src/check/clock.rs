//! Timestamps never decrease on a channel of a process, whatever the wall clock does (docs/design.md, section 5). Those
//! of scans are of their first beams, those of inertial units of their measurements: they never decrease for a device.

use super::Verdict;
use messages::{Channel, Message};

/// Last timestamps of a process, by channel.
type Last = [i64; Channel::ALL.len()];

/// Living processes.
#[derive(Debug, Default)]
pub(super) struct Rule {
    living: Vec<(u32, Last)>,
    /// Process, channel and name of a device, and the last timestamp.
    devices: Vec<(u32, Channel, String, i64)>,
}

impl Rule {
    /// A process is started.
    pub fn on_started(&mut self, pid: u32) {
        self.living.push((pid, [i64::MIN; Channel::ALL.len()]));
    }

    /// A process ended.
    pub fn on_exited(&mut self, pid: u32) {
        self.living.retain(|(living, _)| *living != pid);
        self.devices.retain(|(living, ..)| *living != pid);
    }

    /// A message was sent.
    pub fn on_message(&mut self, pid: u32, message: &Message) -> Verdict {
        match message {
            Message::LlDataScan(scan) => return self.on_device(pid, message.channel(), &scan.name, scan.timestamp),
            Message::LlDataImu(imu) => return self.on_device(pid, message.channel(), &imu.name, imu.timestamp),
            _ => {}
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

    fn on_device(&mut self, pid: u32, channel: Channel, device: &str, timestamp: i64) -> Verdict {
        let of_it =
            |(of, on, name, _): &&mut (u32, Channel, String, i64)| (*of, *on) == (pid, channel) && name == device;
        let Some((.., last)) = self.devices.iter_mut().find(of_it) else {
            self.devices.push((pid, channel, device.into(), timestamp));
            return Ok(());
        };
        let before = std::mem::replace(last, timestamp);
        if timestamp < before {
            let (by, channel) = (before.saturating_sub(timestamp), channel.name());
            return Err(format!("process {pid} sends {channel} of {device} with a timestamp {by} us back"));
        }
        Ok(())
    }
}
