//! A peer's process and our context on one bus, and what must go both ways between them.

use crate::cases::Case;
use crate::common;
use crate::types::{self, Built};
use lcm::Url;
use lcm::live::{Hub, Lcm, PublishError};
use lcm::url::Udpm;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A datagram of a large message may be lost on a loaded machine; then the message is sent again, so often at most.
pub const ATTEMPTS: usize = 100;
/// Silence after which a message counts as lost and the mark behind it, too.
pub const SILENCE: Duration = Duration::from_millis(300);
/// Between two attempts to publish where there is no room.
const ROOM: Duration = Duration::from_millis(10);
/// The longest start of a peer.
pub const START: Duration = Duration::from_secs(30);

/// Takes the largest message at once; granted as far as the kernel or our rights allow.
const RECV_BUF_SIZE: usize = 32 << 20;

/// A channel and a payload.
pub type Message = (String, Vec<u8>);

/// A peer and we.
pub struct Both {
    name: String,
    lcm: Lcm,
    peer: Child,
    stdin: Option<ChildStdin>,
    stdout: Receiver<Message>,
    marks: u32,
}

/// A bus of our own, and the same for official peers: with as large a receive buffer as the kernel grants them.
pub fn urls() -> [Udpm; 2] {
    let max = fs::read_to_string("/proc/sys/net/core/rmem_max").unwrap();
    let url = common::url();
    [Udpm { recv_buf_size: RECV_BUF_SIZE, ..url.clone() }, Udpm { recv_buf_size: max.trim().parse().unwrap(), ..url }]
}

/// Serves until it is dropped.
pub struct Serving {
    /// Where.
    pub url: Url,
    stop: Sender<()>,
    thread: Option<JoinHandle<()>>,
}

