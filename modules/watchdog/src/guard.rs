//! State of one supervised module: its process, its wanted state, and the earliest time of its next start.

use crate::{ModuleConfig, NAME};
use base::{Duration, Fault, Instant, Severity};
use messages::common;
use module::{Action, Actions, Cause, ProcessCommand, State};

/// First delay after an immediate restart; doubles up to [`crate::Config::delay_max`].
const DELAY_FIRST: Duration = Duration::from_millis(100);
/// Delay that counts as a restart storm: five restarts without sufficient uptime in between.
const STORM_DELAY: Duration = Duration::from_millis(800);
/// Uptime after which one doubling is undone.
const DECAY_UPTIME: Duration = Duration::from_secs(10);
/// Period over which announcements are counted. A module announces itself each second and at every change.
const COUNT_WINDOW: Duration = Duration::from_secs(10);
/// Number of announcements in a window that indicates two senders.
const ANNOUNCEMENTS_MAX: u32 = 18;
/// Time within which the host must answer a spawn; otherwise it counts as failed.
const SPAWN_TIMEOUT: Duration = Duration::from_secs(5);
/// Time after which a module that announces another state than the wanted one has missed a command, or the watchdog
/// has. Longer than its announcement period, so that a single announcement by another sender in its name does not
/// count.
const COMMAND_LATENCY_MAX: Duration = Duration::from_millis(1500);
/// Time after which all announcements that a process sent before its end have arrived.
const LATE_ANNOUNCEMENT: Duration = Duration::from_secs(1);

/// Phase of the process with its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// No process; may be started at `not_before`.
    Down { not_before: Instant },
    /// Requested; the host answers with a pid or a reason.
    Spawning { until: Instant },
    /// Alive.
    Running { pid: u32, since: Instant },
    /// Asked to end; to be killed at `kill_at`, which is `None` once that is done.
    Terminating { pid: u32, kill_at: Option<Instant> },
}

impl Phase {
    pub(crate) fn pid(self) -> Option<u32> {
        match self {
            Self::Running { pid, .. } | Self::Terminating { pid, .. } => Some(pid),
            Self::Down { .. } | Self::Spawning { .. } => None,
        }
    }
}

/// A supervised module.
pub(crate) struct Guard {
    pub(crate) config: ModuleConfig,
    pub(crate) phase: Phase,
    /// Last announced state; UNKNOWN without a process.
    pub(crate) state: State,
    /// State that an operator wants; a restarted module starts in it, TERMINATE keeps it down.
    pub(crate) wanted: State,
    /// Time of the last announcement.
    pub(crate) heard: Instant,
    pub(crate) last_exit: i32,
    pub(crate) cpu: f64,
    pub(crate) rss: i64,
    /// Number of starts without the first.
    restarts: i32,
    /// It was started before, by this watchdog or an earlier one.
    started: bool,
    /// It was started since it was last wanted.
    launched: bool,
    /// Since this time it announces another state than the wanted one.
    differs: Option<Instant>,
    /// It has announced a state other than INIT since it was started.
    settled: bool,
    /// It was in STOP when TERMINATE was commanded: only an operator leads out.
    held: bool,
    /// Its process is one of an earlier watchdog.
    adopted: bool,
    /// An earlier watchdog started it, but it is not configured any more: it is ended and then removed.
    pub(crate) unconfigured: bool,
    /// It was restarted so often that further restarts are not reported.
    pub(crate) storm: bool,
    /// Last wanted state and hold stored with the host.
    remembered: (State, bool),
    /// Time of its last start, and of its last end.
    pub(crate) since: Instant,
    down: Instant,
    /// It was announced while it was down, which has been reported.
    claimed: bool,
    /// Start of the window and number of announcements in it, and whether the previous window had too many.
    announced: (Instant, u32),
    crowded: bool,
    delay: Duration,
}

impl Guard {
    pub(crate) fn new(config: ModuleConfig) -> Self {
        Self {
            config,
            phase: Phase::Down { not_before: Instant::ZERO },
            state: State::Unknown,
            wanted: State::Run,
            heard: Instant::ZERO,
            last_exit: 0,
            cpu: 0.0,
            rss: 0,
            restarts: 0,
            started: false,
            launched: false,
            differs: None,
            settled: false,
            held: false,
            adopted: false,
            unconfigured: false,
            storm: false,
            remembered: (State::Run, false),
            since: Instant::ZERO,
            down: Instant::ZERO,
            claimed: false,
            announced: (Instant::ZERO, 0),
            crowded: false,
            delay: Duration::ZERO,
        }
    }

    /// Restores the state in which an earlier watchdog left it.
    pub(crate) fn earlier(&mut self, now: Instant, wanted: State, held: bool, pid: Option<u32>) {
        self.remembered = (wanted, held);
        self.wanted = if matches!(wanted, State::Pause | State::Stop | State::Terminate) { wanted } else { State::Run };
        self.held = held;
        (self.started, self.launched) = (true, true);
        if let Some(pid) = pid {
            self.phase = Phase::Running { pid, since: now };
            (self.since, self.heard, self.adopted) = (now, now, true);
        }
    }

