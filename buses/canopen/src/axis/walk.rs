//! The master's side: from the state that is seen to the goal that is set, one command at a time.

use super::{PowerState, control, status};
use base::listed;
use base::{Duration, Instant, Queue};

listed! {
    /// Target state of an axis.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Goal {
        /// No torque: Switch On Disabled. An enabled axis is disabled by its ramp (0x605C) first.
        Disabled => "disabled",
        /// Operation Enabled.
        Enabled => "operation enabled",
        /// Stopped by the quick stop ramp; torque stays if the drive keeps it.
        QuickStop => "quick stop",
    }
}

/// Timing of the walk through a drive's state machine.
#[derive(Clone, Copy, Debug)]
pub struct AxisConfig {
    /// Time limit of each transition; default 1 s.
    pub transition_timeout: Duration,
    /// Time limit of the ramp of Disable Operation (0x605C); default 10 s.
    pub ramp_timeout: Duration,
    /// The controlword that stops; default 0x0002. EPOS notes use 0x000B.
    pub quick_stop: u16,
    /// True if Quick Stop Active is left by enabling (T16); default false: walk up from Switch On Disabled.
    pub resumes: bool,
}

impl Default for AxisConfig {
    fn default() -> Self {
        Self {
            transition_timeout: Duration::from_secs(1),
            ramp_timeout: Duration::from_secs(10),
            quick_stop: control::QUICK_STOP,
            resumes: false,
        }
    }
}

/// Events of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisEvent {
    /// The state that is seen changed.
    State {
        /// `None`: nothing was seen yet.
        from: Option<PowerState>,
        /// State seen now.
        to: PowerState,
    },
    /// The goal was reached.
    Reached(Goal),
    /// A fault is seen. The goal is Disabled now.
    Fault {
        /// Statusword seen.
        statusword: u16,
    },
    /// An enabled axis left Operation Enabled by itself. The goal is Disabled now.
    Dropped {
        /// To where.
        to: PowerState,
        /// Statusword seen.
        statusword: u16,
    },
    /// A transition exceeded its time limit; reported once for each. The command stays.
    Stuck {
        /// Present state; `None`: no statusword was received.
        state: Option<PowerState>,
        /// Target state.
        goal: Goal,
        /// Newest statusword.
        statusword: u16,
        /// Present controlword.
        controlword: u16,
        /// Obstacle, as far as the statusword shows it.
        why: Why,
    },
}

listed! {
    /// Why a transition does not come.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Why {
        /// No statusword was received.
        Unseen => "no statusword was seen",
        /// Bit 9 is 0.
        NotRemote => "the drive does not listen to its controlword (remote is 0)",
        /// The self test goes on.
        NotReady => "its self test goes on",
        /// The fault reaction goes on.
        Braking => "it is braking for a fault",
        /// The fault stays though it was reset.
        Persists => "the cause of the fault persists",
        /// The ramp of Disable Operation goes on.
        Ramp => "it is still on its ramp",
        /// Bit 4 is 0 on the way up.
        NoVoltage => "the power stage has no voltage",
        /// No cause visible in the statusword.
        Refused => "the drive does not say why",
    }
}

impl Why {
    fn read(state: Option<PowerState>, goal: Goal, statusword: u16) -> Self {
        use PowerState::{Fault, FaultReactionActive, NotReady, OperationEnabled, ReadyToSwitchOn, SwitchedOn};
        match state {
            None => Self::Unseen,
            Some(NotReady) => Self::NotReady,
            Some(FaultReactionActive) => Self::Braking,
            Some(Fault) => Self::Persists,
            Some(_) if statusword & status::REMOTE == 0 => Self::NotRemote,
            Some(OperationEnabled) if goal == Goal::Disabled => Self::Ramp,
            Some(ReadyToSwitchOn | SwitchedOn) if statusword & status::VOLTAGE == 0 => Self::NoVoltage,
            Some(_) => Self::Refused,
        }
    }
}

