//! The drive's side of the power state machine, for emulated drives: every transition, and the effect of the option
//! codes. [`Drive::motion`] gives the motion during it.

use super::PowerState;
use super::options::{Options, Stop};

/// A numbered transition of CiA 402-2, Figure 2 (0 to 16), or of the EPOS (17 to 21).
pub type Transition = u8;

/// Motion that the power stage permits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// No motion: the power stage is off.
    Off,
    /// Motion by the mode of operation.
    Follow,
    /// Stop in this way, and stay stopped.
    Stop(Stop),
}

/// The EPOS's two states between Switched On and Operation Enabled; both look like Switched On.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passage {
    /// The power stage is refreshed.
    Refresh,
    /// The current sensors are measured.
    MeasureInit,
}

/// Which state machine a drive has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// CiA 402-2. `enables_from_ready`: a controlword of 0x0F enables from Ready to Switch On (T3, then T4).
    Standard {
        /// See above.
        enables_from_ready: bool,
    },
    /// maxon EPOS, first generation: enables from Ready, passes through [`Passage`], reports faults in motion by T17.
    Epos,
}

/// The power state machine of a drive. Give it every controlword; it answers which transitions were taken.
#[derive(Clone, Debug)]
pub struct Drive {
    kind: Kind,
    options: Options,
    state: PowerState,
    passage: Option<Passage>,
    /// Transition that leaves operation once the motor has stopped.
    pending: Option<(Transition, PowerState)>,
    controlword: u16,
    fault_stop: Stop,
    fault_done: Transition,
}

impl Drive {
    /// A drive that was just switched on (T0): Not Ready to Switch On, until [`Self::initialised`].
    #[must_use]
    pub fn power_on(kind: Kind, options: Options) -> Self {
        Self {
            kind,
            options,
            state: PowerState::NotReady,
            passage: None,
            pending: None,
            controlword: 0,
            fault_stop: Stop::Coast,
            fault_done: 14,
        }
    }

    /// A drive that has made its self test, with this 0x605A; it disables operation without a ramp.
    #[must_use]
    pub fn new(quick_stop_option: i16, enables_from_ready: bool) -> Self {
        let options = Options { quick_stop: quick_stop_option, disable_operation: 0, ..Options::default() };
        let mut drive = Self::power_on(Kind::Standard { enables_from_ready }, options);
        drive.initialised();
        drive
    }

    /// Completes the self test (T1).
    pub fn initialised(&mut self) -> Option<Transition> {
        (self.state == PowerState::NotReady).then(|| self.enter(1, PowerState::SwitchOnDisabled))
    }

    /// The state; Switched On in a [`Passage`].
    #[must_use]
    pub fn state(&self) -> PowerState {
        self.state
    }

    /// Passage of an EPOS between Switched On and Operation Enabled.
    #[must_use]
    pub fn passage(&self) -> Option<Passage> {
        self.passage
    }

    /// The state's bits of the statusword, with voltage.
    #[must_use]
    pub fn statusword(&self) -> u16 {
        self.state.encode()
    }

    /// Sets the option codes.
    pub fn set_options(&mut self, options: Options) {
        self.options = options;
    }

    /// True if quick stop is kept after the motor has stopped.
    #[must_use]
    pub fn keeps_quick_stop(&self) -> bool {
        self.options.quick_stop().1
    }

    /// Motion that is permitted now.
    #[must_use]
    pub fn motion(&self) -> Motion {
        match self.state {
            PowerState::OperationEnabled if self.pending.is_some() => Motion::Stop(Stop::SlowDown),
            PowerState::OperationEnabled => Motion::Follow,
            PowerState::QuickStopActive => Motion::Stop(self.options.quick_stop().0),
            PowerState::FaultReactionActive => Motion::Stop(self.fault_stop),
            PowerState::NotReady
            | PowerState::SwitchOnDisabled
            | PowerState::ReadyToSwitchOn
            | PowerState::SwitchedOn
            | PowerState::Fault => Motion::Off,
        }
    }

    /// Stop by controlword bit 8.
    #[must_use]
    pub fn halt(&self) -> Stop {
        self.options.halt()
    }

    /// Obeys a controlword; gives the transitions taken, in order: at most two.
    pub fn apply(&mut self, controlword: u16) -> heapless::Vec<Transition, 2> {
        let before = core::mem::replace(&mut self.controlword, controlword);
        let mut taken = heapless::Vec::new();
        while let Some((transition, to)) = self.next(before) {
            self.enter(transition, to);
            let full = taken.push(transition).is_err();
            let goes_on = match transition {
                3 => self.enables_from_ready(),
                // A quick stop that only switches off: T12 follows at once.
                11 => self.options.quick_stop().0 == Stop::Coast,
                _ => false,
            };
            if full || !goes_on {
                break;
            }
        }
        taken
    }

    fn enables_from_ready(&self) -> bool {
        matches!(self.kind, Kind::Epos | Kind::Standard { enables_from_ready: true })
    }

