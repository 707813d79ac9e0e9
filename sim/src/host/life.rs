//! Life of processes: service, heartbeats, supervision.

use super::agenda::{Happening, Waiting};
use super::{News, Virtual, of_robot};
use base::{Duration, Epoch, Instant};
use module::{Event, ExitStatus, ProcessEvent, State};
use std::collections::VecDeque;
use std::mem;
use std::rc::Rc;

/// Heartbeat period of a process that is served in time, as in the live host.
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(50);
/// Period of the watchdog host's check of heartbeats.
const HEARTBEAT_CHECK_PERIOD: Duration = Duration::from_millis(20);
/// Delay of a process at which its heartbeat counts as missing, and its own check of heartbeats as late.
const LATE_AFTER: Duration = Duration::from_millis(100);
/// A module ends itself after this time without a sign of a watchdog.
const UNSUPERVISED_MAX: Duration = Duration::from_secs(3);
/// First delay after an immediate restart of a supervised process.
const DELAY_FIRST: Duration = Duration::from_millis(100);
/// Uptime after which a supervised process is restarted without delay again.
const UPTIME_MIN: Duration = Duration::from_secs(10);

/// Life of a process.
pub(super) struct Life {
    pub started: bool,
    /// Time at which it was frozen, while it is.
    pub hung: Option<Instant>,
    /// Latency with which it is served.
    pub late: Duration,
    /// Events before this time are served in order at their own time.
    pub behind: Instant,
    /// Time of the last cycle of its loop, as far as it was evaluated.
    beat: Instant,
    /// Time of its last check of heartbeats that was late.
    checked: Instant,
    pub backlog: VecDeque<Waiting>,
}

impl Life {
    pub fn new() -> Self {
        Self {
            started: false,
            hung: None,
            late: Duration::ZERO,
            behind: Instant::ZERO,
            beat: Instant::ZERO,
            checked: Instant::ZERO,
            backlog: VecDeque::new(),
        }
    }

    /// First cycle of the loop.
    pub fn begin(&mut self, now: Instant) {
        (self.started, self.beat) = (true, now);
    }

    /// True if it may miss a heartbeat that is checked.
    fn may_be_late(&self) -> bool {
        self.hung.is_some() || !self.late.is_zero()
    }

    /// Delay of the check of heartbeats that it does at `now`, if it does one; each one is late by the latency.
    fn late_check(&mut self, now: Instant) -> Option<Duration> {
        let late = self.late;
        let due = self.hung.is_none() && late >= LATE_AFTER && now >= self.checked + HEARTBEAT_CHECK_PERIOD + late;
        due.then(|| self.checked = now).map(|()| late)
    }

    /// Time of its last heartbeat. Heartbeats need no events: between two changes of the latency they are as regular as
    /// its service.
    fn beat(&mut self, now: Instant) -> Instant {
        let period = HEARTBEAT_PERIOD + self.late;
        let until = self.hung.unwrap_or(now);
        let beats = until.since(self.beat).as_nanos() / period.as_nanos();
        self.beat += Duration::from_nanos((beats * period.as_nanos()) as u64);
        self.beat
    }
}

/// A process that is restarted when it dies: the watchdog, whose parent is `advee up`.
pub(super) struct Kept {
    module: Rc<str>,
    /// Process id; 0 after its final end.
    pid: u32,
    since: Instant,
    delay: Duration,
}

impl Virtual {
    /// Starts a process as `advee up` starts the watchdog: when it dies it is restarted, at first at once, then after a
    /// delay that doubles from 100 ms up to [`Config::restart_delay_max`](super::Config::restart_delay_max).
    ///
    /// # Errors
    /// As [`Virtual::spawn`].
    pub fn keep(&mut self, module: &str) -> Result<u32, String> {
        let pid = self.start(0, module, State::Run)?;
        let kept = Kept { module: module.into(), pid, since: self.now, delay: Duration::ZERO };
        self.kept.push(kept);
        Ok(pid)
    }

    /// Freezes a process: it is not served, its input waits in bounded buffers.
    pub fn hang(&mut self, pid: u32) {
        let Some(place) = self.place(pid) else { return };
        let now = self.now;
        let process = &mut self.processes[place];
        if process.life.hung.is_none() {
            process.life.beat(now);
            process.life.hung = Some(now);
            let module = process.module.clone();
            self.process_timers[place] = None;
            self.schedule(now + UNSUPERVISED_MAX, Happening::Lonely(pid));
            self.look();
            self.news(&News::Hung { module: &module, pid });
        }
    }

    /// Resumes a hung process: it is served its pending input, then its timer.
    pub fn resume(&mut self, pid: u32) {
        let Some(place) = self.place(pid) else { return };
        let now = self.now;
        let Some(hung) = self.processes[place].life.hung.take() else { return };
        if now.since(self.processes[place].life.beat) >= HEARTBEAT_PERIOD {
            self.processes[place].life.beat = now;
        }
        // A delay of the process itself is not charged to others.
        let held_up = now.since(hung);
        for child in self.processes.iter_mut().filter(|child| child.parent == pid) {
            child.life.beat = (child.life.beat + held_up).min(now);
        }
        let module = self.processes[place].module.clone();
        self.news(&News::Resumed { module: &module, pid });
        let backlog = mem::take(&mut self.processes[place].life.backlog);
        if held_up >= LATE_AFTER && self.processes.iter().any(|child| child.parent == pid) {
            self.handle(pid, Event::Process(ProcessEvent::CheckLate { by: held_up }));
        }
        for waiting in backlog {
            self.serve(pid, waiting);
        }
        if let Some(place) = self.place(pid) {
            self.arm(place);
        }
    }

