//! What may cross, decided at both ends: the allow-list, the state of the module, the age, the time stamp, the rate.

use crate::allow::{AllowList, Entry, Nature, Verdict, nature, subject};
use base::{Duration, Instant};
use messages::{Channel, Message};
use module::admission;

/// Maximum size of a message that is decoded although the rate is too high: it may stop the robot. Bytes.
const STOP_SIZE_MAX: usize = 4 << 10;

/// What passes in a state of the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Passes {
    /// STOP and TERMINATE: nothing.
    #[default]
    Nothing,
    /// PAUSE: data, events, and what stops the robot; no other commands.
    Data,
    /// RUN and ERROR: all that is allowed.
    All,
}

/// Why a message does not cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dropped {
    /// Its channel is not in the list, or its module is not of the computer that it comes from.
    Forbidden,
    /// The state of the module does not permit it.
    State,
    /// It was under way for too long, or for a time that is not known.
    Late,
    /// Its time stamp is in the future.
    Future,
    /// It is no message of its channel, or too large.
    Malformed,
    /// Its rate, or that of all messages, is too high.
    TooOften,
}

/// Rules of a connection.
#[derive(Clone, Debug)]
pub struct Rules {
    /// Channels that this end sends.
    pub send: Vec<Entry>,
    /// Channels that this end accepts.
    pub receive: Vec<Entry>,
    /// Modules of this computer.
    pub modules: Vec<String>,
    /// Maximum age of a message that is accepted.
    pub age_max: Duration,
    /// Maximum time by which a time stamp may be in the future.
    pub future_max: Duration,
    /// Maximum number of messages that are accepted in a second; of those that stop the robot as many again.
    pub rate_max: u32,
}

/// The gate of a connection.
#[derive(Clone, Debug)]
pub struct Gate {
    send: AllowList,
    receive: AllowList,
    modules: Vec<String>,
    age_max: Duration,
    future_max: Duration,
    rate_max: u32,
    /// Begin of the running second, and number of messages in it: of those that stop the robot, and of others.
    second: (Instant, [u32; 2]),
}

/// Arrival of a message.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Time of its arrival.
    pub now: Instant,
    /// The same as a time stamp of messages, µs since the UNIX epoch.
    pub timestamp: i64,
    /// Its greatest possible age; `None`: not known.
    pub age: Option<Duration>,
    /// What the state of the module lets pass.
    pub passes: Passes,
}

impl Gate {
    /// Gate with these rules.
    #[must_use]
    pub fn new(rules: Rules) -> Self {
        let Rules { send, receive, modules, age_max, future_max, rate_max } = rules;
        let [send, receive] = [send, receive].map(AllowList::new);
        Self { send, receive, modules, age_max, future_max, rate_max, second: (Instant::ZERO, [0; 2]) }
    }

    /// Decides about a message of this computer's bus; `module`: the module that it is about, if its channel is one of
    /// [`crate::allow::OF_MODULES`].
    ///
    /// # Errors
    /// It stays here.
    pub fn sends(&mut self, now: Instant, passes: Passes, channel: &str, module: Option<&str>) -> Result<(), Dropped> {
        if module.is_some_and(|module| !self.is_ours(module)) {
            return Err(Dropped::Forbidden);
        }
        judged(passes, channel, self.send.judge(now, channel))
    }

    /// Decides about a message of this computer's bus that stops the robot ([`admission::stops`]): a list that limits
    /// its rate, or PAUSE, does not hold it back.
    ///
    /// # Errors
    /// It stays here.
    pub fn sends_stop(&self, passes: Passes, channel: &str) -> Result<(), Dropped> {
        stop_judged(passes, self.send.allows(channel))
    }

