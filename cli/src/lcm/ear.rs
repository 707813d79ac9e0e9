//! Reception from the bus, undecoded, until the time is over or Ctrl-C.

use crate::bus::{interrupt, wait};
use crate::{Common, Failed, complain};
use base::{Duration, Instant};
use host::clock;
use lcm::Url;
use lcm::live::Lcm;
use nix::sys::signalfd::SignalFd;
use std::os::fd::AsFd;

/// Maximum number of messages taken before Ctrl-C and the time are checked.
const IN_A_ROW: u32 = 64;

/// A listener.
pub struct Ear {
    lcm: Lcm,
    interrupt: SignalFd,
    until: Instant,
    /// Messages taken since it was last waited.
    taken: u32,
    drained: bool,
}

/// Received message.
pub struct Raw<'a> {
    pub channel: &'a str,
    pub data: &'a [u8],
    /// Kernel time of reception, nanoseconds since the UNIX epoch.
    pub received_ns: u64,
}

/// Result of [`Ear::hear`].
pub enum Heard<'a> {
    Message(Raw<'a>),
    /// Nothing for now, or time to wake up.
    Nothing,
    /// End of the time, or of the log.
    End,
    /// Ctrl-C or SIGTERM.
    Interrupt,
}

/// Losses on all channels; complete only while all of them are received.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Messages missing in the publishers' sequence numbers.
    pub lost: u64,
    /// Of these, messages that the kernel had no room for.
    pub kernel_dropped: u64,
    /// Messages of which some fragments came and others did not.
    pub incomplete: u64,
    /// Datagrams that are not LCM's.
    pub malformed: u64,
    /// Publishers: address, datagrams, lost messages; those with most losses first.
    pub publishers: Vec<(String, u64, u64)>,
}

impl Ear {
    /// Listens to the channels of a regular expression, which must match the whole name.
    pub fn open(common: &Common, pattern: &str, time: Option<Duration>) -> Result<Self, Failed> {
        let interrupt = interrupt()?;
        let name = common.lcm_url();
        let (url, _) = Url::parse(&name).map_err(|error| Failed::from(error.to_string()))?;
        let mut lcm = Lcm::new(&url).map_err(|error| Failed::from(format!("LCM bus {name}: {error}")))?;
        lcm.subscribe(pattern).map_err(|error| Failed::from(error.to_string()))?;
        let until = time.map_or(Instant::NEVER, |time| clock::now() + time);
        Ok(Self { lcm, interrupt, until, taken: 0, drained: false })
    }

    /// The next message, unless `wake` comes before.
    pub fn hear(&mut self, wake: Instant) -> Result<Heard<'_>, Failed> {
        if self.drained || self.taken >= IN_A_ROW {
            if let Ok(Some(_)) = self.interrupt.read_signal() {
                return Ok(Heard::Interrupt);
            }
            let now = clock::now();
            if now >= self.until {
                return Ok(Heard::End);
            }
            if now >= wake {
                return Ok(Heard::Nothing);
            }
            if self.drained {
                wait(&[self.lcm.as_fd(), self.interrupt.as_fd()], self.until.min(wake).since(now))?;
            }
            (self.drained, self.taken) = (false, 0);
        }
        match self.lcm.recv() {
            Ok(Some(message)) => {
                self.taken += 1;
                let received_ns = u64::try_from(message.at.0).unwrap_or_default();
                Ok(Heard::Message(Raw { channel: message.channel, data: message.payload, received_ns }))
            }
            Ok(None) => {
                self.drained = true;
                Ok(Heard::Nothing)
            }
            // A log that is played.
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(Heard::End),
            Err(error) => Err(format!("LCM bus: {error}").into()),
        }
    }

    pub fn losses(&self) -> Losses {
        let stats = self.lcm.stats();
        let sources = self.lcm.udpm().map(lcm::live::Udpm::sources).unwrap_or_default();
        let mut publishers: Vec<_> =
            sources.iter().map(|source| (source.from.to_string(), source.datagrams, source.lost)).collect();
        publishers.sort_by_key(|(_, _, lost)| std::cmp::Reverse(*lost));
        Losses {
            lost: stats.lost,
            kernel_dropped: stats.kernel_dropped,
            incomplete: stats.incomplete,
            malformed: stats.malformed,
            publishers,
        }
    }
}

/// Reports that nothing was received, which is an answer and no error.
pub fn silence(common: &Common, pattern: &str, time: Option<Duration>) {
    let what = if pattern == ".*" { "nothing".into() } else { format!("nothing on {}", pattern.escape_debug()) };
    let within = time.map(|time| format!(" within {} s", time.as_secs_f64())).unwrap_or_default();
    complain(&format!("{what} is heard on {}{within}; is anyone publishing?", common.lcm_url()));
}