/// The master's view of one axis. It never commands enable without a request, nor after a fault, a drop or a loss
/// before a deliberate act ([`Self::release`]).
pub struct Axis {
    config: AxisConfig,
    goal: Goal,
    state: Option<PowerState>,
    statusword: u16,
    reached: bool,
    /// A stop was commanded and not seen yet: leaving Operation Enabled is no surprise.
    stopping: bool,
    halted: bool,
    /// A fault, a drop or a loss: it is not enabled before a deliberate act.
    locked: bool,
    reset: Reset,
    until: Option<Instant>,
    events: Queue<AxisEvent, 8>,
}

/// The rising edge that resets a fault: first low long enough for the drive to see it, then high until the fault
/// is gone.
#[derive(Clone, Copy, PartialEq)]
enum Reset {
    Idle,
    Low { until: Instant },
    High,
}

/// Time that bit 7 stays low before it rises, so that a drive that samples its controlword sees the edge.
const LOW_FOR: Duration = Duration::from_millis(20);

impl Axis {
    /// An axis of which nothing was seen, to be disabled.
    #[must_use]
    pub fn new(config: AxisConfig) -> Self {
        Self {
            config,
            goal: Goal::Disabled,
            state: None,
            statusword: 0,
            reached: false,
            stopping: false,
            halted: false,
            locked: false,
            reset: Reset::Idle,
            until: None,
            events: Queue::new(),
        }
    }

    /// Sets the goal. In Fault it is taken, but a fault must be reset first. While the axis is locked, Enabled is taken
    /// as QuickStop, so that a caller may repeat its goal.
    pub fn set_goal(&mut self, now: Instant, goal: Goal) {
        let goal = if self.locked && goal == Goal::Enabled { Goal::QuickStop } else { goal };
        if self.goal == goal {
            return;
        }
        self.goal = goal;
        if goal != Goal::Enabled {
            self.stopping = self.state.is_none_or(|state| state == PowerState::OperationEnabled);
        }
        self.reached = false;
        self.arm(now);
        self.check_reached();
    }

    /// The goal; Disabled after a fault, a drop or a loss.
    #[must_use]
    pub fn goal(&self) -> Goal {
        self.goal
    }

    /// A deliberate act, newer than the last fault, drop or loss: the axis may be enabled again. Without effect while a
    /// fault is seen.
    pub fn release(&mut self) {
        if !matches!(self.state, Some(PowerState::Fault | PowerState::FaultReactionActive)) {
            self.locked = false;
        }
    }

    /// True after a fault, a drop or a loss, until [`Self::release`].
    #[must_use]
    pub fn is_locked(&self) -> bool {
        self.locked
    }

    /// Halts by 0x605D while enabled, or continues; the state stays. Not every drive supports it in cyclic modes.
    pub fn halt(&mut self, halted: bool) {
        self.halted = halted;
    }

    /// Asks for a fault reset; without a fault nothing happens.
    pub fn reset_fault(&mut self, now: Instant) {
        if self.state == Some(PowerState::Fault) && self.reset == Reset::Idle {
            self.reset = Reset::Low { until: now + LOW_FOR };
            self.until = None;
        }
    }

    /// Reports the loss of the node: its state is unknown, and enable must be released and requested again.
    pub fn lost(&mut self) {
        let events = core::mem::take(&mut self.events);
        *self = Self { events, locked: true, ..Self::new(self.config) };
    }

    /// True if the goal was seen reached.
    #[must_use]
    pub fn is_reached(&self) -> bool {
        self.reached
    }

    /// The state seen last.
    #[must_use]
    pub fn state(&self) -> Option<PowerState> {
        self.state
    }

    /// The statusword seen last.
    #[must_use]
    pub fn statusword(&self) -> u16 {
        self.statusword
    }

