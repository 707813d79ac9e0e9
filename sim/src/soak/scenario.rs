//! Content of a robot-hour: durations of chaos and calm, rates of faults, behaviour of the operator.

use super::Fault;
use base::Duration;
use settings::{Section, Span, Texts, settings};

/// A day, s.
const DAY: f64 = 86_400.0;

settings! {
    /// A scenario: times, rates, and the kinds of faults. Its keys are described in docs/soak.md.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Scenario {
        /// Time from the start of an episode's robot to its first chaos: modules come up, the steering is homed.
        settle_s as settle: Duration = 20.0, 0.0..=DAY;
        /// Duration of each chaos.
        chaos_s as chaos: Duration = 60.0, 1.0..=DAY;
        /// Duration without faults after it.
        calm_s as calm: Duration = 60.0, 1.0..=DAY;
        /// Number of times of both in an episode.
        turns: u32 = 5, 1..=10_000;
        /// Longest delay before a dead process is started again.
        restart_delay_max_s as restart_delay_max: Duration = 2.0, 0.1..=DAY;
        /// In calm the robot has moved within this time, homing not counted.
        moves_within_s as moves_within: Duration = 20.0, 1.0..=DAY;
        /// Longest addition to the usual latency of a message.
        lcm_jitter_s as lcm_jitter: Duration = 0.0002, 0.0..=0.1;
        /// Probability that a receiver misses a message, always.
        lcm_loss: f64 = 0.0, 0.0..=1.0;
        /// Worlds of the episodes, in turn, unless one is given; none: the one that a simulated robot has.
        worlds: Vec<String> = Vec::<String>::new(), Texts("a list of names in conf/worlds");
        /// Behaviour of the operator.
        operator: Behaviour = table;
        /// Possible faults, in the order of their names.
        faults as kinds: Vec<Kind> = named;
    }
}

settings! {
    /// `[faults.<name>]`: a kind of fault.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Kind {
        /// Name in reports: `process_hung`.
        name: String = key;
        /// Targets, equally likely.
        targets: Vec<String> = required, Texts("a list of modules, buses, boards, drives, \"lcm\" or \"clock\"");
        /// What happens to the target (docs/soak.md).
        fault: String = required;
        /// Rate of it in chaos.
        per_hour: f64 = required, 0.0..=3600.0;
        /// Least and greatest value.
        value: (f64, f64) = (0.0, 0.0), Span(-1e9..=1e9);
        /// Shortest and longest duration; cut by the end of the chaos. 0: momentary.
        lasts_s as lasts: (f64, f64) = (0.0, 0.0), Span(0.0..=DAY);
    }
}

settings! {
    /// `[operator]`: behaviour of the operator.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Behaviour {
        /// Greatest speed.
        speed_mps as speed: f64 = 0.6, 0.1..=10.0;
        /// Greatest steering angle.
        steering_rad as steering: f64 = 0.5, 0.1..=1.5;
        /// Distance kept to what he sees.
        clearance_m as clearance: f64 = 0.3, 0.0..=100.0;
        /// Least and greatest duration of a piece of a drive.
        leg_s as leg: (f64, f64) = (1.0, 6.0), Span(0.1..=DAY);
        /// Probability of falling silent at the end of a piece, instead of going on or commanding zero.
        silence: f64 = 0.2, 0.0..=1.0;
        /// Probability of commanding zero there.
        zero: f64 = 0.2, 0.0..=1.0;
        /// The wheelbase of what he drives, m: he knows where it will go.
        wheelbase: f64 = unset 0.6;
        /// Behind and ahead of the rear axle, and half its width, m.
        body: (f64, f64, f64) = unset (0.15, 0.75, 0.30);
    }
}

settings! {
    /// `[[regressions]]`: an episode that once failed.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Regression {
        /// Cause, in words.
        cause: String = required;
        /// The seed of the soak.
        seed: u64 = required, 0..=u64::MAX;
        /// The number of the episode.
        episode: u64 = required, 0..=u64::MAX;
        /// The world.
        world: String = "hall";
        /// With the visitors of the world; the first failures are from before there were any.
        people: bool = false;
        /// The faults that it took.
        faults: Vec<Fault> = [];
    }
}

settings! {
    /// A file of what once failed.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Regressions {
        /// Episodes.
        regressions: Vec<Regression> = [];
    }
}

impl Default for Scenario {
    fn default() -> Self {
        Self::usual()
    }
}

impl Default for Behaviour {
    fn default() -> Self {
        Self::usual()
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