    /// Slows a process down: each event and timer is served with this latency, in order. Zero: normal again.
    pub fn crawl(&mut self, pid: u32, late: Duration) {
        let Some(place) = self.place(pid) else { return };
        let now = self.now;
        let process = &mut self.processes[place];
        process.life.beat(now);
        process.life.late = late;
        let module = process.module.clone();
        self.arm(place);
        self.look();
        self.news(&News::Crawls { module: &module, pid, late });
    }

    /// Steps the wall clock by `by_us` µs: processes started from now on have another epoch, running ones keep theirs.
    pub fn step_clock(&mut self, by_us: i64) {
        self.config.epoch = Epoch { offset_us: self.config.epoch.offset_us.saturating_add(by_us) };
    }

    /// Schedules checks of heartbeats as long as one may be late.
    pub(super) fn look(&mut self) {
        if !self.looking && self.processes.iter().any(|process| process.life.may_be_late()) {
            self.looking = true;
            self.schedule(next_check(self.now), Happening::Look);
        }
    }

    pub(super) fn serve_check(&mut self) {
        self.looking = false;
        let now = self.now;
        let mut late = Vec::new();
        for process in self.processes.iter_mut().filter(|process| process.life.started) {
            if process.life.may_be_late() && process.parent != 0 {
                late.push((process.parent, process.pid, process.life.beat(now)));
            }
        }
        for (parent, pid, last) in late {
            // A hung process does not check.
            let looks = self.place(parent).is_some_and(|place| self.processes[place].life.hung.is_none());
            if looks && now.since(last) >= LATE_AFTER {
                self.tell(parent, Waiting::HeartbeatLate(pid, last));
            }
        }
        let parents: Vec<u32> = self.processes.iter().map(|process| process.parent).collect();
        let checks = self.processes.iter_mut().filter(|process| parents.contains(&process.pid));
        let late: Vec<_> = checks.filter_map(|process| Some((process.pid, process.life.late_check(now)?))).collect();
        for (pid, by) in late {
            self.handle(pid, Event::Process(ProcessEvent::CheckLate { by }));
        }
        self.look();
    }

    /// Reports the begin of a process's heartbeats to its parent.
    pub(super) fn report_heartbeats(&mut self, pid: u32) {
        let parent = self.place(pid).map_or(0, |place| self.processes[place].parent);
        if parent != 0 {
            self.schedule(next_check(self.now), Happening::Tell(parent, Waiting::HeartbeatStarted(pid)));
        }
    }

    /// Consequences of a process's end for others.
    pub(super) fn after(&mut self, pid: u32, status: ExitStatus) {
        if self.processes.iter().any(|child| child.parent == pid) {
            self.schedule(self.now + UNSUPERVISED_MAX, Happening::Lonely(pid));
        }
        let (now, most) = (self.now, self.config.restart_delay_max);
        let Some(place) = self.kept.iter().position(|kept| kept.pid == pid) else { return };
        if status == ExitStatus::Code(0) {
            self.kept[place].pid = 0;
            self.remembered.clear();
            return;
        }
        let kept = &mut self.kept[place];
        if now.since(kept.since) >= UPTIME_MIN {
            kept.delay = Duration::ZERO;
        }
        let at = now + self.config.exit_delay + kept.delay;
        kept.delay = (kept.delay * 2).max(DELAY_FIRST).min(most);
        self.schedule(at, Happening::Again(place));
    }

    /// Restarts a supervised process.
    pub(super) fn again(&mut self, place: usize) {
        let Some(module) = self.kept.get(place).map(|kept| kept.module.clone()) else { return };
        let Ok(pid) = self.start(0, &module, State::Run) else { return };
        (self.kept[place].pid, self.kept[place].since) = (pid, self.now);
    }

    /// A process has been dead for as long as its children wait: those that it still has end themselves.
    pub(super) fn end_unsupervised(&mut self, pid: u32) {
        let now = self.now;
        let watches = self.place(pid).is_some_and(|place| {
            let hung = self.processes[place].life.hung;
            hung.is_none_or(|since| now.since(since) < UNSUPERVISED_MAX)
        });
        if watches {
            return;
        }
        let children: Vec<u32> =
            self.processes.iter().filter(|child| child.parent == pid).map(|child| child.pid).collect();
        for child in children {
            self.tell(child, Waiting::Terminate);
        }
    }

    /// A new watchdog adopts the living processes of its predecessor.
    pub(super) fn adopt(&mut self, pid: u32) {
        if !self.kept.iter().any(|kept| kept.pid == pid) {
            return;
        }
        let living: Vec<u32> = self.processes.iter().map(|process| process.pid).collect();
        for process in self.processes.iter_mut().filter(|process| process.parent != 0) {
            if !living.contains(&process.parent) {
                process.parent = pid;
                process.admission.set_watchdog(of_robot(pid));
            }
        }
        for (module, (wanted, held)) in self.remembered.clone() {
            let child = self.processes.iter().rev().find(|child| child.parent == pid && *child.module == *module);
            let child = child.map(|child| (child.pid, child.life.started));
            self.handle(
                pid,
                Event::Process(ProcessEvent::Earlier {
                    module: &module,
                    wanted,
                    held,
                    pid: child.map(|child| child.0),
                }),
            );
            if let Some((child, true)) = child {
                self.schedule(next_check(self.now), Happening::Tell(pid, Waiting::HeartbeatStarted(child)));
            }
        }
    }
}

fn next_check(now: Instant) -> Instant {
    let look = HEARTBEAT_CHECK_PERIOD.as_nanos() as u64;
    Instant::from_nanos((now.as_nanos() / look + 1) * look)
}
