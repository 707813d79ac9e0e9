//! What the bus says of a lidar whose port a module holds: its scans, its line, and the faults that its driver reports.

use super::monitor::{Row, Seen};
use super::target::Held;
use crate::Failed;
use crate::bus::{Heard, Tool};
use base::Duration;
use host::clock;
use messages::common::DataFaults;
use messages::lowlevel::{DataBus, DataScan};
use messages::{Channel, Message};

/// Faults and lines are published once a second.
const LISTENED: Duration = Duration::from_millis(2200);

/// What was heard of a lidar.
#[derive(Default)]
pub struct Known {
    /// Sectors.
    pub seen: Seen,
    /// The last of them.
    pub scan: Option<DataScan>,
    /// State of its line.
    pub line: Option<DataBus>,
    /// Its faults, for people; `None`: its driver did not publish any list.
    pub faults: Option<Vec<String>>,
}

/// Listens to the bus of the holder's robot; none at Ctrl-C.
pub fn listen(held: &Held) -> Result<Option<Known>, Failed> {
    let mut known = Known::default();
    let (Some((url, name)), Some(module)) = (&held.module, &held.holder.module) else { return Ok(Some(known)) };
    let channels = [Channel::LlDataScan, Channel::LlDataBus, Channel::CmDataFaults];
    let mut tool = Tool::join_at(url, "lidar", &channels)?;
    let until = clock::now() + LISTENED;
    loop {
        match tool.hear(until)? {
            Heard::Message(message) => known.take(message, name, module),
            Heard::Nothing => return Ok(Some(known)),
            Heard::Interrupt => return Ok(None),
        }
    }
}

impl Known {
    fn take(&mut self, message: Message, name: &str, module: &str) {
        match message {
            Message::LlDataScan(scan) if scan.name == name => {
                self.seen.add(&scan);
                self.scan = Some(scan);
            }
            Message::LlDataBus(line) if is_of(&line.bus, name) => self.line = Some(line),
            Message::CmDataFaults(DataFaults { module: of, faults, .. }) if of == module => {
                let ours = faults.into_iter().filter(|fault| is_of(&fault.subject, name));
                let text = |fault: messages::common::Fault| format!("0x{:04x} {}", fault.number, fault.message);
                self.faults = Some(ours.map(text).collect());
            }
            _ => {}
        }
    }

    /// Its measurements of the time that was listened.
    pub fn row<'a>(&self, name: &'a str) -> Row<'a> {
        Row::of(name, &self.seen)
    }

    /// Beams in a second.
    pub fn per_second(&self, beams: usize) -> f64 {
        beams as f64 / LISTENED.as_secs_f64()
    }
}

/// True for the name of the port of this lidar.
fn is_of(bus: &str, name: &str) -> bool {
    bus.strip_prefix("lidar.") == Some(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::common::Fault;

    #[test]
    fn what_the_bus_says_is_that_of_one_lidar_and_its_driver() {
        let mut known = Known::default();
        let mut take = |message: Message| known.take(message, "top", "driver_lidar");
        for name in ["top", "rear"] {
            take(DataScan { name: name.into(), ranges: vec![1.0; 8], ..DataScan::default() }.into());
            take(DataBus { bus: format!("lidar.{name}"), frames: 7, ..DataBus::default() }.into());
        }
        let fault = |subject: &str, message: &str| Fault {
            number: 0x0901,
            subject: subject.into(),
            message: message.into(),
            ..Fault::default()
        };
        let faults = vec![fault("lidar.rear", "rear is silent"), fault("lidar.top", "top is silent")];
        take(DataFaults { module: "driver_lidar".into(), faults, ..DataFaults::default() }.into());
        let faults = vec![fault("lidar.top", "of somebody else")];
        take(DataFaults { module: "planner".into(), faults, ..DataFaults::default() }.into());
        assert_eq!(known.faults.as_deref(), Some(&["0x0901 top is silent".to_string()][..]));
        assert_eq!((known.row("top").beams, known.line.map(|line| line.frames)), (8, Some(7)));
    }
}
