//! Deliberate bugs, to show that the rules of `sim::check` find them. Built with the feature `sabotage` only, which no
//! release has; without it [`is`] is a constant and every hook compiles to nothing.
//!
//! A hook is one line where the right thing is done: `!sabotage::is(Bug::PauseIgnored)`.

/// What is done wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bug {
    /// A command of motion is followed for a minute after its source fell silent.
    TimeToLiveIgnored,
    /// A command out of limits is followed.
    LimitsIgnored,
    /// The PAUSE line is taken for open.
    PauseIgnored,
    /// A source that never let go drives on after a stop.
    ResumesByItself,
    /// The newest command of whoever moves the robot.
    TwoAuthorities,
    /// The planner needs nobody's leave.
    PlannerNotLatched,
    /// The planner drives without an estimate.
    EstimateIgnored,
    /// The robot drives with a steering that does not know where it is.
    HomingNotRequired,
    /// The driver of the drives acts in PAUSE and in STOP.
    StateIgnored,
    /// A drive that is lost does not stop the other.
    LostDriveIgnored,
    /// A critical module that does not run does not stop the robot.
    CriticalIgnored,
    /// The robot drives on without a watchdog.
    WatchdogNotMissed,
    /// The watchdog judges no silence.
    WatchdogDeaf,
    /// A module that hangs is started again before its process has ended.
    TwoProcesses,
    /// A module that dies is started again at once, always.
    RestartDelayIgnored,
    /// A module that dies is wanted to RUN, whatever an operator wanted.
    WantedForgotten,
    /// STOP is left by anybody's command.
    StopLeft,
    /// A module that was in STOP when it lost its device is in RUN when that is back.
    StopLeftByError,
    /// Timestamps follow the wall clock, and go back with it.
    WallClock,
}

impl Bug {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::TimeToLiveIgnored,
        Self::LimitsIgnored,
        Self::PauseIgnored,
        Self::ResumesByItself,
        Self::TwoAuthorities,
        Self::PlannerNotLatched,
        Self::EstimateIgnored,
        Self::HomingNotRequired,
        Self::StateIgnored,
        Self::LostDriveIgnored,
        Self::CriticalIgnored,
        Self::WatchdogNotMissed,
        Self::WatchdogDeaf,
        Self::TwoProcesses,
        Self::RestartDelayIgnored,
        Self::WantedForgotten,
        Self::StopLeft,
        Self::StopLeftByError,
        Self::WallClock,
    ];
}

/// Whether this bug is in: never.
#[cfg(not(feature = "sabotage"))]
#[must_use]
#[inline(always)]
pub const fn is(_: Bug) -> bool {
    false
}

#[cfg(feature = "sabotage")]
pub use built::{is, set};

#[cfg(feature = "sabotage")]
mod built {
    use super::Bug;
    use std::cell::Cell;

    thread_local! {
        static BUG: Cell<Option<Bug>> = const { Cell::new(None) };
    }

    /// Puts one bug, or none, into all modules that this thread runs from now on.
    pub fn set(bug: Option<Bug>) {
        BUG.set(bug);
    }

    /// Whether this bug is in.
    #[must_use]
    pub fn is(bug: Bug) -> bool {
        BUG.get() == Some(bug)
    }
}
