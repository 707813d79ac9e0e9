//! Objects of CANopen nodes, through the driver that holds the bus: requested by `LL_CMD_SDO`, on a bus connection of
//! its own.

use super::command::Answer;
use base::Duration;
use canopen::Abort;
use drivers::canbus;
use host::bus::{Bus, Received};
use host::clock;
use messages::lowlevel::{CmdSdo, DataSdo};
use messages::{Channel, Message};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::fmt::Write;
use std::os::fd::AsFd;

/// Timeout of the driver's answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum number of bytes of an object that are shown.
const SHOWN_MAX: usize = 4096;

/// Sends a request and waits for the answer; blocks the thread.
pub fn ask(url: &str, id: i64, asked: CmdSdo) -> String {
    match wait(url, asked) {
        Ok(DataSdo { abort_code: 0, data, .. }) => {
            let mut text = String::with_capacity(2 * data.len().min(SHOWN_MAX));
            for byte in data.iter().take(SHOWN_MAX) {
                let _ = write!(text, "{byte:02x}");
            }
            let more = data.len() > SHOWN_MAX;
            let why = if more { format!("the first {SHOWN_MAX} of {} bytes", data.len()) } else { String::new() };
            Answer::Sdo { id, data: text, abort: 0, why }.text()
        }
        Ok(DataSdo { abort_code, .. }) => {
            let abort = Abort(abort_code as u32);
            Answer::Sdo { id, data: String::new(), abort: abort.0, why: abort.to_string() }.text()
        }
        Err(why) => Answer::Refused { id: Some(id), why: &why }.text(),
    }
}

fn wait(url: &str, mut asked: CmdSdo) -> Result<DataSdo, String> {
    let mut bus = Bus::open(url, &[Channel::LlDataSdo.name()])?;
    let begun = clock::now();
    asked.timestamp = clock::epoch().timestamp(begun);
    // A number that no other pending request has.
    asked.request = ((clock::wall() / 1000) as u32 & 0x3FFF_FFFF).cast_signed();
    let (request, node) = (asked.request, asked.node);
    bus.publish(&asked.into())?;
    loop {
        let now = clock::now();
        let waited = now.since(begun);
        match bus.receive(now) {
            Received::Message { message: Message::LlDataSdo(answer), .. }
                if (answer.request, answer.node) == (request, node) =>
            {
                return Ok(answer);
            }
            Received::Broken(why) => return Err(why),
            Received::Nothing if waited >= ANSWER_TIMEOUT => {
                return Err(format!(
                    "{} does not answer within {} s: is it in RUN?",
                    canbus::NAME,
                    ANSWER_TIMEOUT.as_secs()
                ));
            }
            Received::Nothing => {
                let left = PollTimeout::try_from(ANSWER_TIMEOUT.saturating_sub(waited)).unwrap_or(PollTimeout::ZERO);
                let mut fds = [PollFd::new(bus.as_fd(), PollFlags::POLLIN)];
                if let Err(errno) = poll(&mut fds, left)
                    && errno != nix::errno::Errno::EINTR
                {
                    return Err(format!("poll: {}", errno.desc()));
                }
            }
            _ => {}
        }
    }
}
