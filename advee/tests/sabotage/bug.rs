//! Deliberate bugs, which show that the rules of `sim::check` find them. No build of the workspace has this file:
//! `hooks.patch` makes it a module of the crate `module`, in the copy of the tree that `tools/sabotage` builds.
//!
//! A hook is one expression where the right thing is done: `!module::bug!(PauseIgnored)`.

use std::cell::Cell;

/// Deliberate bug.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bug {
    /// A motion command is followed for a minute after its source fell silent.
    TimeToLiveIgnored,
    /// A command out of limits is followed.
    LimitsIgnored,
    /// The PAUSE line is assumed to be released.
    PauseIgnored,
    /// A source that was not released drives on after a stop.
    ResumesByItself,
    /// The newest command is followed, whatever its source.
    TwoAuthorities,
    /// The planner needs no release by an operator.
    PlannerNotLatched,
    /// The planner drives without an estimate.
    EstimateIgnored,
    /// The robot drives although the steering has no reference.
    HomingNotRequired,
    /// The driver of the drives acts in PAUSE and in STOP.
    StateIgnored,
    /// A drive that is lost does not stop the other.
    LostDriveIgnored,
    /// A critical module that does not run does not stop the robot.
    CriticalIgnored,
    /// The robot drives on although a ranging board does not measure: what is unknown is free.
    BlindnessIgnored,
    /// The guard takes what its sonars measure for free space.
    EchoesIgnored,
    /// The robot drives on without a watchdog.
    WatchdogNotMissed,
    /// The watchdog ignores missing heartbeats and announcements.
    WatchdogDeaf,
    /// A hung module is started again before its process has ended.
    TwoProcesses,
    /// A module that dies is always restarted at once.
    RestartDelayIgnored,
    /// A module that dies is restarted in RUN, whatever the wanted state.
    WantedForgotten,
    /// STOP is left by a command from any sender.
    StopLeft,
    /// A module that was in STOP when it lost its device is in RUN when the device is back.
    StopLeftByError,
    /// Timestamps follow the wall clock and its steps.
    WallClock,
    /// The state of the PAUSE line is what its last sender reported.
    PauseOfTheLast,
    /// Homing begins without a release once the cause of a stop has ended.
    HomesByItself,
    /// Nothing monitors that the robot stops, and that it is not faster than commanded.
    SpeedUnwatched,
    /// The motors' feed is cut although the drive brakes as commanded.
    FeedCutEarly,
    /// Commands and releases are accepted from any sender.
    AnybodyBelieved,
    /// A motion command of any sender is taken for one of the source that moves the robot; nothing else is accepted.
    AnybodyCommands,
    /// The driver does not apply the bounds of the guard.
    BoundIgnored,
    /// Another CANopen master does not stop the robot.
    RivalIgnored,
    /// The watchdog of another robot does not stop this one.
    SecondRobotIgnored,
    /// A watchdog that is late again and again judges its modules all the same.
    LatenessForgiven,
}

impl Bug {
    /// All bugs.
    pub const ALL: [Self; 31] = [
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
        Self::BlindnessIgnored,
        Self::EchoesIgnored,
        Self::WatchdogNotMissed,
        Self::WatchdogDeaf,
        Self::TwoProcesses,
        Self::RestartDelayIgnored,
        Self::WantedForgotten,
        Self::StopLeft,
        Self::StopLeftByError,
        Self::WallClock,
        Self::PauseOfTheLast,
        Self::HomesByItself,
        Self::SpeedUnwatched,
        Self::FeedCutEarly,
        Self::AnybodyBelieved,
        Self::AnybodyCommands,
        Self::BoundIgnored,
        Self::RivalIgnored,
        Self::SecondRobotIgnored,
        Self::LatenessForgiven,
    ];
}

thread_local! {
    static BUG: Cell<Option<Bug>> = const { Cell::new(None) };
}

/// Selects the bug of all modules that this thread runs from now on; `None`: the code is right.
pub fn set(bug: Option<Bug>) {
    BUG.set(bug);
}

/// Whether a bug is selected.
#[macro_export]
macro_rules! bug {
    ($name:ident) => {
        $crate::sabotage::is($crate::sabotage::Bug::$name)
    };
}

/// Whether this bug is selected; hooks use the macro.
#[must_use]
pub fn is(bug: Bug) -> bool {
    BUG.get() == Some(bug)
}
