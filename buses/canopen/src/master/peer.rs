//! One node, as the master sees it: its state, what it sends, what time does to it.

mod boot;
mod guard;
mod work;

use super::channel::{Channel, Demand};
use super::duplicate::DuplicateIdDetector;
use super::plan::{Work, plan};
use super::shared::Shared;
use super::{BootError, Event, LostReason, MasterConfig, NodeConfig, RequestError, RoundTrip, State, Stats, Step};
use crate::wire::{self, Emergency, NmtCommand, NmtState};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Duration, Instant, earliest};
use guard::Guard;

/// Emergencies are reported this often at most.
const EMERGENCY_EVERY: Duration = Duration::from_millis(100);
/// Unsolicited boot-up messages from which an attempt fails. One is tolerated: a node switched on just when it is reset
/// sends two.
const RESTLESS: u8 = 2;
/// A node that is lost sooner than this after it was booted has not settled …
const SETTLED: Duration = Duration::from_secs(1);
/// … and when that happens so often in a row, it is not booted again at once: it would only be lost again.
const UNSETTLED: u8 = 3;
/// Time that a reset may take. A node whose heartbeat says Operational or Stopped afterwards has missed the command.
const RESET_TAKES: Duration = Duration::from_millis(100);
/// Pause between two writes of [`NodeConfig::stop`] while the boot-up message is awaited.
const STOP_EVERY: Duration = Duration::from_millis(50);
/// NMT starts sent before an attempt fails.
const STARTS: u8 = 3;

/// Stage of an object's write.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Reads it, to decide if it must be written.
    Compare,
    Write,
    /// Writes this COB-ID, with bit 31.
    Close(u32),
    /// Reads it back.
    Verify,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Not begun, or pausing between attempts.
    Resting {
        until: Instant,
    },
    /// Left alone, because the master is about to end; true while the boot-up message after its reset is awaited.
    Left(bool),
    /// The reset command was sent at `sent`; the boot-up message is awaited. At `stop` the next write of
    /// [`NodeConfig::stop`] is due.
    Resetting {
        sent: Instant,
        until: Instant,
        stop: Instant,
    },
    /// Work `at` of the plan is under way on the SDO channel.
    Working {
        at: usize,
        stage: Stage,
        retries_left: u8,
    },
    /// Configured; its heartbeat is awaited.
    Listening {
        until: Instant,
    },
    /// Set up; waits for the other nodes.
    Held {
        until: Instant,
    },
    /// NMT start was sent.
    Starting {
        until: Instant,
        starts_left: u8,
    },
    Running {
        until: Instant,
    },
}

impl Phase {
    fn is_configured(self) -> bool {
        matches!(self, Self::Held { .. } | Self::Starting { .. } | Self::Running { .. })
    }

    fn is_running(self) -> bool {
        matches!(self, Self::Running { .. })
    }
}

#[derive(Default)]
struct Emergencies {
    quiet_until: Instant,
    last: Option<Emergency>,
    suppressed: u32,
}

pub(super) struct Peer {
    config: NodeConfig,
    plan: Vec<(Step, Work)>,
    phase: Phase,
    nmt_state: Option<NmtState>,
    channel: Channel,
    guard: Option<Guard>,
    /// The serial number that was read last.
    serial: Option<u32>,
    /// Another device than before: its stored configuration does not count.
    swapped: bool,
    boot_ups: u8,
    /// Instant of the last boot, and number of losses in a row soon after one.
    booted_at: Instant,
    unsettled: u8,
    duplicate: DuplicateIdDetector,
    reported: Option<(Step, BootError)>,
    emergencies: Emergencies,
    stats: Stats,
}

impl Peer {
    pub(super) fn new(config: NodeConfig, master: &MasterConfig) -> Self {
        Self {
            plan: plan(master, &config),
            channel: Channel::new(config.id, master.sdo_timeout),
            config,
            phase: Phase::Resting { until: Instant::ZERO },
            nmt_state: None,
            guard: None,
            serial: None,
            swapped: false,
            boot_ups: 0,
            booted_at: Instant::ZERO,
            unsettled: 0,
            duplicate: DuplicateIdDetector::default(),
            reported: None,
            emergencies: Emergencies::default(),
            stats: Stats::default(),
        }
    }

    pub(super) fn id(&self) -> u8 {
        self.config.id
    }

    pub(super) fn config(&self) -> &NodeConfig {
        &self.config
    }

    pub(super) fn stats(&self) -> &Stats {
        &self.stats
    }

    pub(super) fn take_round_trips(&mut self) -> RoundTrip {
        core::mem::take(&mut self.stats.round_trip)
    }

    pub(super) fn nmt_state(&self) -> Option<NmtState> {
        self.nmt_state
    }

