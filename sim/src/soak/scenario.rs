//! Content of a robot-hour: durations of chaos and calm, rates of faults, behaviour of the operator.

use base::Duration;

/// A scenario, read from a file by the caller.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// From the start of an episode's robot to its first chaos: modules start, the steering is homed.
    pub settle: Duration,
    /// Duration of a chaos phase, with faults.
    pub chaos: Duration,
    /// Duration of the calm phase after it, without faults.
    pub calm: Duration,
    /// Number of such pairs in an episode.
    pub turns: u32,
    /// Maximum additional latency of a message.
    pub lcm_jitter: Duration,
    /// Probability that a receiver misses a message at any time.
    pub lcm_loss: f64,
    /// Maximum delay before a dead process is restarted.
    pub restart_delay_max: Duration,
    /// Maximum time until the robot moves in calm, without homing.
    pub moves_within: Duration,
    /// Behaviour of the operator.
    pub operator: Behaviour,
    /// Possible faults, in the order of their names.
    pub kinds: Vec<Kind>,
}

/// A kind of fault.
#[derive(Clone, Debug, PartialEq)]
pub struct Kind {
    /// Name in reports: `process_hung`.
    pub name: String,
    /// Targets, equally likely: modules, buses, boards, drives, `lcm`, `clock`.
    pub targets: Vec<String>,
    /// Fault, by the names of `SIM_CMD_FAULT`, and for modules and the clock of [`super::Fault`].
    pub fault: String,
    /// Rate, per hour of chaos.
    pub per_hour: f64,
    /// Minimum and maximum value.
    pub value: (f64, f64),
    /// Minimum and maximum duration, s; cut off by the end of the chaos. 0: momentary.
    pub lasts: (f64, f64),
}

/// Behaviour of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behaviour {
    /// Maximum speed, m/s.
    pub speed: f64,
    /// Maximum steering angle, rad.
    pub steering: f64,
    /// Minimum distance to visible obstacles, m.
    pub clearance: f64,
    /// Minimum and maximum duration of a leg, s.
    pub leg: (f64, f64),
    /// Probability of silence at the end of a leg, instead of a new leg or zero.
    pub silence: f64,
    /// Probability of commanding zero there.
    pub zero: f64,
    /// Wheelbase of the robot, m, to predict its path.
    pub wheelbase: f64,
    /// Extent of the body behind and ahead of the rear axle, and half its width, m.
    pub body: (f64, f64, f64),
}

impl Default for Behaviour {
    fn default() -> Self {
        Self {
            speed: 0.6,
            steering: 0.5,
            clearance: 0.3,
            leg: (1.0, 6.0),
            silence: 0.2,
            zero: 0.2,
            wheelbase: 0.6,
            body: (0.15, 0.75, 0.30),
        }
    }
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            settle: Duration::from_secs(20),
            chaos: Duration::from_secs(60),
            calm: Duration::from_secs(60),
            turns: 5,
            lcm_jitter: Duration::from_micros(200),
            lcm_loss: 0.0,
            restart_delay_max: Duration::from_secs(2),
            moves_within: Duration::from_secs(20),
            operator: Behaviour::default(),
            kinds: Vec::new(),
        }
    }
}

/// Phase of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The robot starts.
    Settle,
    /// Faults are injected.
    Chaos,
    /// No faults.
    Calm,
}

impl Scenario {
    /// The phases of an episode with their ends, in order.
    pub fn phases(&self) -> impl Iterator<Item = (Phase, Duration)> {
        let (settle, chaos, turn) = (self.settle, self.chaos, self.chaos + self.calm);
        let turns = (0..self.turns).map(move |number| settle + turn * number);
        let pair = move |begin| [(Phase::Chaos, begin + chaos), (Phase::Calm, begin + turn)];
        std::iter::once((Phase::Settle, settle)).chain(turns.flat_map(pair))
    }

    /// Duration of an episode.
    #[must_use]
    pub fn episode(&self) -> Duration {
        self.settle + (self.chaos + self.calm) * self.turns
    }
}
