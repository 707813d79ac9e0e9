//! Event logs: what the official libraries and `lcm-logger` write, and what they and `lcm-logplayer` read.

use crate::cases::cases;
use crate::official::{Official, Program, run};
use crate::peer::{ATTEMPTS, Message, SILENCE, START, urls};
use crate::table::{Cells, Mark};
use crate::types;
use lcm::eventlog::{Reader, Writer};
use lcm::live::Lcm;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The row of what is in the files.
pub const ROW: &str = "event log, byte for byte";
/// Between two looks at a log that is being written.
const LOOK: Duration = Duration::from_millis(20);

/// A log that we wrote, copied by the official library, is the same; so is that copy, copied by us. `empty`: also
/// events without a payload; where not, they are shown to be lost.
pub fn copied(program: &Program, empty: bool) {
    let [ours, theirs] = ["ours.lcmlog", "theirs.lcmlog"].map(|name| program.folder.join(name));
    let messages = cases().into_iter().flat_map(|case| case.directed("FROM_"));
    let typed = types::encoded().into_iter().map(|(name, bytes)| (types::channel(&name), bytes));
    let mut all: Vec<Message> = messages.chain(typed).collect();
    let copy = || run(program.command().arg("log").args([&ours, &theirs]));
    if !empty {
        fs::write(&ours, log(all.iter().cloned())).unwrap();
        let whole = copy().is_ok() && fs::read(&ours).unwrap() == fs::read(&theirs).unwrap();
        assert!(!whole, "{}: an event without a payload is copied", program.path.display());
        all.retain(|(_, payload)| !payload.is_empty());
    }
    fs::write(&ours, log(all.into_iter())).unwrap();
    copy().unwrap();
    let (ours, theirs) = (fs::read(ours).unwrap(), fs::read(theirs).unwrap());
    assert!(ours == theirs, "{}: {} bytes became {}", program.path.display(), ours.len(), theirs.len());
    assert!(again(&theirs) == theirs, "{}: read and written by us", program.path.display());
}

/// What is found with `lcm-logger` and `lcm-logplayer`.
pub fn tools(official: &Official) -> Cells {
    let folder = official.folder("tools", "log");
    records(official, &folder.join("logger.lcmlog"));
    plays(official, &folder.join("player.lcmlog"));
    let mut cells: Cells = cases().into_iter().map(|case| (case.name, Mark::Both)).collect();
    cells.push((ROW.into(), Mark::Both));
    cells
}

/// `lcm-logger` records what we publish, and its file is what we would have written.
fn records(official: &Official, path: &Path) {
    let [url, theirs] = urls();
    let mut logger = official.tool("lcm-logger");
    // The option -l of 1.3.1 is in its help only.
    logger.args(["-q", "-f", "--flush-interval", "10"]).arg(path).env("LCM_DEFAULT_URL", theirs.to_string());
    let mut logger = Tool(logger.spawn().unwrap());
    let mut lcm = Lcm::new(&url.into()).unwrap();
    for case in cases() {
        let mut missing = case.directed("TO_");
        let mut attempts = 0..ATTEMPTS;
        while !missing.is_empty() {
            let attempt = attempts.next().unwrap_or_else(|| panic!("{} to lcm-logger: lost", case.name));
            for (channel, payload) in &missing {
                lcm.publish(channel, payload).unwrap();
            }
            let bytes = recorded(&mut lcm, path, &format!("{} {attempt}", case.name));
            let found = read(&bytes);
            missing.retain(|message| !found.contains(message));
        }
    }
    logger.interrupt();
    let bytes = fs::read(path).unwrap();
    assert!(again(&bytes) == bytes, "the log of lcm-logger {}, read and written by us", official.version);
}

/// The log, as soon as this mark is in it.
fn recorded(lcm: &mut Lcm, path: &Path, mark: &str) -> Vec<u8> {
    let end = Instant::now() + START;
    while Instant::now() < end {
        lcm.publish("TO_MARK", mark.as_bytes()).unwrap();
        let look_again = Instant::now() + SILENCE;
        while Instant::now() < look_again {
            let bytes = fs::read(path).unwrap_or_default();
            if bytes.windows(mark.len()).rev().take(1 << 16).any(|window| window == mark.as_bytes()) {
                return bytes;
            }
            std::thread::sleep(LOOK); // a file cannot be waited for
        }
    }
    panic!("lcm-logger does not record");
}

/// We receive what `lcm-logplayer` plays of a log of ours.
fn plays(official: &Official, path: &Path) {
    let [url, theirs] = urls();
    let mut lcm = Lcm::new(&url.into()).unwrap();
    lcm.subscribe("FROM_.*").unwrap();
    let all: Vec<Message> = cases().iter().flat_map(|case| case.directed("FROM_")).collect();
    let mut missing = all.clone();
    for attempt in 0..ATTEMPTS {
        fs::write(path, log(missing.iter().cloned())).unwrap();
        let mut player = official.tool("lcm-logplayer");
        player.arg(path).env("LCM_DEFAULT_URL", theirs.to_string());
        let mut player = Tool(player.stdout(Stdio::null()).spawn().unwrap());
        loop {
            let ended = player.0.try_wait().unwrap();
            while let Some(received) = lcm.recv().unwrap() {
                let this = |it: &Message| it.0 == received.channel && it.1 == received.payload;
                let (channel, len) = (received.channel, received.payload.len());
                assert!(all.iter().any(this), "{channel} with {len} bytes came as another");
                // A burst may be on its way through the kernel when its player has ended: it was not lost, it is late.
                match missing.iter().position(this) {
                    Some(at) => drop(missing.remove(at)),
                    None => assert!(attempt > 0, "{channel} with {len} bytes came twice"),
                }
            }
            match ended {
                Some(status) => break assert!(status.success(), "lcm-logplayer: {status}"),
                None => drop(lcm.wait(LOOK).unwrap()),
            }
        }
        if missing.is_empty() {
            return;
        }
    }
    panic!("lcm-logplayer: {} messages are lost", missing.len());
}

/// A log of these messages, a millisecond apart.
fn log(messages: impl Iterator<Item = Message>) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new());
    for (n, (channel, payload)) in messages.enumerate() {
        writer.write(1_800_000_000_000_000 + 1000 * n as i64, &channel, &payload).unwrap();
    }
    writer.into_inner()
}

/// A log's messages.
fn read(bytes: &[u8]) -> Vec<Message> {
    let (mut reader, mut messages) = (Reader::new(bytes), Vec::new());
    while let Some(event) = reader.next_event().unwrap() {
        messages.push((event.channel.into(), event.payload.into()));
    }
    messages
}

/// A log, read and written by us.
fn again(bytes: &[u8]) -> Vec<u8> {
    let (mut reader, mut writer) = (Reader::new(bytes), Writer::new(Vec::new()));
    while let Some(event) = reader.next_event().unwrap() {
        let number = writer.write(event.timestamp_us, event.channel, event.payload).unwrap();
        assert_eq!(number, event.number);
    }
    writer.into_inner()
}

/// An official program.
struct Tool(Child);

impl Tool {
    /// Ctrl-C; it ends in good order.
    fn interrupt(&mut self) {
        run(Command::new("sh").args(["-c", "kill -INT $0", &self.0.id().to_string()])).unwrap();
        let status = self.0.wait().unwrap();
        assert!(status.success(), "lcm-logger: {status}");
    }
}

impl Drop for Tool {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
