//! The official library: its client at our hub, our client at its hub.

use super::{PATIENCE, Relay, payload, receive, settle};
use lcm::live::Lcm;
use lcm::tcpq::hub::Limits;
use lcm::url::Url;
use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddrV4, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use testing::{peer_or_skip, python, tool};

/// An official client, ended with the test.
struct Peer {
    process: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Peer {
    fn start(python: &Path, url: &Url) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/tcpq/peer.py");
        let mut command = Command::new(python);
        command.arg(script).arg(url.to_string()).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let (stdin, stdout) = (process.stdin.take().unwrap(), BufReader::new(process.stdout.take().unwrap()));
        let mut peer = Self { process, stdin, stdout };
        assert_eq!(peer.line(), "ready");
        peer
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.stdout.read_line(&mut line).unwrap();
        line.trim_end().into()
    }

    /// Gives a command; what was received before it was done.
    fn tell(&mut self, command: &str) -> Vec<String> {
        writeln!(self.stdin, "{command}").unwrap();
        let lines = std::iter::from_fn(|| Some(self.line()).filter(|line| line != "done"));
        lines.collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// How the peer names a message of ours.
fn got(channel: &str, size: usize, sha1: &str) -> String {
    format!("got {channel} {size} {sha1}")
}

/// SHA-1 of `payload(size)`, as Python says.
const SIZES: [(usize, &str); 3] = [
    (0, "da39a3ee5e6b4b0d3255bfef95601890afd80709"),
    (1000, "36b3862969aef72235b9f6aadcf795eefeacd183"),
    (3_000_000, "d83366346ef5a99212fcac66e87fd6532d3f16a3"),
];

#[test]
fn the_official_client_is_served_by_our_hub() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let relay = Relay::start(Limits::default());
    let mut ours = relay.client();
    ours.subscribe("TO_US.*").unwrap();
    settle(&mut ours, "TO_US");
    let mut peers = [Peer::start(&python, &relay.url()), Peer::start(&python, &relay.url())];
    for (n, peer) in peers.iter_mut().enumerate() {
        assert!(peer.tell(&format!("subscribe TO_PEER_{n}")).is_empty());
        assert!(peer.tell("subscribe TO_ALL.*").is_empty());
        // In the same stream: when it is here, the hub knows the subscriptions.
        peer.tell("publish TO_US 3");
        assert_eq!(receive(&mut ours), ("TO_US".into(), payload(3)));
    }
    for (size, sha1) in SIZES {
        ours.publish("TO_PEER_1", &payload(size)).unwrap();
        ours.publish("TO_ALL_2", &payload(size)).unwrap();
        // What the kernel did not take at once goes out while we wait for what is sent then.
        let [one, other] = &mut peers;
        let heard = std::thread::scope(|scope| {
            let heard = scope.spawn(|| [vec![one.line()], vec![other.line(), other.line()]]);
            while !heard.is_finished() {
                ours.recv_timeout(Duration::from_millis(10)).unwrap();
            }
            heard.join().unwrap()
        });
        assert_eq!(heard[0], [got("TO_ALL_2", size, sha1)]);
        assert_eq!(heard[1], [got("TO_PEER_1", size, sha1), got("TO_ALL_2", size, sha1)]);
        one.tell(&format!("publish TO_US_TOO {size}"));
        assert!(receive(&mut ours) == ("TO_US_TOO".into(), payload(size)), "{size}");
    }
    // From one to the other, which hears it once although two of its subscriptions match; then to none.
    let [one, other] = &mut peers;
    one.tell("publish TO_ALL 1000");
    assert_eq!([one.line(), other.line()], [got("TO_ALL", 1000, SIZES[1].1), got("TO_ALL", 1000, SIZES[1].1)]);
    assert!(other.tell("unsubscribe TO_ALL.*").is_empty());
    other.tell("publish TO_US 3");
    assert_eq!(receive(&mut ours).0, "TO_US");
    one.tell("publish TO_ALL 1000");
    one.tell("publish TO_PEER_1 1000");
    assert_eq!(one.line(), got("TO_ALL", 1000, SIZES[1].1));
    assert_eq!(other.line(), got("TO_PEER_1", 1000, SIZES[1].1), "what it no longer wants does not come before");
    drop(peers);
    let (stats, _) = relay.end();
    assert_eq!((stats.malformed, stats.unusable, stats.dropped, stats.accepted), (0, 0, 0, 3));
}

/// The official hub, ended with the test.
struct JavaHub(Child);

impl JavaHub {
    /// `None` without Java or the official LCM.
    fn start() -> Option<(Self, SocketAddrV4)> {
        let python = peer_or_skip(python(&["lcm"]))?;
        let module = Command::new(python).args(["-c", "import lcm; print(lcm.__file__)"]).output().unwrap();
        let module = PathBuf::from(String::from_utf8(module.stdout).unwrap().trim());
        let jar = module.ancestors().nth(2)?.join("share/java/lcm.jar");
        assert!(jar.exists(), "the official package has its hub: {}", jar.display());
        peer_or_skip(tool("java", "-version"))?;
        // Free now; it cannot be asked to choose one itself.
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap().port();
        let mut command = Command::new("java");
        command.arg("-cp").arg(jar).args(["lcm.lcm.TCPService", &port.to_string()]);
        let process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        Some((Self(process), SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)))
    }
}

impl Drop for JavaHub {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// As [`settle`] at a hub that begins to serve a client before it sends it anything (`TCPService.AcceptThread`): what
/// that client publishes in this moment does not come back to it.
fn settle_again_and_again(lcm: &mut Lcm, channel: &str) {
    let until = Instant::now() + PATIENCE;
    for number in 0u32.. {
        assert!(Instant::now() < until, "{:?}", lcm.stats());
        let _ = lcm.publish(channel, &number.to_be_bytes());
        while let Some(message) = lcm.recv_timeout(Duration::from_millis(200)).unwrap() {
            // Those before it have come already, or do not come.
            if message.payload == number.to_be_bytes() {
                return;
            }
        }
    }
}

#[test]
fn our_client_is_served_by_the_official_hub() {
    let Some((_hub, address)) = JavaHub::start() else { return };
    // Before the hub listens: a Java machine takes its time.
    let mut lcms = [Lcm::new(&Url::Tcpq(address)).unwrap(), Lcm::new(&Url::Tcpq(address)).unwrap()];
    for (n, lcm) in lcms.iter_mut().enumerate() {
        lcm.subscribe(&format!("TO_{n}|ALL")).unwrap();
        settle_again_and_again(lcm, &format!("TO_{n}"));
    }
    let [one, other] = &mut lcms;
    for size in [0, 1, 100_000] {
        one.publish("TO_1", &payload(size)).unwrap();
        assert!(receive(other) == ("TO_1".into(), payload(size)));
        other.publish("ALL", &payload(size)).unwrap();
        assert!(receive(one) == ("ALL".into(), payload(size)));
        assert!(receive(other) == ("ALL".into(), payload(size)));
    }
    let id = other.subscribe("MORE").unwrap();
    settle(other, "MORE");
    assert!(other.unsubscribe(id));
    other.publish("MORE", b"").unwrap();
    settle(other, "TO_1");
    assert_eq!((other.stats().malformed, other.stats().unwanted), (0, 0));
}