impl Serving {
    /// Our hub of TCPQ on this host, in a thread.
    pub fn hub() -> Self {
        let mut hub = Hub::bind("127.0.0.1:0".parse().unwrap()).unwrap();
        let url = Url::parse(&format!("tcpq://{}", hub.address().unwrap())).unwrap().0;
        let (stop, stopped) = channel();
        let serve = move || {
            while stopped.try_recv() == Err(TryRecvError::Empty) {
                hub.wait(Duration::from_millis(100)).unwrap();
                hub.serve_once().unwrap();
            }
        };
        Self { url, stop, thread: Some(thread::spawn(serve)) }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.stop.send(());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

impl Both {
    /// Starts the peer on `theirs`, and us on `ours`, which is the same bus; returns when it is subscribed.
    pub fn start(name: &str, built: &Built, [ours, theirs]: [Url; 2]) -> Self {
        let mut command = built.program.command();
        command
            .arg("bus")
            .args(built.types.iter().filter(|it| it.1.is_none()).map(|it| &it.0))
            .env("LCM_DEFAULT_URL", theirs.to_string());
        let mut peer = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (stdin, stdout) = (peer.stdin.take(), listen(peer.stdout.take().unwrap()));
        let mut lcm = Lcm::new(&ours).unwrap();
        lcm.subscribe("FROM_.*").unwrap();
        let both = Self { name: name.into(), lcm, peer, stdin, stdout, marks: 0 };
        assert_eq!(both.stdout.recv_timeout(START).expect("the peer starts").0, "ready", "{name}");
        both
    }

    /// Sends all of a case in both directions; panics where something arrives as another, or not at all.
    pub fn raw(&mut self, case: &Case) {
        for (channel, payload) in case.directed("TO_") {
            self.deliver(&case.name, &channel, &payload, None);
        }
        self.raw_from(case);
    }

    /// The same, to us only.
    pub fn raw_from(&mut self, case: &Case) {
        for (channel, payload) in case.directed("FROM_") {
            self.collect(&case.name, &channel, &payload);
        }
    }

    /// Every vector of a type: encoded by us, decoded and encoded by the peer's generated code, decoded by us.
    pub fn typed(&mut self, name: &str) {
        for (_, vector) in types::encoded().iter().filter(|(of, _)| of == name) {
            assert_eq!(types::again(name, vector), *vector, "{name} by ourselves");
            let back = self.deliver(name, &types::channel(name), vector, Some("FROM_TYPED"));
            assert_eq!(types::again(name, &back), *vector, "{name} back from {}", self.name);
        }
    }

    /// Ends the peer, which must not have minded anything.
    pub fn end(mut self) {
        self.stdin = None;
        let status = self.peer.wait().unwrap();
        assert!(status.success(), "{}: {status}", self.name);
        let stats = self.lcm.stats();
        assert_eq!(stats.malformed, 0, "{}", self.name);
    }

    /// Publishes until the peer has it, then waits for its answer on `back`, which may not be lost.
    fn deliver(&mut self, case: &str, channel: &str, payload: &[u8], back: Option<&str>) -> Vec<u8> {
        for attempt in 1..=ATTEMPTS {
            self.publish(channel, payload);
            let (mark, end) = (self.mark(), Instant::now() + START);
            let arrived = loop {
                assert!(Instant::now() < end, "{} does not even hear {mark:?}", self.name);
                self.publish("TO_MARK", &mark);
                match self.stdout.recv_timeout(SILENCE) {
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => panic!("{case} ends {}", self.name),
                    Ok((came, bytes)) if came == "TO_MARK" && bytes == mark => break false,
                    Ok((came, _)) if came == "TO_MARK" => {}
                    Ok((came, bytes)) => {
                        assert_eq!(came, channel, "{case} to {}", self.name);
                        assert!(bytes == payload, "{case} to {}: {} bytes differ", self.name, bytes.len());
                        break true;
                    }
                }
            };
            if arrived {
                self.say(case, "to", attempt);
                let Some(back) = back else { return Vec::new() };
                loop {
                    let (came, bytes) = self.receive(START).expect("the peer publishes it, too");
                    if came == back {
                        return bytes;
                    }
                    assert_eq!(came, "FROM_MARK", "a late one is all that may stand before it");
                }
            }
            self.drain();
        }
        panic!("{case} to {}: lost {ATTEMPTS} times", self.name);
    }

    /// Lets the peer publish until we have it.
    fn collect(&mut self, case: &str, channel: &str, payload: &[u8]) {
        self.drain();
        for attempt in 1..=ATTEMPTS {
            self.let_publish(channel, payload);
            let (mark, end) = (self.mark(), Instant::now() + START);
            loop {
                assert!(Instant::now() < end, "not even {mark:?} comes from {}", self.name);
                self.let_publish("FROM_MARK", &mark);
                match self.receive(SILENCE) {
                    Some((came, bytes)) if came == "FROM_MARK" && bytes == mark => break,
                    Some((came, _)) if came == "FROM_MARK" => {}
                    Some((came, bytes)) => {
                        assert_eq!(came, channel, "{case} from {}", self.name);
                        assert!(bytes == payload, "{case} from {}: {} bytes differ", self.name, bytes.len());
                        return self.say(case, "from", attempt);
                    }
                    None => {}
                }
            }
        }
        panic!("{case} from {}: lost {ATTEMPTS} times", self.name);
    }

    /// Never the same twice.
    fn mark(&mut self) -> [u8; 4] {
        self.marks += 1;
        self.marks.to_be_bytes()
    }

    /// A loss is no failure of either side, but worth knowing.
    fn say(&self, case: &str, direction: &str, attempt: usize) {
        if attempt > 1 {
            println!("{case} {direction} {}: came at attempt {attempt}", self.name);
        }
    }

    /// Makes room in our receive buffer, where our own messages pass by as well.
    fn drain(&mut self) {
        while self.lcm.wait(Duration::ZERO).unwrap() {
            self.lcm.recv().unwrap();
        }
    }

    /// Publishes as soon as what was published before leaves room.
    fn publish(&mut self, channel: &str, payload: &[u8]) {
        let end = Instant::now() + START;
        while let Err(error) = self.lcm.publish(channel, payload) {
            let waits = matches!(error, PublishError::Busy) && Instant::now() < end;
            assert!(waits, "{channel} to {}: {error}", self.name);
            self.receive(ROOM); // writes what waits; nothing but marks comes now
        }
    }

    fn let_publish(&mut self, channel: &str, payload: &[u8]) {
        let stdin = self.stdin.as_mut().unwrap();
        for part in [&(channel.len() as u32).to_be_bytes(), &(payload.len() as u32).to_be_bytes()] {
            stdin.write_all(part).unwrap();
        }
        stdin.write_all(channel.as_bytes()).unwrap();
        stdin.write_all(payload).unwrap();
    }

    /// What comes to us within that time.
    fn receive(&mut self, patience: Duration) -> Option<Message> {
        let end = Instant::now() + patience;
        loop {
            if let Some(received) = self.lcm.recv().unwrap() {
                return Some((received.channel.into(), received.payload.into()));
            }
            let left = end.checked_duration_since(Instant::now())?;
            self.lcm.wait(left).unwrap();
        }
    }
}

impl Drop for Both {
    fn drop(&mut self) {
        let _ = self.peer.kill();
        let _ = self.peer.wait();
    }
}

/// What a peer writes: the channel `ready` first, then messages.
fn listen(stdout: ChildStdout) -> Receiver<Message> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut stdout = BufReader::new(stdout);
        let mut ready = String::new();
        stdout.read_line(&mut ready).unwrap();
        let mut next = Some((ready.trim_end().to_string(), Vec::new()));
        while let Some(message) = next {
            if sender.send(message).is_err() {
                return;
            }
            next = read(&mut stdout).ok();
        }
    });
    receiver
}

fn read(from: &mut impl Read) -> std::io::Result<Message> {
    let mut lengths = [[0; 4]; 2];
    from.read_exact(lengths.as_flattened_mut())?;
    let [channel_len, payload_len] = lengths.map(|length| u32::from_be_bytes(length) as usize);
    let (mut channel, mut payload) = (vec![0; channel_len], vec![0; payload_len]);
    from.read_exact(&mut channel)?;
    from.read_exact(&mut payload)?;
    Ok((String::from_utf8(channel).unwrap(), payload))
}
