//! The module: receives every message on the bus and writes it to the log.
//!
//! Takes    everything that is said; `CM_CMD_LOG` begins and ends recording and puts marks in
//! Gives    MCAP through the port of the folder of logs; `CM_DATA_LOG` each second and on change
//! Silence  while nothing is recorded, wanted or not, the last seconds are kept: they come first in what is then written
//! Trouble  a disk that is slow, full, read-only or gone costs messages, which are counted, and nothing else: faults
//!          `LogLost` and `LogRefused`; it is tried again
//! States   in STOP the file is closed and nothing recorded; in PAUSE it goes on
//! Memory   `pretrigger_bytes` and `buffer_bytes`, a chunk of 256 KiB, the compressor's window, 6 MB of index; and five
//!          times the largest message while that is on its way

use crate::config::Config;
use crate::disk::{Disk, News};
use crate::file::{Beginning, File, Stamp};
use crate::names;
use crate::ring::Ring;
use crate::ros::Translator;
use base::store::Answer;
use base::{Deadlines, Duration, Epoch, Fault, Instant, Severity, earliest};
use mcap::{McapError, McapResult};
use messages::common::{CmdLog, DataLog};
use messages::{Channel, Message};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};

/// The module's name.
pub const NAME: &str = "logger";
const PORT: PortId = PortId(0);
const PERIOD: Duration = Duration::from_secs(1);
/// A chunk is closed this long after its first message was heard.
const CHUNK_FOR: Duration = Duration::from_millis(200);
/// That messages are lost is over when none was for so long.
const LOSSES_OVER: Duration = Duration::from_secs(5);
/// Marks that wait for a recording to begin, and bytes of each one's text.
const MARKS_MAX: usize = 64;
const MARK_BYTES: usize = 4096;

base::deadlines! {
    /// What the logger waits for; what the disk waits for is in [`Disk`].
    enum Timer {
        /// The open chunk is closed: [`CHUNK_FOR`] after its oldest message. Set while a chunk is open.
        Chunk,
        /// The loss of messages is over. Set while it is reported.
        Losses,
        /// `CM_DATA_LOG` is published. Set from the start on.
        Publish,
    }
}

/// The module.
pub struct Logger {
    config: Config,
    ports: [PortSpec; 1],
    translator: Translator,
    disk: Disk,
    ring: Ring,
    /// Whether operators want it to record, and whether its state lets it.
    wanted: bool,
    allowed: bool,
    run: Option<Run>,
    file: Option<File>,
    deadlines: Deadlines<Timer>,
    /// Messages in the open chunk.
    chunk_messages: u64,
    marks: Vec<(u64, String)>,
    /// Messages that are missing in the file, and from which log time on; to be noted in it.
    gap: Option<(u64, u64)>,
    /// Whether messages are dropped until half of what waits is written.
    choked: bool,
    log_time: u64,
    told: Option<(bool, String)>,
    refused: bool,
}

/// A run: a folder of files.
#[derive(Clone, Debug)]
struct Run {
    name: String,
    /// The next file's number.
    next: u32,
    sequence: u32,
    bytes: u64,
    dropped: u64,
}

