//! Logger module: records all bus messages.
//!
//! Input    all messages; `CM_CMD_LOG` starts and stops recording and adds marks
//! Output   MCAP through the port of the log folder; `CM_DATA_LOG` each second and on change
//! Silence  without recording, wanted or not, the last seconds are kept and written first when recording starts
//! Trouble  a disk that is slow, full, read-only or missing costs messages, which are counted, and nothing else: faults
//!          `LogLost` and `LogRefused`; writing is retried
//! States   in STOP the file is closed and nothing is recorded; in PAUSE recording continues
//! Memory   `pretrigger_bytes` and `buffer_bytes`, a chunk of 256 KiB, the compressor's window, 6 MB of index; and five
//!          times the largest message while it is processed

use crate::config::Config;
use crate::disk::{Disk, DiskEvent};
use crate::file::{File, FileHeader, Stamp};
use crate::names;
use crate::ring::Ring;
use crate::ros::Translator;
use base::store::Answer;
use base::{Deadlines, Duration, Epoch, Fault, Instant, Severity, earliest};
use mcap::{McapError, McapResult};
use messages::common::{CmdLog, DataLog};
use messages::{Channel, Message};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};

/// Name of the module.
pub const NAME: &str = "logger";
const PORT: PortId = PortId(0);
const PERIOD: Duration = Duration::from_secs(1);
/// Time after its first message at which a chunk is closed.
const CHUNK_AGE_MAX: Duration = Duration::from_millis(200);
/// Time without losses after which the fault is cleared.
const LOSSES_CLEAR_AFTER: Duration = Duration::from_secs(5);
/// Maximum number of marks waiting for a recording, and maximum length of a mark's text, bytes.
const MARKS_MAX: usize = 64;
const MARK_BYTES: usize = 4096;

base::deadlines! {
    /// Deadlines of the logger; those of the disk are in [`Disk`].
    enum Timer {
        /// The open chunk is closed: [`CHUNK_AGE_MAX`] after its oldest message. Set while a chunk is open.
        Chunk,
        /// The loss of messages is over. Set while it is reported.
        Losses,
        /// `CM_DATA_LOG` is published. Set from the start on.
        Publish,
    }
}

/// Logger module.
pub struct Logger {
    config: Config,
    ports: [PortSpec; 1],
    translator: Translator,
    disk: Disk,
    ring: Ring,
    /// True if operators want recording, and true if the module's state allows it.
    wanted: bool,
    allowed: bool,
    run: Option<Run>,
    file: Option<File>,
    deadlines: Deadlines<Timer>,
    /// Number of messages in the open chunk.
    chunk_messages: u64,
    marks: Vec<(u64, String)>,
    /// Messages missing in the file: number, and log time of the first; to be noted in it.
    gap: Option<(u64, u64)>,
    /// True while messages are dropped, until half of the waiting data is written.
    dropping: bool,
    log_time: u64,
    told: Option<(bool, String)>,
    refused: bool,
}

/// Run: a folder of files.
#[derive(Clone, Debug)]
struct Run {
    name: String,
    /// Number of the next file.
    next: u32,
    sequence: u32,
    bytes: u64,
    dropped: u64,
}

impl Logger {
    /// Creates the module; `translator` converts messages to their ROS 2 form.
    #[must_use]
    pub fn new(config: Config, translator: Translator) -> Self {
        Self {
            ports: [PortSpec { bus: config.bus.clone(), line: Line::Store }],
            translator,
            disk: Disk::new(config.keep_free_bytes, config.keep_runs_bytes, config.run.clone()),
            ring: Ring::new(config.pretrigger, config.pretrigger_bytes),
            wanted: config.start,
            allowed: true,
            run: None,
            file: None,
            deadlines: Deadlines::new(),
            chunk_messages: 0,
            marks: Vec::new(),
            gap: None,
            dropping: false,
            log_time: 0,
            told: None,
            refused: false,
            config,
        }
    }

    /// Log time of a message: never before that of the previous one.
    fn next_time(&mut self, epoch: Epoch, at: Instant) -> u64 {
        self.log_time = self.log_time.max(unix(epoch, at));
        self.log_time
    }

    fn on_raw_message(&mut self, now: Instant, at: Instant, channel: &str, data: &[u8], out: &mut Actions) {
        if self.file.is_none() {
            let gone = self.ring.push(at, channel, data);
            if gone > 0 && self.wanted && self.allowed {
                self.count_lost(now, unix(out.epoch(), at), gone, out);
            }
            return;
        }
        let waiting = self.disk.waiting();
        self.dropping =
            waiting >= self.config.buffer_bytes || (self.dropping && waiting >= self.config.buffer_bytes / 2);
        if self.dropping {
            self.count_lost(now, unix(out.epoch(), at), 1, out);
        } else {
            self.record(now, at, channel, data, out);
        }
    }