    /// True if an earlier watchdog started it and it ended before this one started.
    pub(crate) fn died_unseen(&self) -> bool {
        self.launched && self.wanted != State::Terminate && matches!(self.phase, Phase::Down { .. })
    }

    /// True if it works, or if an operator wants it down.
    pub(crate) fn is_healthy(&self) -> bool {
        self.wanted == State::Terminate || matches!(self.phase, Phase::Running { .. })
    }

    /// Stores the wanted state with the host if it changed.
    pub(crate) fn remember(&mut self, out: &mut Actions) {
        let news = (self.wanted, self.held && self.wanted == State::Terminate);
        if self.remembered != news {
            self.remembered = news;
            let (module, (wanted, held)) = (self.config.name.clone(), news);
            out.push(Action::Process(ProcessCommand::Remember { module, wanted, held }));
        }
    }

    /// It was announced while it has no process; true if that is to be reported: once, and not for an announcement sent
    /// before the process ended.
    pub(crate) fn claim(&mut self, now: Instant) -> bool {
        let late = matches!(self.phase, Phase::Down { .. }) && now.since(self.down) >= LATE_ANNOUNCEMENT;
        late && !std::mem::replace(&mut self.claimed, true)
    }

    /// Counts an announcement; `Some` when the result changes: true if it has more than one sender.
    pub(crate) fn count(&mut self, now: Instant) -> Option<bool> {
        let (begun, count) = self.announced;
        let over = now.since(begun) >= COUNT_WINDOW;
        self.announced = if over { (now, 1) } else { (begun, count + 1) };
        let crowded = match over {
            // A window with gaps in the announcements proves nothing.
            true => count >= ANNOUNCEMENTS_MAX,
            false => self.crowded || count + 1 >= ANNOUNCEMENTS_MAX,
        };
        (std::mem::replace(&mut self.crowded, crowded) != crowded).then_some(crowded)
    }

    /// True if a storm has ended: the uptime undoes a restart.
    pub(crate) fn storm_ended(&mut self, now: Instant) -> bool {
        let restrictiveness = self.storm && self.settled && matches!(self.phase, Phase::Running { .. });
        if restrictiveness && now.since(self.since) >= DECAY_UPTIME {
            self.storm = false;
            return true;
        }
        false
    }

    /// True if this is its process and was not asked to end.
    pub(crate) fn is_running(&self, pid: u32) -> bool {
        matches!(self.phase, Phase::Running { pid: own, .. } if own == pid)
    }

    /// True if it is wanted, down and not delayed.
    pub(crate) fn may_start(&self, now: Instant) -> bool {
        let again = !self.launched || self.config.restart;
        matches!(self.phase, Phase::Down { not_before } if not_before <= now && again && self.wanted != State::Terminate)
    }

    pub(crate) fn on_spawn(&mut self, now: Instant) {
        self.phase = Phase::Spawning { until: now + SPAWN_TIMEOUT };
        self.restarts += i32::from(self.started);
        (self.started, self.launched) = (true, true);
        self.since = now;
        self.state = State::Unknown;
        (self.settled, self.adopted, self.claimed, self.differs) = (false, false, false, None);
    }

    /// Processes the first state after a start. A command sent after the process was requested, which it could not
    /// receive yet, is repeated. An adopted process may have received a command while no watchdog listened: of its
    /// state and the remembered one, the more restrictive becomes the wanted one.
    pub(crate) fn settle(&mut self, now: Instant, state: State, out: &mut Actions) {
        if self.adopted && !self.settled && restrictiveness(state) > restrictiveness(self.wanted) {
            self.wanted = state;
        }
        if !self.settled && state != self.wanted && matches!(self.wanted, State::Pause | State::Stop) {
            self.repeat(now, out);
        }
        self.settled = true;
    }

    /// Repeats the command for the wanted state.
    fn repeat(&self, now: Instant, out: &mut Actions) {
        out.publish(common::CmdState {
            timestamp: out.timestamp(now),
            module: self.config.name.clone(),
            state: self.wanted as i8,
            manual: true,
            source: NAME.into(),
        });
    }

    /// Processes an announced state. If it differs from the wanted one for longer than a command may take, one of the
    /// two has missed the command: the more restrictive state becomes the wanted one and is commanded. True if the
    /// wanted state changed.
    pub(crate) fn reconcile(&mut self, now: Instant, state: State, out: &mut Actions) -> bool {
        let both = [state, self.wanted];
        if state == self.wanted || both.iter().any(|state| ![State::Run, State::Pause, State::Stop].contains(state)) {
            self.differs = None;
            return false;
        }
        if now.since(*self.differs.get_or_insert(now)) < COMMAND_LATENCY_MAX {
            return false;
        }
        let calmer = restrictiveness(state) > restrictiveness(self.wanted);
        if calmer {
            (self.wanted, self.differs) = (state, None);
        } else {
            self.repeat(now, out);
        }
        calmer
    }