    pub(super) fn is_operational(&self) -> bool {
        self.phase.is_running()
    }

    /// True if an SDO answer is awaited.
    pub(super) fn is_asked(&self) -> bool {
        !self.channel.is_idle()
    }

    pub(super) fn state(&self) -> State {
        match self.phase {
            Phase::Resting { .. } | Phase::Left(_) => State::Resting,
            Phase::Running { .. } => State::Operational,
            _ => State::Booting(self.step()),
        }
    }

    /// Longest permitted silence.
    fn limit(&self) -> Duration {
        self.config.guarding.map_or(self.config.heartbeat_limit, super::Guarding::limit)
    }

    pub(super) fn heartbeat(&mut self, now: Instant, arrived: Instant, frame: &Frame, shared: &mut Shared) {
        let Some(state) = wire::decode_heartbeat(frame.data()) else {
            return self.malformed(shared);
        };
        if state != NmtState::Initialising
            && let Some(guard) = &mut self.guard
        {
            let answer = guard.answered(wire::guard_toggle(frame.data()));
            match answer {
                guard::Answer::Good => {}
                guard::Answer::Odd => return,
                guard::Answer::Two => return self.two(now, shared),
            }
        }
        self.nmt_state = Some(state);
        match (state, self.phase) {
            (NmtState::Initialising, Phase::Running { .. }) => {
                self.lose(now, shared, LostReason::BootUp);
            }
            (NmtState::Initialising, Phase::Resetting { .. }) => self.work(now, shared, 0),
            (NmtState::Initialising, Phase::Resting { .. }) if self.unsettled < UNSETTLED => self.first(now, shared),
            (NmtState::Initialising, Phase::Left(_)) => self.phase = Phase::Left(false),
            (NmtState::Initialising, Phase::Resting { .. }) => {}
            (NmtState::Initialising, _) => self.booted_unasked(now, shared),
            (NmtState::Operational | NmtState::Stopped, Phase::Resetting { sent, until, .. })
                if arrived.since(sent) >= RESET_TAKES =>
            {
                self.reset(now, until, shared);
            }
            (NmtState::Operational, Phase::Running { until }) => {
                let two = self.guard.is_none() && self.duplicate.beat(arrived, self.config.heartbeat);
                // A step of the clock that stamps the frames does not shorten the node's time limit.
                self.phase = Phase::Running { until: until.max(arrived + self.limit()) };
                if two {
                    self.two(now, shared);
                }
            }
            (NmtState::Operational, Phase::Starting { .. }) => self.booted(now, shared),
            (state, Phase::Running { .. }) => self.lose(now, shared, LostReason::State(state)),
            (_, Phase::Listening { .. }) => self.configured(now, shared),
            (_, Phase::Held { .. }) => self.phase = Phase::Held { until: arrived + self.limit() },
            (
                _,
                Phase::Starting { .. }
                | Phase::Working { .. }
                | Phase::Resetting { .. }
                | Phase::Resting { .. }
                | Phase::Left(_),
            ) => {}
        }
    }

    pub(super) fn sdo_response(&mut self, now: Instant, frame: &Frame, shared: &mut Shared) {
        if frame.data().len() != 8 {
            return self.malformed(shared);
        }
        self.channel.handle_rx(now, frame.data(), shared);
        self.advance(now, shared);
    }

    /// Another client asks this node: its answers are not for us.
    pub(super) fn asked_by_others(&mut self) {
        self.duplicate.forgive(self.stats.ignored);
    }

    pub(super) fn emergency(&mut self, now: Instant, frame: &Frame, shared: &mut Shared) {
        let Some(emergency) = Emergency::decode(frame.data()) else {
            return self.malformed(shared);
        };
        self.stats.emergencies = self.stats.emergencies.saturating_add(1);
        if now < self.emergencies.quiet_until {
            if self.emergencies.last.replace(emergency).is_some() {
                self.emergencies.suppressed = self.emergencies.suppressed.saturating_add(1);
            }
        } else {
            self.tell_emergency(now, emergency, shared);
        }
    }

    fn tell_emergency(&mut self, now: Instant, emergency: Emergency, shared: &mut Shared) {
        let suppressed = core::mem::take(&mut self.emergencies).suppressed;
        self.emergencies.quiet_until = now + EMERGENCY_EVERY;
        shared.events.push(Event::Emergency { node: self.id(), emergency, suppressed });
    }

    pub(super) fn tpdo(&mut self, number: u8, frame: &Frame, shared: &mut Shared) {
        if !self.is_operational() {
            return;
        }
        // CiA 301, 7.2.2.6: a PDO shorter than its mapping is not processed.
        if frame.data().len() < self.mapped_len(number) {
            return self.malformed(shared);
        }
        self.stats.pdos = self.stats.pdos.saturating_add(1);
        let mut data = [0; 8];
        data[..frame.data().len()].copy_from_slice(frame.data());
        shared.events.push(Event::Pdo { node: self.id(), number, data, len: frame.dlc() });
    }