    /// Counts lost messages; `time` is the log time of the first.
    fn count_lost(&mut self, now: Instant, time: u64, messages: u64, out: &mut Actions) {
        if messages == 0 {
            return;
        }
        self.gap.get_or_insert((0, time)).0 += messages;
        if let Some(run) = &mut self.run {
            run.dropped += messages;
        }
        let first = !self.deadlines.is_set(Timer::Losses);
        self.deadlines.set(Timer::Losses, now + LOSSES_CLEAR_AFTER);
        if first {
            let why = "messages are lost: the disk is too slow, or accepts no data";
            out.raise(Severity::Warning, Fault::LogLost, "log", why);
        }
    }

    /// Number of lost messages that are not noted yet.
    fn missing(&self) -> u64 {
        self.gap.map_or(0, |(messages, _)| messages)
    }

    /// Writes a message to the open file.
    fn record(&mut self, now: Instant, at: Instant, channel: &str, data: &[u8], out: &mut Actions) {
        let log_time = self.next_time(out.epoch(), at);
        if let (Some(file), Some((messages, since))) = (&mut self.file, self.gap.take()) {
            let entries =
                [("messages", messages.to_string()), ("since", since.to_string()), ("until", log_time.to_string())];
            let noted = file.note("gap", entries);
            self.on_format_error(noted, out);
        }
        let (Some(file), Some(run)) = (&mut self.file, &mut self.run) else { return };
        let kind = self.translator.kind(channel, data);
        let made = kind.and_then(|kind| u64::try_from(kind.timestamp(data)?).ok()?.checked_mul(1000));
        let publish_time = made.filter(|made| *made > 0).unwrap_or(log_time);
        let stamp = Stamp { log_time, publish_time, sequence: run.sequence };
        match file.raw(channel, kind, data, stamp) {
            Ok(()) => run.sequence = run.sequence.wrapping_add(1),
            Err(McapError::TooManyChannels) => {
                run.dropped += 1;
                let why = "more channels than a log can hold: messages on further ones are left out";
                out.raise(Severity::Warning, Fault::LogCrowded, "log", why);
                return;
            }
            Err(error) => return self.on_format_error(Err(error), out),
        }
        let mut written = Ok(());
        // A message without a ROS 2 form, or without room for it, is still recorded unchanged.
        let _ = self.translator.translate(channel, data, &mut |topic, cdr| match file.ros(topic, cdr, stamp) {
            Ok(()) | Err(McapError::TooManyChannels) => {}
            Err(error) => written = Err(error),
        });
        let full = file.chunk_is_full();
        self.open_chunk(at);
        self.chunk_messages += 1;
        self.on_format_error(written, out);
        if full {
            self.cut(now, out);
        }
    }

    /// Opens a chunk whose oldest message was received at `at`, unless one is open.
    fn open_chunk(&mut self, at: Instant) {
        if !self.deadlines.is_set(Timer::Chunk) {
            self.deadlines.set(Timer::Chunk, at + CHUNK_AGE_MAX);
        }
    }

    /// Closes the chunk and hands it to the disk; begins the next file if this one has reached its size.
    fn cut(&mut self, now: Instant, out: &mut Actions) {
        let Some(file) = &mut self.file else { return };
        let taken = file.take();
        let full = file.is_full(self.config.file_max_bytes);
        self.hand_over(now, taken, out);
        if full {
            self.finish(now, out);
            self.begin_file(now, false, out);
        }
    }

    fn hand_over(&mut self, now: Instant, taken: McapResult<Vec<u8>>, out: &mut Actions) {
        let oldest = self.deadlines.get(Timer::Chunk).map_or(now, |due| due - CHUNK_AGE_MAX);
        self.deadlines.clear(Timer::Chunk);
        let messages = std::mem::take(&mut self.chunk_messages);
        match taken {
            Ok(bytes) => self.disk.append(bytes, oldest, messages),
            Err(error) => self.on_format_error(Err(error), out),
        }
    }

    /// Gives the file up after an unexpected error of the format.
    fn on_format_error(&mut self, result: McapResult<()>, out: &mut Actions) {
        if let Err(error) = result {
            out.note(format!("the file is given up: {error}"));
            self.file = None;
        }
    }

    /// Ends the file, if there is one.
    fn finish(&mut self, now: Instant, out: &mut Actions) {
        if let Some(file) = self.file.take() {
            self.hand_over(now, file.finish(), out);
            self.disk.close();
        }
    }