impl Logger {
    /// A module that has not started; `translator` makes of messages what ROS 2 has for them.
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
            choked: false,
            log_time: 0,
            told: None,
            refused: false,
            config,
        }
    }

    /// The log time of a message: never before that of the last.
    fn next_time(&mut self, epoch: Epoch, at: Instant) -> u64 {
        self.log_time = self.log_time.max(unix(epoch, at));
        self.log_time
    }

    fn on_heard(&mut self, now: Instant, at: Instant, channel: &str, data: &[u8], out: &mut Actions) {
        if self.file.is_none() {
            let gone = self.ring.push(at, channel, data);
            if gone > 0 && self.wanted && self.allowed {
                self.lose(now, unix(out.epoch(), at), gone, out);
            }
            return;
        }
        let waiting = self.disk.waiting();
        self.choked = waiting >= self.config.buffer_bytes || (self.choked && waiting >= self.config.buffer_bytes / 2);
        if self.choked {
            self.lose(now, unix(out.epoch(), at), 1, out);
        } else {
            self.record(now, at, channel, data, out);
        }
    }

    /// Messages are lost; `time` is when the first of them was heard.
    fn lose(&mut self, now: Instant, time: u64, messages: u64, out: &mut Actions) {
        if messages == 0 {
            return;
        }
        self.gap.get_or_insert((0, time)).0 += messages;
        if let Some(run) = &mut self.run {
            run.dropped += messages;
        }
        let first = !self.deadlines.is_set(Timer::Losses);
        self.deadlines.set(Timer::Losses, now + LOSSES_OVER);
        if first {
            let why = "messages are lost: the disk takes them too slowly, or not at all";
            out.raise(Severity::Warning, Fault::LogLost, "log", why);
        }
    }

    /// Messages that were lost and are not noted.
    fn missing(&self) -> u64 {
        self.gap.map_or(0, |(messages, _)| messages)
    }

    /// Writes a message into the file, which there is.
    fn record(&mut self, now: Instant, at: Instant, channel: &str, data: &[u8], out: &mut Actions) {
        let log_time = self.next_time(out.epoch(), at);
        if let (Some(file), Some((messages, since))) = (&mut self.file, self.gap.take()) {
            let entries =
                [("messages", messages.to_string()), ("since", since.to_string()), ("until", log_time.to_string())];
            let noted = file.note("gap", entries);
            self.broken(noted, out);
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
                let why = "more channels than a log holds: messages of further ones are left out";
                out.raise(Severity::Warning, Fault::LogCrowded, "log", why);
                return;
            }
            Err(error) => return self.broken(Err(error), out),
        }
        let mut written = Ok(());
        // What has no form in ROS 2 is kept as it is, and so is what finds no room in another form.
        let _ = self.translator.translate(channel, data, &mut |topic, cdr| match file.ros(topic, cdr, stamp) {
            Ok(()) | Err(McapError::TooManyChannels) => {}
            Err(error) => written = Err(error),
        });
        let full = file.chunk_is_full();
        self.open_chunk(at);
        self.chunk_messages += 1;
        self.broken(written, out);
        if full {
            self.cut(now, out);
        }
    }

    /// Opens a chunk whose oldest message was received at `at`, unless one is open.
    fn open_chunk(&mut self, at: Instant) {
        if !self.deadlines.is_set(Timer::Chunk) {
            self.deadlines.set(Timer::Chunk, at + CHUNK_FOR);
        }
    }

    /// Ends the chunk and hands it to the disk; begins the next file where this one is long enough.
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
        let oldest = self.deadlines.get(Timer::Chunk).map_or(now, |due| due - CHUNK_FOR);
        self.deadlines.clear(Timer::Chunk);
        let messages = std::mem::take(&mut self.chunk_messages);
        match taken {
            Ok(bytes) => self.disk.append(bytes, oldest, messages),
            Err(error) => self.broken(Err(error), out),
        }
    }

    /// The format refuses what no format should: the file is given up.
    fn broken(&mut self, result: McapResult<()>, out: &mut Actions) {
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
        self.choked = false;
    }

    /// Begins a file of the run, or of a new one. One that is awaited is opened when it is there.
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

    /// Opens the file that was begun.
    fn open(&mut self, now: Instant, out: &mut Actions) {
        let time = unix(out.epoch(), now);
        let Some(run) = &self.run else { return };
        let beginning = Beginning { config: &self.config, run: &run.name, time, monotonic: now.as_nanos() };
        match File::new(&beginning) {
            Ok(file) => self.file = Some(file),
            Err(error) => self.broken(Err(error), out),
        }
        // What stands before the first message is worth a place on the disk at once.
        self.deadlines.set(Timer::Chunk, now + CHUNK_FOR);
    }

    /// The file that was waited for is there: it begins with what was heard last.
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
            self.lose(now, unix(out.epoch(), first), dropped, out);
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
                let why = format!("CM_CMD_LOG: {} is no action", command.action);
                out.report(Severity::Warning, Fault::CommandForbidden, "log", why);
            }
        }
    }

    /// Notes a mark. As a message it is in the file already.
    fn mark(&mut self, now: Instant, time: u64, text: &str, out: &mut Actions) {
        if let Some(file) = &mut self.file {
            let marked = file.note("mark", [("time", time.to_string()), ("text", text.to_owned())]);
            self.open_chunk(now);
            self.broken(marked, out);
        }
    }

    fn on_answer(&mut self, now: Instant, answer: &Answer, out: &mut Actions) {
        match self.disk.answered(now, answer) {
            Some(News::Begun) => self.on_begun(now, out),
            // A run that has a file keeps its name. One that has none gets another: where others have made the folder, an
            // earlier life of ours may have been.
            Some(News::NotBegun) => self.run = self.run.take().filter(|run| run.next > 1),
            Some(News::Wrote(bytes)) => {
                if let Some(run) = &mut self.run {
                    run.bytes += bytes;
                }
            }
            Some(News::Lost) => self.give_up(now, out),
            Some(News::Full) => self.finish(now, out),
            Some(News::Known) | None => {}
        }
    }

    /// What waits for the disk will not come there.
    fn give_up(&mut self, now: Instant, out: &mut Actions) {
        let lost = self.disk.abandon();
        self.forget(now, lost, out);
    }

    fn forget(&mut self, now: Instant, lost: u64, out: &mut Actions) {
        self.file = None;
        self.deadlines.clear(Timer::Chunk);
        let lost = lost + std::mem::take(&mut self.chunk_messages);
        let time = self.log_time;
        self.lose(now, time, lost, out);
    }

    /// Does what is due.
    fn go_on(&mut self, now: Instant, out: &mut Actions) {
        let sync = self.deadlines.is_set(Timer::Chunk) && self.disk.sync_is_due(now);
        if self.deadlines.is_due(Timer::Chunk, now) || sync {
            self.cut(now, out);
        }
        self.ask(now, out);
        if self.wanted && self.allowed && self.file.is_none() && self.disk.is_ready() {
            self.begin_file(now, true, out);
            self.ask(now, out);
        }
        self.judge(now, out);
        self.tell(now, out);
    }

    fn ask(&mut self, now: Instant, out: &mut Actions) {
        if let Some(request) = self.disk.poll_request(now) {
            out.store(PORT, request);
        }
    }

    /// Faults begin and end.
    fn judge(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.take(Timer::Losses, now) {
            let why = format!("no message lost for {} s", LOSSES_OVER.as_secs());
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
                out.clear(Fault::LogRefused, "log", "the disk takes what is recorded");
                out.working();
                self.refused = false;
            }
            _ => {}
        }
    }

    fn tell(&mut self, now: Instant, out: &mut Actions) {
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
                out.clear(Fault::PortDown, self.config.bus.as_str(), "the folder of logs is there");
                self.disk.up();
                out.working();
            }
            Input::Down(why) => {
                let message = format!("the folder of logs is not there: {why}; tried again");
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

/// A moment in nanoseconds since the UNIX epoch.
fn unix(epoch: Epoch, at: Instant) -> u64 {
    u64::try_from(i128::from(epoch.offset_us) * 1000 + i128::from(at.as_nanos())).unwrap_or(0)
}

/// The beginning of a mark's text that is kept.
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
            Event::RawMessage { at, channel, data } => self.on_heard(now, at, channel, data, out),
            Event::Message { at, message: Message::CmCmdLog(command) } => self.on_command(now, at, command, out),
            Event::Port { input, .. } => self.on_port(now, &input, out),
            Event::State(state) => self.on_state(now, state, out),
            Event::Message { .. } | Event::Timer | Event::Process(_) => {}
        }
        self.go_on(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.deadlines.next(), self.disk.poll_timeout()])
    }

    fn finished(&self) -> bool {
        self.disk.is_idle()
    }
}
