//! The drive's side of the power state machine, for emulated drives.

use super::PowerState;

/// A numbered transition of CiA 402-2, Figure 2 (2 to 16).
pub type Transition = u8;

/// The power state machine of a drive. Give it every controlword; it answers which transitions were taken.
#[derive(Clone, Debug)]
pub struct Drive {
    state: PowerState,
    controlword: u16,
    /// 0x605A; 5 to 8 stay in Quick Stop Active.
    quick_stop_option: i16,
    /// Whether a controlword of 0x0F enables from Ready to Switch On (T3, then T4). EPOS does.
    enables_from_ready: bool,
}

impl Drive {
    /// A drive after power-on that has made its self test (T0, T1): Switch On Disabled.
    #[must_use]
    pub fn new(quick_stop_option: i16, enables_from_ready: bool) -> Self {
        Self { state: PowerState::SwitchOnDisabled, controlword: 0, quick_stop_option, enables_from_ready }
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> PowerState {
        self.state
    }

    /// The state's bits of the statusword, with voltage.
    #[must_use]
    pub fn statusword(&self) -> u16 {
        self.state.encode()
    }

    /// What 0x605A holds.
    pub fn set_quick_stop_option(&mut self, option: i16) {
        self.quick_stop_option = option;
    }

    /// Whether quick stop is kept when the drive stands.
    #[must_use]
    pub fn keeps_quick_stop(&self) -> bool {
        (5..=8).contains(&self.quick_stop_option)
    }

    /// Obeys a controlword; gives the transitions taken, in order: none, one, or T3 and T4.
    pub fn apply(&mut self, controlword: u16) -> heapless::Vec<Transition, 2> {
        let before = core::mem::replace(&mut self.controlword, controlword);
        let mut taken = heapless::Vec::new();
        while let Some((transition, to)) = self.next(before) {
            self.state = to;
            let full = taken.push(transition).is_err();
            if full || transition != 3 || !self.enables_from_ready {
                break;
            }
        }
        taken
    }

    fn next(&self, before: u16) -> Option<(Transition, PowerState)> {
        use PowerState::{Fault, OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
        let word = self.controlword;
        let reset = word & !before & 0x80 != 0;
        // CiA 402-2, Table 27; bit 7 is 0 in all but the fault reset.
        let shutdown = word & 0x87 == 0x06;
        let switch_on = word & 0x87 == 0x07;
        let enable = word & 0x8F == 0x0F;
        let disable_voltage = word & 0x82 == 0x00;
        let quick_stop = word & 0x86 == 0x02;
        Some(match self.state {
            SwitchOnDisabled if shutdown => (2, ReadyToSwitchOn),
            ReadyToSwitchOn if switch_on => (3, SwitchedOn),
            ReadyToSwitchOn if disable_voltage || quick_stop => (7, SwitchOnDisabled),
            SwitchedOn if enable => (4, OperationEnabled),
            SwitchedOn if shutdown => (6, ReadyToSwitchOn),
            SwitchedOn if disable_voltage || quick_stop => (10, SwitchOnDisabled),
            OperationEnabled if switch_on && !enable => (5, SwitchedOn),
            OperationEnabled if shutdown => (8, ReadyToSwitchOn),
            OperationEnabled if disable_voltage => (9, SwitchOnDisabled),
            OperationEnabled if quick_stop && self.quick_stop_option == 0 => (9, SwitchOnDisabled),
            OperationEnabled if quick_stop => (11, QuickStopActive),
            QuickStopActive if enable && self.keeps_quick_stop() => (16, OperationEnabled),
            QuickStopActive if disable_voltage => (12, SwitchOnDisabled),
            Fault if reset => (15, SwitchOnDisabled),
            _ => return None,
        })
    }

    /// The drive stands: leaves Quick Stop Active when 0x605A says so (T12).
    pub fn stands(&mut self) -> Option<Transition> {
        if self.state != PowerState::QuickStopActive || self.keeps_quick_stop() {
            return None;
        }
        self.state = PowerState::SwitchOnDisabled;
        Some(12)
    }

    /// Something is wrong: Fault Reaction Active (T13), from every state but the two of fault.
    pub fn fault(&mut self) -> Option<Transition> {
        if matches!(self.state, PowerState::FaultReactionActive | PowerState::Fault) {
            return None;
        }
        self.state = PowerState::FaultReactionActive;
        Some(13)
    }

    /// The reaction is over (T14).
    pub fn fault_reaction_done(&mut self) -> Option<Transition> {
        if self.state != PowerState::FaultReactionActive {
            return None;
        }
        self.state = PowerState::Fault;
        Some(14)
    }
}
