//! One node, as the master sees it.

use super::plan::{Work, plan};
use super::{
    BootError, ConfigWrite, Event, Expect, LostReason, MasterConfig, NodeConfig, RequestError,
    State, Stats, Step, Ticket,
};
use crate::wire::{self, Emergency, NmtCommand, NmtState, Service};
use crate::{Payload, sdo};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Duration, Instant, Queue};

/// Emergencies are reported this often at most.
const EMERGENCY_EVERY: Duration = Duration::from_millis(100);
/// Boot-up messages that nobody asked for before an attempt fails. One is forgiven: a node that was switched on
/// just when it was reset sends two.
const RESTLESS: u8 = 2;
/// NMT starts sent before an attempt fails.
const STARTS: u8 = 3;

/// What all nodes of a master share.
pub(super) struct Shared {
    pub(super) config: MasterConfig,
    pub(super) tx: Queue<Frame, 64>,
    pub(super) events: Queue<Event, 128>,
}

/// An SDO request on demand that has the channel.
#[derive(Clone, Copy)]
struct Active {
    ticket: Ticket,
    index: u16,
    sub: u8,
    write: bool,
}

/// An SDO request on demand.
pub(super) struct Demand {
    pub(super) ticket: Ticket,
    pub(super) index: u16,
    pub(super) sub: u8,
    /// `None`: read.
    pub(super) write: Option<Payload>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Not begun, or resting between attempts.
    Resting {
        until: Instant,
    },
    /// Reset; its boot-up message is awaited.
    Resetting {
        until: Instant,
    },
    /// Work `at` of the plan is under way on the SDO channel; `verify`: its read-back.
    Working {
        at: usize,
        verify: bool,
        retries_left: u8,
    },
    /// Configured; its heartbeat is awaited.
    Listening {
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
    sdo: sdo::Client,
    /// The on-demand request under way, and those that wait.
    demand: Option<Active>,
    demands: Queue<Demand, 16>,
    boot_ups: u8,
    reported: Option<(Step, BootError)>,
    emergencies: Emergencies,
    stats: Stats,
}

impl Peer {
    pub(super) fn new(config: NodeConfig, master: &MasterConfig) -> Self {
        Self {
            plan: plan(master, &config),
            config,
            phase: Phase::Resting {
                until: Instant::ZERO,
            },
            nmt_state: None,
            sdo: sdo::Client::new(master.sdo_timeout),
            demand: None,
            demands: Queue::new(),
            boot_ups: 0,
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

    pub(super) fn nmt_state(&self) -> Option<NmtState> {
        self.nmt_state
    }

    pub(super) fn is_operational(&self) -> bool {
        matches!(self.phase, Phase::Running { .. })
    }

    pub(super) fn state(&self) -> State {
        match self.phase {
            Phase::Resting { .. } => State::Resting,
            Phase::Running { .. } => State::Operational,
            _ => State::Booting(self.step()),
        }
    }

    fn step(&self) -> Step {
        match self.phase {
            Phase::Resting { .. } | Phase::Resetting { .. } => Step::BootUp,
            Phase::Working { at, .. } => self.plan[at].0,
            Phase::Listening { .. } => Step::ErrorControl,
            Phase::Starting { .. } | Phase::Running { .. } => Step::Start,
        }
    }

    // ---- boot-up

    /// A new attempt. It begins with a reset even when the node has just booted: only so a second node with the
    /// same id shows, by its own boot-up message.
    fn begin(&mut self, now: Instant, shared: &mut Shared) {
        self.abandon(shared);
        self.nmt_state = None;
        if self.config.reset {
            shared
                .tx
                .push(wire::nmt(NmtCommand::ResetCommunication, self.id()));
            self.phase = Phase::Resetting {
                until: now + self.config.boot_timeout,
            };
        } else {
            self.work(now, shared, 0, false);
        }
    }

    fn first(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups = 0;
        self.begin(now, shared);
    }

    /// Gives up the transfer under way; one on demand is told so.
    fn abandon(&mut self, shared: &mut Shared) {
        self.sdo.cancel();
        if let Some(Active {
            ticket, index, sub, ..
        }) = self.demand.take()
        {
            let error = sdo::Error::Cancelled;
            shared.events.push(Event::SdoFailed {
                node: self.id(),
                ticket,
                index,
                sub,
                error,
            });
        }
    }

    fn work(&mut self, now: Instant, shared: &mut Shared, at: usize, verify: bool) {
        let retries_left = shared.config.sdo_retries;
        let heard = self.nmt_state == Some(NmtState::PreOperational);
        self.phase = match self.plan.get(at) {
            Some(_) => Phase::Working {
                at,
                verify,
                retries_left,
            },
            // A write of 0x1017 starts the heartbeat at once, so it may have come during the read-back.
            None if heard => return self.start(now, shared, STARTS),
            None => Phase::Listening {
                until: now + self.config.heartbeat_limit,
            },
        };
        self.pump(now, shared);
    }

    /// Gives the free SDO channel its next transfer.
    fn pump(&mut self, now: Instant, shared: &mut Shared) {
        if self.sdo.is_idle() {
            match self.phase {
                Phase::Working { at, verify, .. } => self.transfer(now, at, verify),
                Phase::Running { .. } => self.serve(now),
                Phase::Resting { until } if now < until => self.serve(now),
                Phase::Resting { .. }
                | Phase::Resetting { .. }
                | Phase::Listening { .. }
                | Phase::Starting { .. } => {}
            }
        }
        self.flush(shared);
    }

    fn flush(&mut self, shared: &mut Shared) {
        while let Some(data) = self.sdo.poll_tx() {
            shared.tx.push(Frame::standard(
                Service::SdoRequest { node: self.id() }.cob_id(),
                &data,
            ));
        }
    }

    fn transfer(&mut self, now: Instant, at: usize, verify: bool) {
        self.stats.requests = self.stats.requests.saturating_add(1);
        match (self.plan[at].1, verify) {
            (Work::Write(write), false) => {
                self.sdo.write(now, write.index, write.sub, write.payload())
            }
            (
                Work::Write(ConfigWrite { index, sub, .. }) | Work::Read(Expect { index, sub, .. }),
                _,
            ) => self.sdo.read(now, index, sub),
        };
    }

    fn serve(&mut self, now: Instant) {
        let Some(Demand {
            ticket,
            index,
            sub,
            write,
        }) = self.demands.pop()
        else {
            return;
        };
        self.stats.requests = self.stats.requests.saturating_add(1);
        self.demand = Some(Active {
            ticket,
            index,
            sub,
            write: write.is_some(),
        });
        match write {
            Some(data) => self.sdo.write(now, index, sub, data),
            None => self.sdo.read(now, index, sub),
        };
    }

    /// Takes the end of a transfer and goes on.
    fn advance(&mut self, now: Instant, shared: &mut Shared) {
        self.flush(shared);
        if let Some(done) = self.sdo.poll_done() {
            match done.result {
                Ok(_) => self.stats.succeeded(done.took),
                Err(sdo::Error::Timeout) => {
                    self.stats.timeouts = self.stats.timeouts.saturating_add(1);
                }
                Err(_) => {}
            }
            match (self.demand.take(), self.phase) {
                (Some(active), _) => self.answer(active, done, shared),
                (
                    None,
                    Phase::Working {
                        at,
                        verify,
                        retries_left,
                    },
                ) => {
                    self.worked(now, shared, done, (at, verify, retries_left));
                }
                (None, _) => {}
            }
        }
        self.pump(now, shared);
    }

    fn answer(&self, active: Active, done: sdo::Done, shared: &mut Shared) {
        let (
            node,
            Active {
                ticket,
                index,
                sub,
                write,
            },
        ) = (self.id(), active);
        shared.events.push(match done.result {
            Ok(_) if write => Event::SdoWritten {
                node,
                ticket,
                index,
                sub,
            },
            Ok(data) => Event::SdoRead {
                node,
                ticket,
                index,
                sub,
                data,
            },
            Err(error) => Event::SdoFailed {
                node,
                ticket,
                index,
                sub,
                error,
            },
        });
    }

    fn worked(
        &mut self,
        now: Instant,
        shared: &mut Shared,
        done: sdo::Done,
        (at, verify, retries_left): (usize, bool, u8),
    ) {
        let (index, sub) = (done.index, done.sub);
        let data = match done.result {
            Ok(data) => data,
            Err(sdo::Error::Timeout) if retries_left > 0 => {
                self.stats.retries = self.stats.retries.saturating_add(1);
                self.phase = Phase::Working {
                    at,
                    verify,
                    retries_left: retries_left - 1,
                };
                return;
            }
            Err(error) => return self.fail(now, shared, BootError::Sdo { index, sub, error }),
        };
        let mismatch = match self.plan[at].1 {
            Work::Write(_) if !verify => return self.work(now, shared, at, true),
            Work::Write(write) => {
                (data != write.payload()).then_some((u32::MAX, write.value.bits()))
            }
            Work::Read(expect) => {
                let holds = data.bits().is_some_and(|found| expect.holds(found));
                (!holds).then_some((expect.mask, expect.min))
            }
        };
        match mismatch {
            None => self.work(now, shared, at + 1, false),
            Some((mask, expected)) => {
                let found = data.bits().unwrap_or(0) & mask;
                self.fail(
                    now,
                    shared,
                    BootError::Mismatch {
                        index,
                        sub,
                        expected,
                        found,
                    },
                );
            }
        }
    }

    fn fail(&mut self, now: Instant, shared: &mut Shared, reason: BootError) {
        let step = self.step();
        if self.reported.replace((step, reason)) != Some((step, reason)) {
            shared.events.push(Event::BootFailed {
                node: self.id(),
                step,
                reason,
            });
        }
        self.abandon(shared);
        self.phase = Phase::Resting {
            until: now + shared.config.retry,
        };
    }

    fn lose(&mut self, now: Instant, shared: &mut Shared, reason: LostReason) {
        self.stats.losses = self.stats.losses.saturating_add(1);
        self.drop_pdos(shared);
        shared.events.push(Event::Lost {
            node: self.id(),
            reason,
        });
        self.first(now, shared);
    }

    /// No stale command may reach a drive that comes back (yarp-devices #246, #251).
    fn drop_pdos(&self, shared: &mut Shared) {
        for _ in 0..shared.tx.len() {
            let Some(frame) = shared.tx.pop() else { break };
            let ours = matches!(Service::of(&frame), Some(Service::Rpdo { node, .. }) if node == self.id());
            if !ours {
                shared.tx.push(frame);
            }
        }
    }

    // ---- inputs

    pub(super) fn heartbeat(&mut self, now: Instant, frame: &Frame, shared: &mut Shared) {
        let Some(state) = wire::decode_heartbeat(frame.data()) else {
            return self.malformed(shared);
        };
        self.nmt_state = Some(state);
        match (state, self.phase) {
            (NmtState::Initialising, Phase::Running { .. }) => {
                self.lose(now, shared, LostReason::BootUp);
            }
            (NmtState::Initialising, Phase::Resetting { .. }) => self.work(now, shared, 0, false),
            (NmtState::Initialising, Phase::Resting { .. }) => self.first(now, shared),
            (NmtState::Initialising, _) => self.booted_unasked(now, shared),
            (NmtState::Operational, Phase::Running { .. }) => {
                self.phase = Phase::Running {
                    until: now + self.config.heartbeat_limit,
                };
            }
            (NmtState::Operational, Phase::Starting { .. }) => self.booted(now, shared),
            (state, Phase::Running { .. }) => self.lose(now, shared, LostReason::State(state)),
            (_, Phase::Listening { .. }) => self.start(now, shared, STARTS),
            (
                _,
                Phase::Starting { .. }
                | Phase::Working { .. }
                | Phase::Resetting { .. }
                | Phase::Resting { .. },
            ) => {}
        }
    }

    fn booted_unasked(&mut self, now: Instant, shared: &mut Shared) {
        self.boot_ups += 1;
        if self.boot_ups >= RESTLESS {
            return self.fail(now, shared, BootError::Restless);
        }
        self.begin(now, shared);
    }

    fn start(&mut self, now: Instant, shared: &mut Shared, starts_left: u8) {
        shared.tx.push(wire::nmt(NmtCommand::Start, self.id()));
        let until = now + self.config.heartbeat_limit;
        self.phase = Phase::Starting {
            until,
            starts_left: starts_left - 1,
        };
    }

    fn booted(&mut self, now: Instant, shared: &mut Shared) {
        self.phase = Phase::Running {
            until: now + self.config.heartbeat_limit,
        };
        self.reported = None;
        self.stats.boots = self.stats.boots.saturating_add(1);
        shared.events.push(Event::Booted { node: self.id() });
        self.pump(now, shared);
    }

    pub(super) fn sdo_response(&mut self, now: Instant, frame: &Frame, shared: &mut Shared) {
        if frame.data().len() != 8 {
            return self.malformed(shared);
        }
        self.sdo.handle_rx(now, frame.data());
        self.stats.ignored = self.sdo.ignored();
        self.advance(now, shared);
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
        shared.events.push(Event::Emergency {
            node: self.id(),
            emergency,
            suppressed,
        });
    }

    pub(super) fn tpdo(&mut self, number: u8, frame: &Frame, shared: &mut Shared) {
        if !self.is_operational() {
            return;
        }
        self.stats.pdos = self.stats.pdos.saturating_add(1);
        let mut data = [0; 8];
        data[..frame.data().len()].copy_from_slice(frame.data());
        shared.events.push(Event::Pdo {
            node: self.id(),
            number,
            data,
            len: frame.dlc(),
        });
    }

    fn malformed(&mut self, shared: &mut Shared) {
        self.stats.malformed = self.stats.malformed.saturating_add(1);
        let count = self.stats.malformed;
        if count.is_power_of_two() {
            shared.events.push(Event::Malformed {
                node: self.id(),
                count,
            });
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        self.sdo.handle_timeout(now);
        self.advance(now, shared);
        match self.phase {
            Phase::Resting { until } if until <= now && self.sdo.is_idle() => {
                self.first(now, shared);
            }
            Phase::Resetting { until } if until <= now => self.work(now, shared, 0, false),
            Phase::Listening { until } if until <= now => {
                self.fail(now, shared, BootError::NoHeartbeat);
            }
            Phase::Starting { until, starts_left } if until <= now => {
                match (starts_left, self.nmt_state) {
                    (0, Some(state)) => self.fail(now, shared, BootError::NotStarted { state }),
                    (0, None) => self.fail(now, shared, BootError::NoHeartbeat),
                    (left, _) => self.start(now, shared, left),
                }
            }
            Phase::Running { until } if until <= now => {
                self.lose(now, shared, LostReason::Heartbeat);
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
        let sdo = self.sdo.poll_timeout();
        let phase = match self.phase {
            // The channel's own deadline comes first while a request on demand is under way.
            Phase::Resting { until } => self.sdo.is_idle().then_some(until),
            Phase::Working { .. } => None,
            Phase::Resetting { until } | Phase::Listening { until } => Some(until),
            Phase::Starting { until, .. } | Phase::Running { until } => Some(until),
        };
        let emergency = self.emergencies.last.map(|_| self.emergencies.quiet_until);
        [sdo, phase, emergency].into_iter().flatten().min()
    }

    // ---- commands

    pub(super) fn request(
        &mut self,
        now: Instant,
        demand: Demand,
        shared: &mut Shared,
    ) -> Result<(), RequestError> {
        if !self.demands.push(demand) {
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

    pub(super) fn bus_down(&mut self, now: Instant, shared: &mut Shared) {
        if self.is_operational() {
            self.stats.losses = self.stats.losses.saturating_add(1);
            shared.events.push(Event::Lost {
                node: self.id(),
                reason: LostReason::BusDown,
            });
        }
        self.abandon(shared);
        self.nmt_state = None;
        self.phase = Phase::Resting {
            until: now + shared.config.retry,
        };
    }
}