    /// Ends the run.
    fn end(&mut self, now: Instant, out: &mut Actions) {
        self.finish(now, out);
        self.run = None;
        self.dropping = false;
    }

    /// Begins a file of the run, or of a new one. An awaited file is opened once it exists.
    fn begin_file(&mut self, now: Instant, awaited: bool, out: &mut Actions) {
        if self.run.is_none() {
            let second = unix(out.epoch(), now) / 1_000_000_000;
            let own = || names::free_run(second, |name| self.disk.has(name));
            let name = self.config.run.take().unwrap_or_else(own);
            self.disk.keep(&name);
            self.run = Some(Run { name, next: 0, sequence: 0, bytes: 0, dropped: self.missing() });
        }
        let Some(run) = &mut self.run else { return };
        self.disk.create(&run.name, run.next, awaited);
        run.next += 1;
        if !awaited {
            self.open(now, out);
        }
    }

    /// Opens the created file.
    fn open(&mut self, now: Instant, out: &mut Actions) {
        let time = unix(out.epoch(), now);
        let Some(run) = &self.run else { return };
        let header = FileHeader { config: &self.config, run: &run.name, time, monotonic: now.as_nanos() };
        match File::new(&header) {
            Ok(file) => self.file = Some(file),
            Err(error) => self.on_format_error(Err(error), out),
        }
        // The data before the first message is written to the disk at once.
        self.deadlines.set(Timer::Chunk, now + CHUNK_AGE_MAX);
    }

    /// The awaited file exists: it begins with the messages kept in the ring.
    fn on_begun(&mut self, now: Instant, out: &mut Actions) {
        if !(self.wanted && self.allowed) {
            self.run = None;
            return;
        }
        out.clear(Fault::LogCrowded, "log", "a new file has room for channels");
        self.open(now, out);
        let (heard, dropped) = self.ring.take(now);
        let first = heard.front().map_or(now, |heard| heard.at);
        if self.gap.is_some() {
            self.count_lost(now, unix(out.epoch(), first), dropped, out);
        }
        for heard in heard {
            self.record(now, heard.at, &heard.channel, &heard.data, out);
        }
        for (time, text) in std::mem::take(&mut self.marks) {
            self.mark(now, time, &text, out);
        }
    }

    fn on_command(&mut self, now: Instant, at: Instant, command: &CmdLog, out: &mut Actions) {
        match command.action {
            CmdLog::STOP => {
                self.wanted = false;
                self.marks.clear();
                self.end(now, out);
            }
            CmdLog::START => self.wanted = true,
            CmdLog::MARK => {
                self.wanted = true;
                let text = shortened(&command.text);
                let made = u64::try_from(command.timestamp).ok().and_then(|made| made.checked_mul(1000));
                let time = made.filter(|made| *made > 0).unwrap_or(unix(out.epoch(), at));
                if self.file.is_some() {
                    self.mark(now, time, text, out);
                } else if self.marks.len() < MARKS_MAX {
                    self.marks.push((time, text.to_owned()));
                }
            }
            _ => {
                let why = format!("CM_CMD_LOG: {} is not an action", command.action);
                out.report(Severity::Warning, Fault::CommandForbidden, "log", why);
            }
        }
    }

    /// Notes a mark. As a message it is already in the file.
    fn mark(&mut self, now: Instant, time: u64, text: &str, out: &mut Actions) {
        if let Some(file) = &mut self.file {
            let marked = file.note("mark", [("time", time.to_string()), ("text", text.to_owned())]);
            self.open_chunk(now);
            self.on_format_error(marked, out);
        }
    }

    fn on_answer(&mut self, now: Instant, answer: &Answer, out: &mut Actions) {
        match self.disk.answered(now, answer) {
            Some(DiskEvent::Created) => self.on_begun(now, out),
            // A run with a file keeps its name. A run without one gets another name: a folder made by others may be
            // that of an earlier instance of this module.
            Some(DiskEvent::NotCreated) => self.run = self.run.take().filter(|run| run.next > 1),
            Some(DiskEvent::Written(bytes)) => {
                if let Some(run) = &mut self.run {
                    run.bytes += bytes;
                }
            }
            Some(DiskEvent::FileLost) => self.abandon_file(now, out),
            Some(DiskEvent::Full) => self.finish(now, out),
            Some(DiskEvent::Listed) | None => {}
        }
    }

    /// Discards the data waiting for the disk.
    fn abandon_file(&mut self, now: Instant, out: &mut Actions) {
        let lost = self.disk.abandon();
        self.forget(now, lost, out);
    }

