//! Content of a robot-hour: durations of chaos and calm, rates of faults, behaviour of the operator.

use super::Fault;
use base::Duration;
use kinematics::Shape;
use settings::{Section, Span, Texts, settings};
use std::collections::BTreeSet;

/// Faults of processes, of the disk and of the clock, and what others say on the message bus. All others are of the
/// hardware.
const OF_SOFTWARE: [&str; 18] = [
    "kill",
    "hang",
    "crawl",
    "pause",
    "stop",
    "terminate",
    "run",
    "step",
    "full",
    "engage",
    "drive",
    "plan",
    "plan_unasked",
    "plan_blind",
    "foreign_drive",
    "foreign_pause",
    "foreign_list",
    "foreign_release",
];
/// Targets that stand for each driven wheel, each CAN bus of drives, and each serial line of a drive; the one of the
/// message bus.
const PROPULSION: &str = "propulsion";
const DRIVE_BUSES: &str = "can.main";
const DRIVE_LINES: &str = "serial";
const LCM: &str = "lcm";
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
        /// Time for which the operator lets a planner wait whose way is blocked, before giving up the goal.
        patience_s as patience: f64 = 0.0, 0.0..=DAY;
        /// The wheelbase of what he drives, m: he knows where it will go.
        wheelbase: f64 = unset 0.6;
        /// Behind and ahead of the rear axle, and half its width, m.
        body: (f64, f64, f64) = unset (0.15, 0.75, 0.30);
        /// Its outline within that rectangle; none: the rectangle.
        shape: Option<Shape> = unset None;
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
        /// The robot: a folder in conf.
        config: String = "advee";
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
    /// The same for a robot that does not have all that it names. `propulsion` is every driven wheel, `can.main` every
    /// CAN bus of drives, `serial` every line of `lines`, on which drives are. A fault of the hardware stays for those
    /// of its targets that the robot has with this fault (`has`: target, fault), and is left out with the last of them.
    /// Returns which targets were left out.
    #[must_use]
    pub fn suited(
        mut self,
        wheels: &[&str],
        buses: &[&str],
        lines: &[&str],
        has: impl Fn(&str, &str) -> bool,
    ) -> (Self, BTreeSet<String>) {
        let mut without = BTreeSet::new();
        for kind in self.kinds.iter_mut().filter(|kind| !OF_SOFTWARE.contains(&kind.fault.as_str())) {
            let targets = std::mem::take(&mut kind.targets).into_iter();
            let each = targets.flat_map(|target| match target.as_str() {
                PROPULSION => wheels.iter().copied().map(Into::into).collect(),
                // A robot without CAN buses keeps the name, which is then reported as left out.
                DRIVE_BUSES if !buses.is_empty() => buses.iter().copied().map(Into::into).collect(),
                DRIVE_LINES => lines.iter().copied().map(Into::into).collect(),
                _ => vec![target],
            });
            let (kept, left_out): (Vec<String>, Vec<String>) =
                each.partition(|target| target == LCM || has(target, &kind.fault));
            kind.targets = kept;
            without.extend(left_out);
        }
        self.kinds.retain(|kind| !kind.targets.is_empty());
        (self, without)
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(targets: &[&str], fault: &str) -> Kind {
        Kind {
            name: fault.into(),
            targets: targets.iter().map(|target| (*target).into()).collect(),
            fault: fault.into(),
            per_hour: 1.0,
            value: (0.0, 0.0),
            lasts: (0.0, 0.0),
        }
    }

    #[test]
    fn what_a_robot_does_not_have_is_left_out_and_the_propulsion_is_each_wheel() {
        let kinds = vec![
            kind(&["propulsion", "steering"], "silent"),
            kind(&["sd1_front"], "blind"),
            kind(&["propulsion"], "foreign_pdo"),
            kind(&["guard", "*"], "kill"),
            kind(&["lcm"], "lost"),
            kind(&["rope"], "engage"),
            kind(&["propulsion"], "garbled"),
            kind(&["serial"], "cut"),
            kind(&["can.main"], "cut"),
        ];
        let scenario = Scenario { kinds, ..Scenario::default() };
        // The left wheel is on CAN, the right one on a serial line.
        let has = |name: &str, fault: &str| match name {
            "left" => fault != "garbled",
            "right" => !fault.starts_with("foreign_"),
            _ => name == "serial.right" || name.starts_with("can."),
        };
        let buses = ["can.front", "can.rear"];
        let (suited, without) = scenario.suited(&["left", "right"], &buses, &["serial.right"], has);
        let rows: Vec<_> = suited.kinds.iter().map(|kind| (kind.fault.as_str(), kind.targets.join(","))).collect();
        let expected = [
            ("silent", "left,right"),
            ("foreign_pdo", "left"),
            ("kill", "guard,*"),
            ("lost", "lcm"),
            ("engage", "rope"),
            ("garbled", "right"),
            ("cut", "serial.right"),
            ("cut", "can.front,can.rear"),
        ];
        assert_eq!(rows, expected.map(|(fault, targets)| (fault, targets.to_owned())));
        // Of the wheels, too, one has not all of these faults.
        let left_out = ["left", "right", "sd1_front", "steering"].map(String::from);
        assert_eq!(without, BTreeSet::from(left_out));
    }
}
