//! Round trips between two processes, and messages a second: raw multicast sockets, LCM by datagrams, LCM through
//! shared memory, in turn, or only those that are named. `cargo run --release -p lcm --example pingpong`
#![allow(clippy::disallowed_methods, reason = "measures, with real clocks, sockets and processes")]
#![allow(clippy::unwrap_used, reason = "a tool for developers")]

use lcm::live::Lcm;
use lcm::url::{Shm, Udpm};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

const TRANSPORTS: [&str; 3] = ["raw", "udpm", "shm"];
const SIZES: [usize; 3] = [64, 1024, 65_536];
const ROUNDS: u16 = 5;
const TRIPS: usize = 3000;
const FLOOD: Duration = Duration::from_millis(500);
const PATIENCE: Duration = Duration::from_secs(5);
/// The largest piece of a message of raw sockets.
const PIECE: usize = 65_507;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    match &arguments[1..] {
        [role, transport, port] if role == "echo" => echo(&mut End::open(transport, port.parse().unwrap(), false)),
        [_, transport, port] => publish(transport, port.parse().unwrap()),
        only => measure(only),
    }
}

fn measure(only: &[String]) {
    let mut trips: [[Vec<f64>; SIZES.len()]; TRANSPORTS.len()] = Default::default();
    let mut floods: [Vec<[f64; 2]>; TRANSPORTS.len()] = Default::default();
    for round in 0..ROUNDS {
        for (which, transport) in TRANSPORTS.iter().enumerate() {
            if !only.is_empty() && !only.contains(&transport.to_string()) {
                continue;
            }
            let port = 20_000 + (std::process::id() % 8000) as u16 + 20 * round + 4 * which as u16;
            let mut end = End::open(transport, port, true);
            let peer = Peer::start("echo", transport, port);
            for (size, all) in SIZES.iter().zip(&mut trips[which]) {
                all.push(round_trip(&mut end, *size));
            }
            drop((peer, end));
            if *transport != "raw" {
                floods[which].push(flood(transport, port + 2));
            }
        }
    }
    println!("round trip in µs, median of {ROUNDS} medians of {TRIPS} (ratio to raw multicast)");
    for (which, transport) in TRANSPORTS.iter().enumerate() {
        print!("{transport:5}");
        for (size, number) in SIZES.iter().enumerate() {
            let (own, raw) = (median(&trips[which][size]), median(&trips[0][size]));
            print!("   {number:5} B {own:6.1} ({:.2})", own / raw);
        }
        println!();
    }
    println!("messages of 64 B as fast as possible");
    for (transport, floods) in TRANSPORTS.iter().zip(&floods).skip(1) {
        let [rate, lost] = [0, 1].map(|column| median(&floods.iter().map(|flood| flood[column]).collect::<Vec<f64>>()));
        println!("{transport:5}   {:6.0} k/s received, {:4.1} % lost", rate / 1e3, 100.0 * lost);
    }
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Another process of this program, ended with this value.
struct Peer(Child);

impl Peer {
    fn start(role: &str, transport: &str, port: u16) -> Self {
        let program = std::env::current_exe().unwrap();
        Self(Command::new(program).args([role, transport, &port.to_string()]).spawn().unwrap())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn url(transport: &str, port: u16) -> lcm::Url {
    let shm = if transport == "shm" { Shm::Auto } else { Shm::Off };
    Udpm { group: group(), port, shm, ..Udpm::default() }.into()
}

fn group() -> Ipv4Addr {
    Ipv4Addr::new(239, 194, 7, 67)
}

/// One end of a conversation.
enum End {
    Raw { receive: UdpSocket, send: UdpSocket, to: SocketAddrV4, buffer: Vec<u8> },
    Lcm { lcm: Box<Lcm>, to: &'static str },
}

impl End {
    fn open(transport: &str, port: u16, first: bool) -> Self {
        let [own, other] = if first { [0, 1] } else { [1, 0] };
        if transport == "raw" {
            let receive = UdpSocket::bind((group(), port + own)).unwrap();
            receive.join_multicast_v4(&group(), &Ipv4Addr::LOCALHOST).unwrap();
            receive.set_read_timeout(Some(PATIENCE)).unwrap();
            let send = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            send.set_multicast_ttl_v4(0).unwrap();
            let to = SocketAddrV4::new(group(), port + other);
            return Self::Raw { receive, send, to, buffer: vec![0; 1 << 17] };
        }
        let mut lcm = Lcm::new(&url(transport, port)).unwrap();
        let names = ["PING", "PONG"];
        lcm.subscribe(names[usize::from(own)]).unwrap();
        Self::Lcm { lcm: lcm.into(), to: names[usize::from(other)] }
    }

    fn send(&mut self, payload: &[u8]) {
        match self {
            Self::Raw { send, to, .. } => payload.chunks(PIECE).for_each(|piece| {
                send.send_to(piece, *to).unwrap();
            }),
            Self::Lcm { lcm, to, .. } => lcm.publish(to, payload).unwrap(),
        }
    }

    /// The length of the next message, if one comes in time.
    fn receive(&mut self) -> Option<usize> {
        match self {
            Self::Raw { receive, buffer, .. } => {
                let len = receive.recv(buffer).ok()?;
                Some(if len == PIECE { len + receive.recv(&mut buffer[PIECE..]).ok()? } else { len })
            }
            Self::Lcm { lcm, .. } => {
                // None may come early.
                let begin = Instant::now();
                while begin.elapsed() < PATIENCE {
                    if let Some(message) = lcm.recv_timeout(PATIENCE).unwrap() {
                        return Some(message.payload.len());
                    }
                }
                None
            }
        }
    }
}

fn echo(end: &mut End) {
    let answer = vec![0xa5; SIZES[SIZES.len() - 1]];
    end.send(b"ready");
    while let Some(len) = end.receive() {
        end.send(&answer[..len]);
    }
}

fn round_trip(end: &mut End, size: usize) -> f64 {
    let payload = vec![0x5a; size];
    let mut trips = Vec::new();
    // That the other end is there, or the answer to the last message.
    assert!(end.receive().is_some(), "the other end is there");
    for _ in 0..TRIPS {
        let begin = Instant::now();
        end.send(&payload);
        assert_eq!(end.receive(), Some(size), "an answer");
        trips.push(begin.elapsed().as_nanos() as f64 / 1e3);
    }
    end.send(b"next");
    median(&trips[TRIPS / 10..])
}

fn publish(transport: &str, port: u16) {
    let mut lcm = Lcm::new(&url(transport, port)).unwrap();
    let begin = Instant::now();
    let mut payload = [0; 64];
    let mut count: u64 = 0;
    while begin.elapsed() < FLOOD {
        for _ in 0..64 {
            payload[..8].copy_from_slice(&count.to_ne_bytes());
            count += u64::from(lcm.publish("FLOOD", &payload).is_ok());
        }
    }
}

/// Messages received a second, and which part was lost before the last one.
fn flood(transport: &str, port: u16) -> [f64; 2] {
    let mut lcm = Lcm::new(&url(transport, port)).unwrap();
    lcm.subscribe("FLOOD").unwrap();
    let mut peer = Peer::start("publish", transport, port);
    let (mut received, mut last) = (0_u64, 0);
    let mut begin = None;
    let mut end = Instant::now();
    while let Some(message) = lcm.recv_timeout(if begin.is_some() { FLOOD } else { PATIENCE }).unwrap() {
        received += 1;
        last = u64::from_ne_bytes(*message.payload.first_chunk().unwrap());
        if received % 64 == 1 {
            end = Instant::now();
            begin.get_or_insert(end);
        }
    }
    peer.0.wait().unwrap();
    let time = end.duration_since(begin.unwrap()).as_secs_f64();
    [received as f64 / time, 1.0 - received as f64 / (last + 1) as f64]
}
