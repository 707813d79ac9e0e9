//! Releases by an operator: what a deliberate act permits after a stop.
//!
//! Homing moves the wheels, and a PAUSE line that opens must not move the robot: both wait for a deliberate act that is
//! newer than the last other cause of the stop. Such acts are motion of a manual source after its zero, a goal, a mode
//! that is an order to drive, an operator's RUN for this module, the planner or all, and `LL_CMD_HOMING`.

use super::objection::Objection;
use super::steering::{NotHomed, Steering};
use super::surroundings::{self, Surroundings};
use super::{Canbus, NAME};
use base::{Fault, Instant, Severity};
use messages::lowlevel;
use module::{Actions, State};

/// State of the releases.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Releases {
    /// Instant from which on only causes that a release ends hold the robot; absent while there are others.
    since: Option<Instant>,
    /// The operator's start of the robot releases the first homing, which has not begun yet.
    start: bool,
    /// The last act releases the planner, too, when homing has ended: a goal, such a mode, or RUN for the planner or
    /// all.
    goal: bool,
}

impl Releases {
    /// `at_start`: the start of the robot releases the first homing.
    pub(super) fn new(at_start: bool) -> Self {
        Self { start: at_start, ..Self::default() }
    }

    /// True if the start of the robot releases homing now.
    fn starts(&self, around: &Surroundings) -> bool {
        self.start && !around.is_restarted()
    }
}

/// True for a cause that an operator's act ends, at once or by homing.
fn is_released(objection: Objection) -> bool {
    use surroundings::Objection::Paused;
    matches!(objection, Objection::NotHomed(_) | Objection::Around(Paused(super::pause::Paused::Latched)))
}

impl Canbus {
    /// Takes note of the objections; to be called before the decision at `now`.
    pub(super) fn update_releases(&mut self, now: Instant) {
        if !self.objections(now).all(is_released) {
            (self.releases.since, self.releases.goal) = (None, false);
            // The start of the robot remains a release until homing has begun, or has failed to.
            if let Some(steering) = &mut self.steering {
                if steering.is_homing() || steering.failed_to_home() {
                    self.releases.start = false;
                }
                steering.revoke_homing();
            }
            return;
        }
        self.releases.since.get_or_insert(now);
        let standing = self.is_standing();
        let Some(steering) = &mut self.steering else { return };
        if steering.is_homing() || steering.is_homed() {
            self.releases.start = false;
        } else if self.releases.starts(&self.around) && standing {
            steering.release_homing();
        }
    }

    /// A deliberate act, received at `at`: releases what waits for one.
    pub(super) fn on_act(&mut self, now: Instant, at: Instant, goal: bool, out: &mut Actions) {
        if self.releases.since.is_none_or(|since| at < since) {
            return;
        }
        self.around.pause.release();
        let standing = self.is_standing();
        if let Some(steering) = self.steering.as_mut().filter(|_| standing) {
            steering.release_homing();
        }
        self.releases.goal = goal;
        if self.blocked.is_some() && self.objections(now).next().is_none() {
            // Sources were disarmed when the line opened: those that have sent zero since, or act now, are released.
            self.report_change(None, out);
            self.blocked = None;
        }
    }

    /// The last objection, homing, has ended: a goal that came before it counts.
    pub(super) fn release_planner_after_homing(&mut self, now: Instant) {
        if std::mem::take(&mut self.releases.goal) {
            self.arbiter.release_planner(now);
        }
    }

    /// `LL_CMD_HOMING`, received at `at`.
    pub(super) fn on_homing(&mut self, now: Instant, at: Instant, homing: &lowlevel::CmdHoming, out: &mut Actions) {
        let other = self.objections(now).find(|objection| !is_released(*objection));
        let late = self.releases.since.is_none_or(|since| at < since);
        let refused = match homing.axis.as_str() {
            "steering" if self.steering.is_none() => "the base does not steer".into(),
            "steering" if self.state != State::Run => format!("{NAME} is not in RUN"),
            "steering" if !self.is_standing() => "the robot moves".into(),
            "steering" if self.arbiter.is_held_by_hand(now) => "somebody commands the robot".into(),
            "steering" => match other {
                Some(other) => self.words(other),
                None if late => "it is older than the last stop".into(),
                None => {
                    self.on_act(now, at, false, out);
                    return self.steering.iter_mut().for_each(Steering::home_again);
                }
            },
            _ => "only the steering can be homed".into(),
        };
        let axis = homing.axis.as_str();
        let why = format!("homing of {axis:?} refused: {refused}");
        out.report(Severity::Warning, Fault::CommandForbidden, axis, why);
    }

    /// True if homing, the only thing left to do, may move the wheels.
    pub(super) fn may_home(&self) -> bool {
        let waits = matches!(self.blocked, Some(Objection::NotHomed(NotHomed::Unreleased | NotHomed::Unchecked)));
        matches!(self.blocked, Some(Objection::NotHomed(_))) && !waits && self.is_standing()
    }
}
