//! What modules publish once a second, received by the robot's time: that of a simulation may pass slowly, or stand
//! still.

use super::bus::{Heard, Tool};
use super::{Failed, notice};
use base::{Duration, Instant};
use diagnostics::{Config, Model};
use host::clock;
use messages::{Channel, Message};

/// Channel of the rate at which time passes, which [`Listener`] needs.
pub const OF_TIME: Channel = Channel::SimDataClock;
/// Within this time of the robot each module has published its state and its faults.
pub const ANNOUNCED: Duration = Duration::from_millis(1200);
/// Time limit of the viewer: that of the slowest simulation, 0.05 times real time.
const PATIENCE: Duration = Duration::from_secs(30);
/// Rate below which the model lets values age by the robot's time.
const SLOW: f64 = 0.9;

/// Model of the robot, and how its time passes.
pub struct Listener {
    /// Messages received; its functions take instants of [`Listener::now`].
    pub model: Model,
    /// True while the time of a simulation stands still.
    pub paused: bool,
    /// True while the time of a simulation passes slowly, or stands still.
    is_slow: bool,
}

impl Default for Listener {
    fn default() -> Self {
        let model = Model::new(Config { simulated: true, ..Config::default() });
        Self { model, paused: false, is_slow: false }
    }
}

impl Listener {
    /// The robot's time: age is judged by it.
    pub fn now(&self) -> Instant {
        self.model.at(clock::now())
    }

    /// Receives for `time` of the robot, but not beyond the viewer's time limit, and while the robot's time stands
    /// still for `time` of the viewer; `take` gets each message. False if it was interrupted.
    pub fn listen(&mut self, tool: &mut Tool, time: Duration, mut take: impl FnMut(&Message)) -> Result<bool, Failed> {
        let begun = clock::now();
        let mut from = self.model.at(begun);
        loop {
            let now = clock::now();
            let (passed, left) = match self.paused {
                true => (now.since(begun), time),
                false => (self.model.at(now).since(from), PATIENCE),
            };
            if passed >= time || now.since(begun) >= left {
                return Ok(true);
            }
            // The rate may become another one meanwhile.
            match tool.hear((now + (time - passed)).min(begun + PATIENCE))? {
                Heard::Message(message) => {
                    take(&message);
                    from = self.receive(clock::now(), message).unwrap_or(from);
                }
                Heard::Nothing => {}
                Heard::Interrupt => return Ok(false),
            }
        }
    }

    /// Returns the robot's time if it turns out to pass slowly: what passed until then counted as real time.
    fn receive(&mut self, at: Instant, message: Message) -> Option<Instant> {
        let rate = if let Message::SimDataClock(clock) = &message { Some(clock.rate) } else { None };
        let channel = message.channel_name().into_owned();
        self.model.receive(at, &channel, 0, Some(message));
        self.paused = rate.map_or(self.paused, |rate| rate == 0.0);
        let was_slow = self.is_slow;
        self.is_slow = rate.map_or(was_slow, |rate| rate < SLOW);
        (self.is_slow && !was_slow).then(|| self.model.at(at))
    }

    /// A notice on stderr if time stands still: modules publish nothing then.
    pub fn notice_pause(&self) {
        if self.paused {
            notice(&[format!("{PAUSED}: what modules published before is not known")]);
        }
    }

    /// End of a sentence about a module that does not publish.
    pub fn why_silent(&self) -> &'static str {
        if self.paused { PAUSED_HINT } else { "is advee up?" }
    }
}

const PAUSED: &str = "the simulation is paused, and its modules publish nothing";
const PAUSED_HINT: &str = "the simulation is paused, and its modules publish nothing: advee sim run";

#[cfg(test)]
mod tests {
    use super::*;
    use messages::simulation::DataClock;

    #[test]
    fn a_slow_simulation_is_judged_by_its_own_time_and_a_paused_one_is_known() {
        let clock = |rate| Message::from(DataClock { timestamp: 0, rate });
        let mut listener = Listener::default();
        let at = Instant::from_millis;
        assert_eq!(listener.receive(at(1000), clock(0.1)), Some(at(1000)), "time begins with the first slow rate");
        assert_eq!(listener.model.at(at(2000)), at(1100));
        assert_eq!((listener.receive(at(2000), clock(0.0)), listener.paused), (None, true));
        assert_eq!(listener.model.at(at(3000)), at(1100));
        assert!(listener.why_silent().contains("advee sim run"));
        assert_eq!((listener.receive(at(3000), clock(1.0)), listener.paused), (None, false));
        assert_eq!(listener.why_silent(), "is advee up?");
    }
}
