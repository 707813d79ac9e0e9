//! Ways by which bad input reaches a robot.

use super::recipes::{REQUESTS, below, forged, fragment, frame, mutate, pick};
use crate::support::{self, Robot};
use host::ports::can_udp_codec;
use messages::{Message, common};
use module::State;
use robot::topology::can_port_beside;
use simulator::Random;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream, UdpSocket};
use std::os::unix::fs::FileExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::{Duration, Instant};

const LCM_GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 76, 67);
const CAN_GROUP: Ipv4Addr = Ipv4Addr::new(239, 74, 163, 2);
/// Shots of one turn, which is some 10 ms.
const DATAGRAMS: u64 = 20;
/// Size of a large station: sparse, of a size that a reader must not believe.
const HUGE: u64 = 1 << 40;
/// Connections that are held open.
const HELD: usize = 64;
/// Part of a log that is copied, bytes.
const LOG_MAX: u64 = 1 << 20;
/// Time within which a program has read a log, s.
const READ_S: f64 = 30.0;

/// Way in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Attack {
    /// Datagrams on the LCM bus.
    Datagrams,
    /// Files in the folder of the bus's shared memory.
    Stations,
    /// Frames on the CAN bus.
    Frames,
    /// Requests to the web server.
    Requests,
    /// Recorded logs.
    Logs,
}

impl Attack {
    pub const ALL: [Self; 5] = [Self::Datagrams, Self::Frames, Self::Stations, Self::Requests, Self::Logs];
}

/// What is needed to attack one robot.
pub struct Yard {
    lcm: UdpSocket,
    can: UdpSocket,
    http: SocketAddr,
    /// Last message of each channel of the bus.
    corpus: BTreeMap<String, Vec<u8>>,
    bus: lcm::live::Lcm,
    /// Folder of the bus's shared memory.
    stations: PathBuf,
    /// A station of a process was truncated in this round.
    pub cut: bool,
    /// Files of this attack.
    made: Vec<PathBuf>,
    held: Vec<TcpStream>,
    folder: PathBuf,
    reading: Option<(Child, String, Instant)>,
    number: u64,
}

impl Yard {
    pub fn new(robot: &Robot, http: SocketAddr) -> Self {
        let socket = |port, group| {
            let socket = UdpSocket::bind("0.0.0.0:0").expect("a socket");
            socket.set_multicast_ttl_v4(0).expect("it stays on this machine");
            socket.connect((group, port)).expect("a group");
            socket
        };
        let end = format!("-{}", robot.port);
        let folders = fs::read_dir("/dev/shm").into_iter().flatten().filter_map(Result::ok).map(|entry| entry.path());
        let mut folders = folders.filter(|path| path.is_dir() && path.to_string_lossy().ends_with(&end));
        let folder = robot.run_dir.with_extension("hostile");
        fs::create_dir_all(&folder).expect("a folder");
        Self {
            lcm: socket(robot.port, LCM_GROUP),
            can: socket(can_port_beside(robot.port), CAN_GROUP),
            http,
            corpus: BTreeMap::new(),
            bus: support::listen(&robot.url),
            stations: folders.next().expect("the bus has a folder in memory"),
            cut: false,
            made: Vec::new(),
            held: Vec::new(),
            folder,
            reading: None,
            number: 0,
        }
    }

    /// Shoots for a turn; gives the number of shots.
    pub fn shoot(&mut self, robot: &Robot, attack: Attack, random: &mut Random) -> u64 {
        while let Ok(Some(received)) = self.bus.recv() {
            self.corpus.insert(received.channel.into(), received.payload.into());
        }
        match attack {
            Attack::Datagrams => (0..DATAGRAMS).map(|_| self.datagram(random)).sum(),
            Attack::Frames => (0..DATAGRAMS / 4).map(|_| self.frame(random)).sum(),
            Attack::Stations => self.station(robot, random),
            Attack::Requests => self.request(random),
            Attack::Logs => self.log(robot, random),
        }
    }