    /// Length of a TPDO by the mappings that are required of the node; 0 for any other PDO.
    fn mapped_len(&self, number: u8) -> usize {
        let record = 0x17FF + u16::from(number);
        let mapping = self.config.mappings.iter().find(|mapping| mapping.record == record);
        let bits = mapping.map_or(0, |mapping| mapping.entries.iter().map(|entry| entry & 0xFF).sum());
        usize::try_from(bits.div_ceil(8)).unwrap_or(usize::MAX)
    }

    fn malformed(&mut self, shared: &mut Shared) {
        self.stats.malformed = self.stats.malformed.saturating_add(1);
        let count = self.stats.malformed;
        if count.is_power_of_two() {
            shared.events.push(Event::Malformed { node: self.id(), count });
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        self.channel.handle_timeout(now, shared);
        self.advance(now, shared);
        self.watch(now, shared);
        match self.phase {
            Phase::Resting { until } if until <= now && self.channel.is_idle() => {
                self.first(now, shared);
            }
            Phase::Resetting { until, .. } if until <= now => self.work(now, shared, 0),
            Phase::Resetting { sent, until, stop } if stop <= now => {
                self.stop_unasked(now, shared);
                self.phase = Phase::Resetting { sent, until, stop: now + STOP_EVERY };
            }
            Phase::Listening { until } | Phase::Held { until } if until <= now => {
                self.fail(now, shared, BootError::NoHeartbeat);
            }
            Phase::Starting { until, starts_left } if until <= now => match (starts_left, self.nmt_state) {
                (0, Some(state)) => self.fail(now, shared, BootError::NotStarted { state }),
                (0, None) => self.fail(now, shared, BootError::NoHeartbeat),
                (left, _) => self.start(now, shared, left),
            },
            Phase::Running { until } if until <= now => {
                let reason = if self.guard.is_some() { LostReason::Guarding } else { LostReason::Heartbeat };
                self.lose(now, shared, reason);
            }
            _ => {}
        }
        if now >= self.emergencies.quiet_until
            && let Some(emergency) = self.emergencies.last
        {
            self.tell_emergency(now, emergency, shared);
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let sdo = self.channel.poll_timeout();
        let phase = match self.phase {
            // The channel's own deadline comes first while a request on demand is under way.
            Phase::Resting { until } => self.channel.is_idle().then_some(until),
            Phase::Working { .. } | Phase::Left(_) => None,
            Phase::Resetting { until, stop, .. } => Some(until.min(stop)),
            Phase::Listening { until } | Phase::Held { until } => Some(until),
            Phase::Starting { until, .. } | Phase::Running { until } => Some(until),
        };
        let emergency = self.emergencies.last.map(|_| self.emergencies.quiet_until);
        let guard = self.guard.as_ref().map(Guard::next);
        earliest([sdo, phase, emergency, guard])
    }

    pub(super) fn poll_tx(&mut self) -> Option<Frame> {
        self.channel.poll_tx()
    }

    pub(super) fn request(&mut self, now: Instant, demand: Demand, shared: &mut Shared) -> Result<(), RequestError> {
        if !self.channel.push(demand) {
            return Err(RequestError::QueueFull);
        }
        self.pump(now, shared);
        Ok(())
    }

    pub(super) fn reboot(&mut self, now: Instant, shared: &mut Shared) {
        if self.is_operational() {
            self.lose(now, shared, LostReason::Reboot);
        } else {
            self.first(now, shared);
        }
    }

    /// Resets the communication of a node that was started, and leaves it alone: it no longer watches the master, which
    /// is about to end. It does not boot again before [`Self::reboot`].
    pub(super) fn leave(&mut self, shared: &mut Shared) {
        self.channel.forget(shared);
        let was_started = self.is_operational();
        if was_started {
            shared.outbox.drop_pdos(self.id());
            shared.outbox.push(wire::nmt(NmtCommand::ResetCommunication, self.id()));
        }
        self.nmt_state = None;
        self.guard = None;
        self.enter(Phase::Left(was_started), shared);
    }

    pub(super) fn has_left(&self) -> bool {
        self.phase == Phase::Left(false)
    }

    pub(super) fn bus_down(&mut self, now: Instant, shared: &mut Shared) {
        if self.is_operational() {
            self.stats.losses = self.stats.losses.saturating_add(1);
            shared.events.push(Event::Lost { node: self.id(), reason: LostReason::BusDown });
        }
        self.channel.forget(shared);
        self.nmt_state = None;
        self.rest(now, shared);
    }
}