    /// Decides about a message of the other computer. One that stops the robot ([`admission::stops`]) passes however
    /// late it is, whatever its time stamp, and beyond the rate of others: a stop that is dropped might not come again.
    ///
    /// # Errors
    /// It is dropped.
    pub fn receives(&mut self, arrival: Arrival, channel: &str, payload: &[u8]) -> Result<(), Dropped> {
        let Arrival { now, timestamp, age, passes } = arrival;
        let known = Channel::from_name(channel);
        // Before anything that takes time.
        if !self.receive.allows(channel) || nature(channel) == Nature::Never {
            return Err(Dropped::Forbidden);
        }
        if now.since(self.second.0) >= Duration::from_secs(1) {
            self.second = (now, [0; 2]);
        }
        let is_full = self.second.1.map(|count| count >= self.rate_max);
        if is_full[1] && (is_full[0] || payload.len() > STOP_SIZE_MAX) {
            return Err(Dropped::TooOften);
        }
        let decoded = known.map(|known| {
            let decoded = Message::receive(channel, payload).and_then(Result::ok);
            decoded.filter(|_| payload.len() <= known.size_max())
        });
        let stops = decoded.as_ref().is_some_and(|decoded| decoded.as_ref().is_some_and(admission::stops));
        let place = usize::from(!stops);
        if is_full[place] {
            return Err(Dropped::TooOften);
        }
        self.second.1[place] += 1;
        if stops {
            return stop_judged(passes, true);
        }
        if age.is_none_or(|age| age > self.age_max) {
            return Err(Dropped::Late);
        }
        if let Some(decoded) = decoded {
            let message = decoded.ok_or(Dropped::Malformed)?;
            // A module of this computer publishes here, and nobody else in its name.
            if subject(&message).is_some_and(|module| self.is_ours(module)) {
                return Err(Dropped::Forbidden);
            }
            let future = i64::try_from(self.future_max.as_micros()).unwrap_or(i64::MAX);
            if message.timestamp() > timestamp.saturating_add(future) {
                return Err(Dropped::Future);
            }
        }
        judged(passes, channel, self.receive.judge(now, channel))
    }

    fn is_ours(&self, module: &str) -> bool {
        self.modules.iter().any(|name| name == module)
    }
}

fn stop_judged(passes: Passes, is_allowed: bool) -> Result<(), Dropped> {
    match (is_allowed, passes) {
        (false, _) => Err(Dropped::Forbidden),
        (true, Passes::Nothing) => Err(Dropped::State),
        (true, Passes::Data | Passes::All) => Ok(()),
    }
}