    /// True if the axis is enabled, as requested.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.goal == Goal::Enabled && self.state == Some(PowerState::OperationEnabled)
    }

    /// A statusword from the drive. Patterns that name no state change nothing.
    pub fn handle_statusword(&mut self, now: Instant, statusword: u16) {
        let Some(to) = PowerState::decode(statusword) else {
            return;
        };
        let from = self.state.replace(to);
        self.statusword = statusword;
        if from == Some(to) {
            return;
        }
        self.events.push(AxisEvent::State { from, to });
        self.react(from, to);
        self.arm(now);
        self.check_reached();
    }

    fn react(&mut self, from: Option<PowerState>, to: PowerState) {
        let statusword = self.statusword;
        let stopping = self.stopping;
        if to != PowerState::OperationEnabled {
            self.stopping = false;
        }
        match to {
            PowerState::Fault | PowerState::FaultReactionActive => {
                if from != Some(PowerState::FaultReactionActive) {
                    self.events.push(AxisEvent::Fault { statusword });
                }
                self.goal = Goal::Disabled;
                self.locked = true;
            }
            _ if from == Some(PowerState::OperationEnabled) && self.goal == Goal::Enabled && !stopping => {
                self.events.push(AxisEvent::Dropped { to, statusword });
                self.goal = Goal::Disabled;
                self.locked = true;
            }
            _ => {}
        }
        self.reached = false;
        if to != PowerState::Fault {
            self.reset = Reset::Idle;
        }
    }

    fn is_there(&self) -> bool {
        use PowerState::{Fault, NotReady, OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled};
        match self.goal {
            Goal::Enabled => self.state == Some(OperationEnabled),
            Goal::Disabled => matches!(self.state, Some(SwitchOnDisabled | Fault | NotReady)),
            Goal::QuickStop => {
                matches!(self.state, Some(QuickStopActive | SwitchOnDisabled | ReadyToSwitchOn | Fault | NotReady))
            }
        }
    }

    fn check_reached(&mut self) {
        if self.is_there() && self.reset == Reset::Idle {
            self.until = None;
            if !self.reached {
                self.reached = true;
                self.events.push(AxisEvent::Reached(self.goal));
            }
        }
    }

    fn arm(&mut self, now: Instant) {
        let ramp = self.goal == Goal::Disabled && self.state == Some(PowerState::OperationEnabled);
        let timeout = if ramp { self.config.ramp_timeout } else { self.config.transition_timeout };
        self.until = Some(now + timeout);
    }

    /// The controlword to send now, and again whenever a statusword came or the goal changed. Its mode specific
    /// bits are zero, but for halt.
    #[must_use]
    pub fn controlword(&self) -> u16 {
        use PowerState::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
        match (self.goal, self.state) {
            (_, Some(PowerState::Fault)) if self.reset == Reset::High => control::FAULT_RESET,
            (_, Some(PowerState::Fault)) => control::DISABLE_VOLTAGE,
            (Goal::QuickStop, _) => self.config.quick_stop,
            (_, None | Some(PowerState::NotReady | PowerState::FaultReactionActive)) => control::DISABLE_VOLTAGE,
            (Goal::Enabled, Some(SwitchOnDisabled)) => control::SHUTDOWN,
            (Goal::Enabled, Some(ReadyToSwitchOn)) => control::SWITCH_ON,
            (Goal::Enabled, Some(OperationEnabled)) if self.halted => control::ENABLE | control::HALT,
            (Goal::Enabled, Some(SwitchedOn | OperationEnabled)) => control::ENABLE,
            (Goal::Enabled, Some(QuickStopActive)) if self.config.resumes => control::ENABLE,
            (Goal::Disabled, Some(OperationEnabled)) => control::SWITCH_ON,
            (Goal::Disabled, Some(SwitchedOn)) => control::SHUTDOWN,
            (Goal::Disabled, Some(SwitchOnDisabled | ReadyToSwitchOn))
            | (Goal::Enabled | Goal::Disabled, Some(QuickStopActive)) => control::DISABLE_VOLTAGE,
        }
    }

    /// Reports a transition that exceeded its time limit.
    pub fn handle_timeout(&mut self, now: Instant) {
        if matches!(self.reset, Reset::Low { until } if until <= now) {
            self.reset = Reset::High;
            self.arm(now);
        }
        if self.until.take_if(|until| *until <= now).is_some() {
            let controlword = self.controlword();
            let Self { state, goal, statusword, .. } = *self;
            self.reset = Reset::Idle;
            let why = Why::read(state, goal, statusword);
            self.events.push(AxisEvent::Stuck { state, goal, statusword, controlword, why });
        }
    }

    /// Next event.
    pub fn poll_event(&mut self) -> Option<AxisEvent> {
        self.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.reset {
            Reset::Low { until } => Some(until),
            Reset::Idle | Reset::High => self.until,
        }
    }
}