    pub(crate) fn on_started(&mut self, now: Instant, pid: u32, out: &mut Actions) {
        if self.phase.pid().is_some() {
            // A late answer: another process was started meanwhile, and both would use the device.
            out.push(Action::Process(ProcessCommand::Kill { pid }));
            return;
        }
        self.phase = Phase::Running { pid, since: now };
        self.heard = now;
    }

    /// The process has ended or could not be started; returns the delay until the next start.
    pub(crate) fn on_down(&mut self, now: Instant, delay_max: Duration) -> Duration {
        let paid = now.since(self.since).as_nanos() / DECAY_UPTIME.as_nanos();
        self.delay = self.delay.checked_div(1 << paid.min(20)).unwrap_or_default();
        if self.delay < DELAY_FIRST {
            self.delay = Duration::ZERO;
        }
        let delay = self.delay;
        self.delay = (self.delay * 2).clamp(DELAY_FIRST, delay_max.max(DELAY_FIRST));
        self.storm |= delay >= STORM_DELAY.min(delay_max);
        self.phase = Phase::Down { not_before: now + delay };
        self.down = now;
        self.state = State::Unknown;
        (self.cpu, self.rss) = (0.0, 0);
        delay
    }

    /// Processes a state command as the module itself does; true if something changed.
    pub(crate) fn command(&mut self, now: Instant, to: State, cause: Cause, end_within: Duration) -> bool {
        let down = self.wanted == State::Terminate;
        let from = match self.state {
            State::Unknown | State::Init if !down => self.wanted,
            state => state,
        };
        match to {
            State::Run if down => {
                let held = self.held && cause != Cause::Manual;
                self.wanted = if held { State::Stop } else { State::Run };
                self.launched = false;
                if matches!(self.phase, Phase::Down { .. }) {
                    self.phase = Phase::Down { not_before: now };
                }
                true
            }
            State::Terminate if !down => {
                self.held = self.wanted == State::Stop;
                self.wanted = State::Terminate;
                if let Phase::Running { pid, .. } = self.phase {
                    self.phase = Phase::Terminating { pid, kill_at: Some(now + end_within) };
                }
                true
            }
            State::Run | State::Pause | State::Stop if !down && (to == from || from.allows(to, cause)) => {
                let changed = self.wanted != to;
                self.wanted = to;
                changed
            }
            _ => false,
        }
    }

    /// Asks the process to end, once.
    pub(crate) fn end(&mut self, now: Instant, within: Duration, out: &mut Actions) {
        if let Phase::Running { pid, .. } = self.phase {
            out.push(Action::Process(ProcessCommand::Terminate { pid }));
            self.phase = Phase::Terminating { pid, kill_at: Some(now + within) };
        }
    }

    pub(crate) fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::Down { not_before } if self.may_start(not_before) => Some(not_before),
            Phase::Spawning { until } => Some(until),
            Phase::Terminating { kill_at, .. } => kill_at,
            Phase::Down { .. } | Phase::Running { .. } => None,
        }
    }

    /// Publishes, in the name of a module without a process, that its faults are unknown. `begun`: start of the
    /// watchdog.
    pub(crate) fn list_faults(&self, now: Instant, begun: Instant, out: &mut Actions) {
        if self.unconfigured || !matches!(self.phase, Phase::Down { .. } | Phase::Spawning { .. }) {
            return;
        }
        let (severity, how) = match self.wanted == State::Terminate || !self.launched {
            true => (Severity::Notice, "does not run, as commanded"),
            false => (Severity::Error, "does not run"),
        };
        let name = &self.config.name;
        let down = common::Fault {
            number: i32::from(Fault::ModuleDown as u16),
            subject: name.clone(),
            severity: severity as i8,
            since: out.timestamp(self.down.max(begun)),
            message: format!("{name} {how}: its active faults are unknown"),
        };
        let (timestamp, module) = (out.timestamp(now), name.clone());
        out.publish(common::DataFaults { timestamp, module, faults: vec![down] });
    }

    /// Row of the module in `CM_DATA_PROCESSES`. `judged`: false if the watchdog cannot tell whether a process works.
    pub(crate) fn process(&self, now: Instant, judged: bool) -> common::Process {
        let (phase, uptime) = match self.phase {
            Phase::Running { since, .. } if !judged => (common::Process::UNKNOWN, now.since(since).as_secs_f64()),
            Phase::Running { since, .. } => (common::Process::RUNNING, now.since(since).as_secs_f64()),
            Phase::Terminating { .. } => (common::Process::TERMINATING, 0.0),
            Phase::Down { .. } | Phase::Spawning { .. } => (common::Process::TERMINATED, 0.0),
        };
        common::Process {
            module: self.config.name.clone(),
            pid: self.phase.pid().map_or(0, |pid| pid as i32),
            phase,
            state: self.state as i8,
            wanted: self.wanted as i8,
            restarts: self.restarts,
            last_exit: self.last_exit,
            uptime,
            cpu: self.cpu,
            rss: self.rss,
        }
    }
}

/// Rank of a state: the higher, the more restrictive.
fn restrictiveness(state: State) -> u8 {
    match state {
        State::Stop => 2,
        State::Pause => 1,
        _ => 0,
    }
}