fn judged(passes: Passes, channel: &str, verdict: Verdict) -> Result<(), Dropped> {
    let needed = if nature(channel) == Nature::Data { Passes::Data } else { Passes::All };
    match verdict {
        Verdict::Forbidden => Err(Dropped::Forbidden),
        _ if passes < needed => Err(Dropped::State),
        Verdict::TooOften => Err(Dropped::TooOften),
        Verdict::Passes => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{common, lowlevel};

    fn gate() -> Gate {
        let list = |texts: &[&str]| texts.iter().filter_map(|text| Entry::parse(text)).collect();
        Gate::new(Rules {
            send: list(&["LL_DATA_ODO", "CM_DATA_STATE"]),
            receive: list(&["LL_CMD_MOTION", "LL_EVENT_STOP@1", "HL_*", "CM_DATA_STATE"]),
            modules: vec!["driver_canbus".into()],
            age_max: Duration::from_millis(250),
            future_max: Duration::from_millis(50),
            rate_max: 5,
        })
    }

    const ARRIVAL: Arrival = Arrival {
        now: Instant::from_millis(1000),
        timestamp: 1_000_000,
        age: Some(Duration::from_millis(10)),
        passes: Passes::All,
    };

    fn bytes(message: impl Into<Message>) -> Vec<u8> {
        let mut bytes = Vec::new();
        message.into().encode(&mut bytes).unwrap();
        bytes
    }

    fn motion(timestamp: i64) -> Vec<u8> {
        bytes(lowlevel::CmdMotion { timestamp, speed: 0.4, source: "far".into(), ..Default::default() })
    }

    #[test]
    fn a_command_crosses_if_it_is_named_fresh_and_well_formed() {
        let judge = |arrival, payload: &[u8]| gate().receives(arrival, "LL_CMD_MOTION", payload);
        assert_eq!(judge(ARRIVAL, &motion(1_000_000)), Ok(()));
        assert_eq!(judge(ARRIVAL, &motion(0)), Ok(()), "without a time stamp");
        assert_eq!(judge(ARRIVAL, &motion(1_050_001)), Err(Dropped::Future));
        assert_eq!(judge(ARRIVAL, &motion(1_050_000)), Ok(()));
        assert_eq!(judge(ARRIVAL, &motion(1)[1..]), Err(Dropped::Malformed));
        let of = |age| Arrival { age, ..ARRIVAL };
        assert_eq!(judge(of(Some(Duration::from_millis(251))), &motion(1)), Err(Dropped::Late));
        assert_eq!(judge(of(None), &motion(1)), Err(Dropped::Late), "unknown is not fresh");
        assert_eq!(gate().receives(ARRIVAL, "LL_CMD_VELOCITY", &motion(1)), Err(Dropped::Forbidden));
    }

    #[test]
    fn in_pause_data_cross_and_no_commands_and_in_stop_nothing() {
        let judge = |passes, channel, payload: &[u8]| gate().receives(Arrival { passes, ..ARRIVAL }, channel, payload);
        assert_eq!(judge(Passes::Data, "LL_CMD_MOTION", &motion(1)), Err(Dropped::State));
        assert_eq!(judge(Passes::Data, "HL_DATA_FACES", b"anything"), Ok(()));
        assert_eq!(judge(Passes::Nothing, "HL_DATA_FACES", b"anything"), Err(Dropped::State));
        assert_eq!(gate().sends(ARRIVAL.now, Passes::Nothing, "LL_DATA_ODO", None), Err(Dropped::State));
        assert_eq!(gate().sends(ARRIVAL.now, Passes::Data, "LL_DATA_ODO", None), Ok(()));
        assert_eq!(gate().sends(ARRIVAL.now, Passes::All, "LL_DATA_MOTION", None), Err(Dropped::Forbidden));
    }

    #[test]
    fn a_module_is_announced_by_its_own_computer_alone() {
        let state = |module: &str| bytes(common::DataState { module: module.into(), ..Default::default() });
        let mut gate = gate();
        assert_eq!(gate.receives(ARRIVAL, "CM_DATA_STATE", &state("camera")), Ok(()));
        assert_eq!(gate.receives(ARRIVAL, "CM_DATA_STATE", &state("driver_canbus")), Err(Dropped::Forbidden));
        assert_eq!(gate.sends(ARRIVAL.now, Passes::All, "CM_DATA_STATE", Some("driver_canbus")), Ok(()));
        // What came from there does not go back.
        assert_eq!(gate.sends(ARRIVAL.now, Passes::All, "CM_DATA_STATE", Some("camera")), Err(Dropped::Forbidden));
    }

    #[test]
    fn a_flood_is_bounded() {
        let mut gate = gate();
        let mut judge = |now| gate.receives(Arrival { now, ..ARRIVAL }, "HL_DATA_FACES", b"");
        let outcomes: Vec<_> = (0..7).map(|_| judge(ARRIVAL.now)).collect();
        assert_eq!(outcomes[..5], [Ok(()); 5]);
        assert_eq!(outcomes[5..], [Err(Dropped::TooOften); 2]);
        assert_eq!(judge(ARRIVAL.now + Duration::from_secs(1)), Ok(()));
    }

    #[test]
    fn what_stops_the_robot_passes_late_often_and_in_pause_and_what_releases_it_does_not() {
        let stop = |engaged, timestamp| bytes(lowlevel::EventStop { timestamp, engaged, source: "mast".into() });
        let (engaged, released) = (stop(true, 9_000_000), stop(false, 1));
        let late = Arrival { age: Some(Duration::from_secs(1)), passes: Passes::Data, ..ARRIVAL };
        let mut gate = gate();
        assert_eq!(gate.receives(late, "LL_EVENT_STOP", &released), Err(Dropped::Late));
        assert_eq!(gate.receives(late, "LL_EVENT_STOP", &engaged), Ok(()));
        assert_eq!(gate.receives(Arrival { age: None, ..late }, "LL_EVENT_STOP", &engaged), Ok(()), "of unknown age");
        // Others have used up their rate, and the list limits that of the channel.
        while gate.receives(ARRIVAL, "HL_DATA_FACES", b"").is_ok() {}
        assert_eq!(gate.receives(ARRIVAL, "LL_EVENT_STOP", &released), Err(Dropped::TooOften));
        (0..3).for_each(|_| assert_eq!(gate.receives(ARRIVAL, "LL_EVENT_STOP", &engaged), Ok(())));
        assert_eq!(gate.receives(ARRIVAL, "LL_EVENT_STOP", &engaged), Err(Dropped::TooOften), "bounded, too");

        let mut gate = self::gate();
        let nothing = Arrival { passes: Passes::Nothing, ..ARRIVAL };
        assert_eq!(gate.receives(nothing, "LL_EVENT_STOP", &engaged), Err(Dropped::State));
        let command = bytes(common::CmdState { module: "*".into(), state: 3, ..Default::default() });
        assert_eq!(gate.receives(ARRIVAL, "CM_CMD_STATE", &command), Err(Dropped::Forbidden), "not in the list");
        assert_eq!(gate.sends_stop(Passes::Data, "LL_DATA_ODO"), Ok(()));
        assert_eq!(gate.sends_stop(Passes::All, "LL_EVENT_STOP"), Err(Dropped::Forbidden));
    }
}
