//! Separate bus over UDP, and the script on its other side.
#![allow(dead_code, reason = "benches use it too, each its part")]

use crate::support::{can_port, python, workspace};
use base::can::Frame;
use base::{Duration, Instant};
use host::ports::{Port, PortConfig, Received};
use module::{Input, Output};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::{self, JoinHandle};

/// Timeout, longer than a peer takes on a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(20);
/// Longest wait for frames; then the script is checked.
const GLANCE: Duration = Duration::from_millis(5);

/// Port of the live host on a UDP bus, and the time since it was opened.
pub struct Bus {
    pub port: u16,
    device: Port,
    begin: std::time::Instant,
}

impl Bus {
    /// Bus on an unused port.
    pub fn new() -> Self {
        Self::on(can_port())
    }

    pub fn on(port: u16) -> Self {
        let bus = SocketAddrV4::new(Ipv4Addr::new(239, 74, 163, 2), port);
        let mut device = Port::new("can.peers".into(), PortConfig::CanUdp { bus });
        device.device.open().expect("multicast works here");
        Self { port, device, begin: std::time::Instant::now() }
    }

    pub fn now(&self) -> Instant {
        Instant::from_nanos(self.begin.elapsed().as_nanos() as u64)
    }

    pub fn send(&mut self, frame: Frame) {
        let now = self.now();
        assert!(self.device.device.send(now, &Output::Can(frame)).expect("the bus works"), "no room for {frame:?}");
    }

    /// Waits for a frame, or until `until`, but only briefly.
    pub fn wait(&mut self, until: Option<Instant>) {
        let now = self.now();
        let wait = until.map_or(GLANCE, |until| until.since(now).min(GLANCE));
        let fd = self.device.device.fd().expect("it is open");
        // Rounded up: an early wake-up would only repeat the loop.
        let millis = PollTimeout::try_from(wait.as_nanos().div_ceil(1_000_000) as i32).expect("a few milliseconds");
        let _ = poll(&mut [PollFd::new(fd, PollFlags::POLLIN)], millis);
    }

    pub fn receive(&mut self) -> Option<Frame> {
        let now = self.now();
        loop {
            match self.device.device.receive(now).expect("the bus works") {
                Received::Input { input: Input::Can { frame, .. }, .. } => return Some(frame),
                Received::Nothing => return None,
                Received::Fault(_, why) => panic!("{why}"),
                _ => {}
            }
        }
    }
}

/// Script on the bus, with lines as input and output. Killed when dropped.
pub struct Script {
    child: Child,
    lines: Receiver<String>,
    errors: Option<JoinHandle<String>>,
}

impl Script {
    /// Starts `FILE PORT ARGS...`; `None`, with a report, without a Python that has the peers.
    pub fn start(file: &str, bus: &Bus, args: &[&str]) -> Option<Self> {
        let port = bus.port.to_string();
        let args: Vec<&str> = std::iter::once(port.as_str()).chain(args.iter().copied()).collect();
        Self::run(file, &args)
    }

    /// Starts `FILE ARGS...`; `None`, with a report, without a Python that has the peers.
    pub fn run(file: &str, args: &[impl AsRef<OsStr>]) -> Option<Self> {
        let mut child = Command::new(python()?)
            .arg("-u")
            .arg(workspace().join(file))
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("Python starts");
        let (say, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().expect("a pipe"));
        thread::spawn(move || stdout.lines().map_while(Result::ok).try_for_each(|line| say.send(line)));
        let mut stderr = child.stderr.take().expect("a pipe");
        let errors = thread::spawn(move || {
            let mut text = String::new();
            let _ = stderr.read_to_string(&mut text);
            text
        });
        Some(Self { child, lines, errors: Some(errors) })
    }

    /// Next printed line.
    pub fn heard(&mut self) -> Option<String> {
        self.lines.try_recv().ok()
    }

    pub fn say(&mut self, line: &str) {
        let stdin = self.child.stdin.as_mut().expect("a pipe");
        writeln!(stdin, "{line}").expect("the script listens");
    }

    /// True once it has ended; it must have succeeded.
    #[track_caller]
    pub fn is_over(&mut self) -> bool {
        match self.child.try_wait().expect("it is our child") {
            Some(status) => {
                self.judge(status);
                true
            }
            None => false,
        }
    }

    /// What it wrote to standard error, once it has failed.
    pub fn failed(&mut self) -> Option<String> {
        let status = self.child.try_wait().expect("it is our child")?;
        let errors = self.errors.take().map_or(String::new(), |errors| errors.join().unwrap_or_default());
        (!status.success()).then_some(errors)
    }

    #[track_caller]
    fn judge(&mut self, status: ExitStatus) {
        let errors = self.errors.take().map_or(String::new(), |errors| errors.join().unwrap_or_default());
        assert!(status.success(), "{}\n{errors}", self.lines.try_iter().collect::<Vec<_>>().join("\n"));
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(errors) = self.errors.take()
            && thread::panicking()
        {
            println!("{}", errors.join().unwrap_or_default());
        }
    }
}