    fn datagram(&mut self, random: &mut Random) -> u64 {
        let (channel, payload) = match random.chance(0.4) {
            true => {
                let (message, mut payload) = (forged(random), Vec::new());
                let _unencodable = message.encode(&mut payload);
                (message.channel_name().into_owned(), payload)
            }
            false => {
                let all: Vec<&String> = self.corpus.keys().collect();
                if all.is_empty() {
                    return 0;
                }
                let (channel, payload) = (*pick(random, &all), pick(random, &all));
                // Sometimes the type of another channel.
                let payload = &self.corpus[if random.chance(0.9) { channel } else { *payload }];
                (channel.clone(), payload.clone())
            }
        };
        let mut datagram = match random.chance(0.3) {
            true => fragment(random, &channel, &payload),
            false => {
                let mut datagram = b"LC02".to_vec();
                datagram.extend((random.bits() as u32).to_be_bytes());
                datagram.extend(channel.as_bytes());
                datagram.push(0);
                datagram.extend(&payload);
                datagram
            }
        };
        // The header is mutated less often: a message with a bad header is dropped early.
        let keep = if random.chance(0.1) { 0 } else { 8 + channel.len() + 1 + 8 };
        mutate(random, &mut datagram, keep);
        datagram.truncate(65_000);
        if ends_modules(&datagram) {
            return 0;
        }
        u64::from(self.lcm.send(&datagram).is_ok())
    }

    fn frame(&mut self, random: &mut Random) -> u64 {
        let mut datagram = Vec::new();
        can_udp_codec::encode(&frame(random), 0.0, &mut datagram);
        if random.chance(0.3) {
            mutate(random, &mut datagram, 0);
        }
        u64::from(self.can.send(&datagram).is_ok())
    }

    /// Truncates the station of a process; false if it has none.
    pub fn truncate(&self, process: u32, size: u64) -> bool {
        let station = files(&self.stations, ".station").into_iter().find(|path| owner(path) == Some(process));
        let file = station.and_then(|path| OpenOptions::new().write(true).open(path).ok());
        file.is_some_and(|file| file.set_len(size).is_ok())
    }