    fn next(&mut self, before: u16) -> Option<(Transition, PowerState)> {
        use PowerState::{Fault, OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
        let word = self.controlword;
        let reset = word & !before & 0x80 != 0;
        // CiA 402-2, Table 27; bit 7 is 0 in all but the fault reset.
        let shutdown = word & 0x87 == 0x06;
        let switch_on = word & 0x8F == 0x07;
        let enable = word & 0x8F == 0x0F;
        let disable_voltage = word & 0x82 == 0x00;
        let quick_stop = word & 0x86 == 0x02;
        let (stop, keeps) = self.options.quick_stop();
        Some(match self.state {
            SwitchOnDisabled if shutdown => (2, ReadyToSwitchOn),
            ReadyToSwitchOn if switch_on || enable => (3, SwitchedOn),
            ReadyToSwitchOn if disable_voltage || quick_stop => (7, SwitchOnDisabled),
            SwitchedOn if enable && self.passage.is_none() => (4, OperationEnabled),
            // An EPOS on its way up turns back: there is nothing to brake yet.
            SwitchedOn if switch_on && self.passage.is_some() => (5, SwitchedOn),
            SwitchedOn if shutdown => (6, ReadyToSwitchOn),
            SwitchedOn if disable_voltage || quick_stop => (10, SwitchOnDisabled),
            OperationEnabled if enable => {
                self.pending = None;
                return None;
            }
            OperationEnabled if switch_on => return self.leave(self.options.disables_by_ramp(), (5, SwitchedOn)),
            OperationEnabled if shutdown => return self.leave(self.options.shuts_down_by_ramp(), (8, ReadyToSwitchOn)),
            OperationEnabled if disable_voltage => (9, SwitchOnDisabled),
            OperationEnabled if quick_stop => (11, QuickStopActive),
            QuickStopActive if stop == Stop::Coast => (12, SwitchOnDisabled),
            QuickStopActive if enable && keeps => (16, OperationEnabled),
            QuickStopActive if disable_voltage => (12, SwitchOnDisabled),
            Fault if reset => (15, SwitchOnDisabled),
            _ => return None,
        })
    }

    /// Leaves operation at once, or after the motor has stopped.
    fn leave(&mut self, by_ramp: bool, way: (Transition, PowerState)) -> Option<(Transition, PowerState)> {
        self.pending = by_ramp.then_some(way);
        (!by_ramp).then_some(way)
    }

    fn enter(&mut self, transition: Transition, to: PowerState) -> Transition {
        self.pending = None;
        self.passage = None;
        if transition == 4 && self.kind == Kind::Epos {
            self.passage = Some(Passage::Refresh);
        } else {
            self.state = to;
        }
        transition
    }

    /// Completes a passage of the EPOS: T20 after Refresh, T21 after Measure Init.
    pub fn passed(&mut self) -> Option<Transition> {
        Some(match self.passage? {
            Passage::Refresh => {
                self.passage = Some(Passage::MeasureInit);
                20
            }
            Passage::MeasureInit => self.enter(21, PowerState::OperationEnabled),
        })
    }

    /// Reports that the motor has stopped, and makes the transition that waited for it (T5, T8, T12, T14, T18).
    pub fn stands(&mut self) -> Option<Transition> {
        if let Some((transition, to)) = self.pending {
            return Some(self.enter(transition, to));
        }
        if self.state == PowerState::QuickStopActive && !self.options.quick_stop().1 {
            return Some(self.enter(12, PowerState::SwitchOnDisabled));
        }
        self.fault_reaction_done()
    }

    /// Something is wrong: the reaction of 0x605E. See [`Self::fault_by`].
    pub fn fault(&mut self) -> Option<Transition> {
        self.fault_by(self.options.fault())
    }

    /// Something is wrong: Fault Reaction Active (T13; T17 of an EPOS in motion), from every state but the two of
    /// fault. Where there is nothing to brake, or it coasts, Fault follows at once.
    pub fn fault_by(&mut self, stop: Stop) -> Option<Transition> {
        if matches!(self.state, PowerState::FaultReactionActive | PowerState::Fault) {
            return None;
        }
        let brakes = stop != Stop::Coast && self.motion() != Motion::Off;
        let (transition, done) = if brakes && self.kind == Kind::Epos { (17, 18) } else { (13, 14) };
        (self.fault_stop, self.fault_done) = (stop, done);
        self.enter(transition, PowerState::FaultReactionActive);
        if !brakes {
            self.fault_reaction_done();
        }
        Some(transition)
    }

    /// Completes the fault reaction (T14; T18 of an EPOS in motion).
    pub fn fault_reaction_done(&mut self) -> Option<Transition> {
        let active = self.state == PowerState::FaultReactionActive;
        active.then(|| self.enter(self.fault_done, PowerState::Fault))
    }

    /// Reports the loss of the connection to the master: reacts by option code 0x6007.
    pub fn connection_lost(&mut self) -> Option<Transition> {
        match self.options.abort_connection {
            1 => self.fault(),
            2 => self.apply(super::control::DISABLE_VOLTAGE).first().copied(),
            3 => self.apply(super::control::QUICK_STOP).first().copied(),
            _ => None,
        }
    }
}