    fn forget(&mut self, now: Instant, lost: u64, out: &mut Actions) {
        self.file = None;
        self.deadlines.clear(Timer::Chunk);
        let lost = lost + std::mem::take(&mut self.chunk_messages);
        let time = self.log_time;
        self.count_lost(now, time, lost, out);
    }

    /// Does the work that is due.
    fn run_due(&mut self, now: Instant, out: &mut Actions) {
        let sync = self.deadlines.is_set(Timer::Chunk) && self.disk.sync_is_due(now);
        if self.deadlines.is_due(Timer::Chunk, now) || sync {
            self.cut(now, out);
        }
        self.ask(now, out);
        if self.wanted && self.allowed && self.file.is_none() && self.disk.is_ready() {
            self.begin_file(now, true, out);
            self.ask(now, out);
        }
        self.update_faults(now, out);
        self.publish_status(now, out);
    }

    fn ask(&mut self, now: Instant, out: &mut Actions) {
        if let Some(request) = self.disk.poll_request(now) {
            out.store(PORT, request);
        }
    }

    /// Raises and clears faults.
    fn update_faults(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Losses, now) {
            let why = format!("no message lost for {} s", LOSSES_CLEAR_AFTER.as_secs());
            out.clear(Fault::LogLost, "log", why);
        }
        match (self.disk.trouble(), self.refused) {
            (Some(trouble), false) => {
                let message = format!("nothing is recorded: {trouble}; tried again");
                out.raise(Severity::Error, Fault::LogRefused, "log", message);
                out.failed();
                self.refused = true;
            }
            (None, true) => {
                out.clear(Fault::LogRefused, "log", "the disk accepts data again");
                out.working();
                self.refused = false;
            }
            _ => {}
        }
    }

    fn publish_status(&mut self, now: Instant, out: &mut Actions) {
        let name = self.run.as_ref().map_or("", |run| &*run.name);
        let changed =
            self.told.as_ref().is_none_or(|(recording, run)| *recording != self.file.is_some() || run != name);
        let due = self.deadlines.tick(Timer::Publish, now, PERIOD);
        if !self.deadlines.is_set(Timer::Publish) || !(changed || due) {
            return;
        }
        self.told = Some((self.file.is_some(), name.to_owned()));
        let number = |value: u64| i64::try_from(value).unwrap_or(i64::MAX);
        out.publish(DataLog {
            timestamp: out.timestamp(now),
            recording: self.file.is_some(),
            run: name.to_owned(),
            bytes: self.run.as_ref().map_or(0, |run| number(run.bytes)),
            dropped: number(self.run.as_ref().map_or(self.missing(), |run| run.dropped)),
            free: number(self.disk.free()),
        });
    }

    fn on_port(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, self.config.bus.as_str(), "the log folder is available");
                self.disk.up();
                out.working();
            }
            Input::Down(why) => {
                let message = format!("the log folder is not available: {why}; tried again");
                out.raise(Severity::Error, Fault::PortDown, self.config.bus.as_str(), message);
                let lost = self.disk.down();
                self.forget(now, lost, out);
                out.failed();
            }
            Input::Store(answer) => self.on_answer(now, answer, out),
            _ => {}
        }
    }

    fn on_state(&mut self, now: Instant, state: State, out: &mut Actions) {
        self.allowed = !matches!(state, State::Stop | State::Terminate);
        if !self.allowed {
            self.end(now, out);
        }
    }
}

/// Instant in nanoseconds since the UNIX epoch.
fn unix(epoch: Epoch, at: Instant) -> u64 {
    u64::try_from(i128::from(epoch.offset_us) * 1000 + i128::from(at.as_nanos())).unwrap_or(0)
}

/// Beginning of a mark's text, within the maximum length.
fn shortened(text: &str) -> &str {
    let mut end = text.len().min(MARK_BYTES);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

impl Module for Logger {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::CmCmdLog]
    }

    fn wants_raw_bus(&self) -> bool {
        true
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.deadlines.set(Timer::Publish, now),
            Event::RawMessage { at, channel, data } => self.on_raw_message(now, at, channel, data, out),
            Event::Message { at, message: Message::CmCmdLog(command), .. } => self.on_command(now, at, command, out),
            Event::Port { input, .. } => self.on_port(now, &input, out),
            Event::State(state) => self.on_state(now, state, out),
            Event::Message { .. } | Event::Timer | Event::Process(_) => {}
        }
        self.run_due(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.deadlines.next(), self.disk.poll_timeout()])
    }

    fn finished(&self) -> bool {
        self.disk.is_idle()
    }
}