    /// Files that are not stations, and once in a round a station that is truncated.
    fn station(&mut self, robot: &Robot, random: &mut Random) -> u64 {
        self.number += 1;
        let own = format!("{}-", std::process::id());
        let all: Vec<PathBuf> = files(&self.stations, ".station");
        let others: Vec<&PathBuf> = all
            .iter()
            .filter(|path| {
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                !name.starts_with(&own) && !name.starts_with("hostile")
            })
            .collect();
        if others.is_empty() {
            return 0;
        }
        let path = self.stations.join(format!("hostile-{}.station", self.number));
        let done = match below(random, 8) {
            0 => fs::write(&path, vec![0xA5; *pick(random, &[0, 1, 4095, 4096, 70_000])]),
            1 => File::create(&path).and_then(|file| file.set_len(*pick(random, &[4096, 4 << 20, HUGE]))),
            2 => fs::create_dir(&path),
            3 => std::os::unix::fs::symlink(pick(random, &["/dev/zero", "/", "x"]), &path),
            4 => nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).map_err(Into::into),
            5 if !self.cut && random.chance(0.2) => {
                self.cut = true;
                let robots = robot.processes();
                let theirs = |path: &&&PathBuf| owner(path).is_some_and(|pid| robots.contains(&pid));
                let theirs: Vec<&&PathBuf> = others.iter().filter(theirs).collect();
                match theirs.is_empty() {
                    true => Ok(()),
                    false => OpenOptions::new().write(true).open(pick(random, &theirs)).and_then(|file| {
                        let size = *pick(random, &[0, 100, 4096, 8192, 1_000_000, 4096 + (4 << 20) + 4095]);
                        file.set_len(size)
                    }),
                }
            }
            // The content of a live station under another name, mutated.
            _ => {
                let (mut bytes, mut last) = (vec![0; 64 << 10], [0; 8]);
                File::open(pick(random, &others)).and_then(|mut file| {
                    let length = file.read(&mut bytes)?;
                    bytes.truncate(length);
                    mutate(random, &mut bytes, 0);
                    let mut copy = File::create(&path)?;
                    copy.write_all(&bytes)?;
                    // Its last word says that it is a station.
                    let end = file.metadata()?.len().saturating_sub(last.len() as u64);
                    file.read_exact_at(&mut last, end)?;
                    copy.write_all_at(&last, end)
                })
            }
        };
        self.made.push(path);
        u64::from(done.is_ok())
    }

    fn request(&mut self, random: &mut Random) -> u64 {
        let mut shots = 0;
        for _ in 0..4 {
            let mut request = pick(random, &REQUESTS).to_vec();
            if random.chance(0.1) {
                request.extend(vec![b'a'; below(random, 100_000)]);
            }
            mutate(random, &mut request, 0);
            let Ok(mut line) = TcpStream::connect_timeout(&self.http, Duration::from_millis(100)) else { continue };
            let _ = line.set_write_timeout(Some(Duration::from_millis(5)));
            // One that is refused may not read the rest.
            let _ = line.write_all(&request);
            shots += 1;
            self.held.push(line);
            if self.held.len() > HELD {
                self.held.remove(0);
            }
        }
        shots
    }

    /// A mutated copy of what the robot has recorded, for a program that reads it.
    fn log(&mut self, robot: &Robot, random: &mut Random) -> u64 {
        self.finish(false);
        if self.reading.is_some() {
            return 0;
        }
        let mut found = Vec::new();
        for run in files(&support::logs(&robot.run_dir), "") {
            found.extend(files(&run, ""));
            found.extend(files(&run.join("inputs"), ""));
        }
        found.retain(|path| path.is_file());
        found.sort();
        if found.is_empty() {
            return 0;
        }
        let source = pick(random, &found);
        let mut bytes = Vec::new();
        let _unreadable = File::open(source).and_then(|file| file.take(LOG_MAX).read_to_end(&mut bytes));
        for _ in 0..1 + below(random, 4) {
            mutate(random, &mut bytes, 0);
        }
        if random.chance(0.3) {
            bytes.truncate(below(random, bytes.len()));
        }
        let name = source.file_name().unwrap_or_default();
        let copy = self.folder.join(name);
        let _ = fs::write(&copy, bytes);
        let (file, exported) = (copy.display().to_string(), self.folder.join("exported").display().to_string());
        let command: &[&str] = match below(random, 5) {
            0 => &["log", "info", &file],
            1 => &["log", "cat", &file],
            2 => &["log", "play", &file, "--force", "--speed", "100", "--for", "2"],
            3 => &["log", "export", &file, "--format", "lcm", "--out", &exported],
            _ => &["replay", &file],
        };
        // What is offline has no bus.
        let child = match command[0] {
            "replay" => support::offline(command),
            _ => robot.spawn(command),
        };
        self.reading = Some((child, command.join(" "), Instant::now()));
        1
    }

    /// Waits for the end of a program that reads a log: it may refuse the log, but must neither crash nor run forever.
    fn finish(&mut self, wait: bool) {
        let Some((child, command, begin)) = &mut self.reading else { return };
        loop {
            if let Some(status) = child.try_wait().expect("it is our child") {
                let panicked = status.code() == Some(101);
                assert!(status.signal().is_none() && !panicked, "advee {command}: {status}; {}", self.folder.display());
                self.reading = None;
                return;
            }
            if !wait {
                return;
            }
            assert!(begin.elapsed().as_secs_f64() < READ_S, "advee {command} goes on; {}", self.folder.display());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Undoes everything that would last; the web server answers again.
    pub fn clean(&mut self) {
        self.finish(true);
        for path in self.made.drain(..) {
            let _gone = fs::remove_file(&path).or_else(|_| fs::remove_dir(&path));
        }
        if !self.held.is_empty() {
            self.held.clear();
            let begin = Instant::now();
            while !answers(self.http) {
                assert!(begin.elapsed().as_secs_f64() < 10.0, "the web server does not answer");
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    }
}

impl Drop for Yard {
    fn drop(&mut self) {
        if let Some((child, ..)) = &mut self.reading {
            let _ = child.kill();
            let _ = child.wait();
        }
        for path in &self.made {
            let _gone = fs::remove_file(path).or_else(|_| fs::remove_dir(path));
        }
        // What made a program fail stays there.
        if !std::thread::panicking() {
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// True for a message that ends modules, which is accepted from any sender, as it stops the robot.
fn ends_modules(datagram: &[u8]) -> bool {
    let Some(body) = datagram.strip_prefix(b"LC02").and_then(|rest| rest.get(4..)) else { return false };
    let Some(end) = body.iter().position(|byte| *byte == 0) else { return false };
    let Ok(channel) = std::str::from_utf8(&body[..end]) else { return false };
    let terminate = |state: &common::CmdState| state.state == State::Terminate as i8;
    matches!(Message::receive(channel, &body[end + 1..]), Some(Ok(Message::CmCmdState(state))) if terminate(&state))
}

/// Entries of a folder whose names end so.
fn files(folder: &Path, end: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|entry| entry.path());
    let mut found: Vec<PathBuf> = entries.filter(|path| path.to_string_lossy().ends_with(end)).collect();
    found.sort();
    found
}

/// Process that has a station mapped.
fn owner(path: &Path) -> Option<u32> {
    let name = path.file_name()?.to_str()?;
    name.split(['-', '.']).find_map(|part| part.parse().ok())
}

fn answers(http: SocketAddr) -> bool {
    let Ok(mut line) = TcpStream::connect_timeout(&http, Duration::from_millis(500)) else { return false };
    let _ = line.set_read_timeout(Some(Duration::from_secs(1)));
    let _ = line.write_all(b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    let mut answer = [0; 12];
    line.read_exact(&mut answer).is_ok() && answer == *b"HTTP/1.1 200"
}
