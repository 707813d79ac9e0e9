//! Full bus in real time, into a live host.

use crate::bus::Bus;
use crate::engine::{FULL, NODES, drive, master};
use crate::line;
use crate::support::can_port;
use crate::sys::cpu_ns;
use base::{Duration, Instant};
use canopen::master::{Event as Happened, Master};
use host::ports::PortConfig;
use host::{HostConfig, run};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, Shell, ShellConfig, State};
use nix::sys::signal::{Signal, raise};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread;

const LASTS: Duration = Duration::from_secs(4);
const BIT_RATE: u32 = 1_000_000;

/// Values since all nodes run: CPU time, PDOs, instant.
#[derive(Clone, Copy, Default)]
struct Seen {
    cpu: u64,
    pdos: u64,
    at: Instant,
}

/// Module with a master and no application.
struct Ear {
    ports: [PortSpec; 1],
    master: Master,
    running: u8,
    pdos: u64,
    first: Option<Seen>,
    last: Arc<Mutex<(Seen, Seen)>>,
}

impl Ear {
    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.master.poll_event() {
            match event {
                Happened::Booted { .. } => self.running += 1,
                Happened::Pdo { .. } => self.pdos += 1,
                Happened::Lost { node, reason } => panic!("node {node} is lost: {reason}"),
                _ => {}
            }
        }
        while let Some(frame) = self.master.poll_tx() {
            out.send_can(PortId(0), frame);
        }
        if self.running == NODES && self.first.is_none() {
            self.first = Some(self.seen(now));
        }
    }

    fn seen(&self, now: Instant) -> Seen {
        Seen { cpu: cpu_ns(), pdos: self.pdos, at: now }
    }

    fn end(&self) -> Option<Instant> {
        self.first.map(|first| first.at + LASTS)
    }
}

impl Module for Ear {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => out.working(),
            Event::Port { input: Input::Can { frame, .. }, .. } => self.master.handle_rx(now, &frame),
            Event::Timer => self.master.handle_timeout(now),
            _ => {}
        }
        self.drain(now, out);
        if let Some(first) = self.first
            && self.end().is_some_and(|end| end <= now)
        {
            *self.last.lock().expect("no panic") = (first, self.seen(now));
            // To this thread, in which the host runs.
            raise(Signal::SIGTERM).expect("a signal");
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        [self.master.poll_timeout(), self.end()].into_iter().flatten().min()
    }
}

pub fn report() {
    println!("\na full bus over UDP into a live host, {FULL} PDOs of 6 bytes a second from {NODES} nodes");
    let port = can_port();
    let over = Arc::new(AtomicBool::new(false));
    let talkers = {
        let over = over.clone();
        thread::spawn(move || talk(port, &over))
    };
    let last = Arc::new(Mutex::new((Seen::default(), Seen::default())));
    let ear = Ear {
        ports: [PortSpec { bus: "can.main".into(), line: Line::Can { bitrate: BIT_RATE } }],
        master: master(),
        running: 0,
        pdos: 0,
        first: None,
        last: last.clone(),
    };
    let mut config = ShellConfig::new("ear");
    config.wanted = State::Run;
    let group = SocketAddrV4::new(Ipv4Addr::new(239, 74, 163, 2), port);
    let lcm_url = format!("udpm://239.255.76.67:{port}?ttl=0");
    let place = HostConfig {
        lcm_url,
        ports: vec![PortConfig::CanUdp { bus: group }],
        raw: Vec::new(),
        policy: module::admission::Policy::default(),
        launch: None,
        beats: None,
        inputs: None,
    };
    run(Shell::new(config, Box::new(ear)), place).expect("a host");
    over.store(true, Relaxed);
    talkers.join().expect("the nodes end in good order");
    let (first, last) = *last.lock().expect("no panic");
    let (wall, pdos) = (last.at.since(first.at), last.pdos - first.pdos);
    let rate = pdos as f64 / wall.as_secs_f64();
    let cpu = (last.cpu - first.cpu) as f64;
    line("frames a second that the master took", &format!("{rate:.0}"), &format!("{FULL}"));
    let share = 100.0 * cpu / wall.as_nanos() as f64;
    line("its thread, of a core", &format!("{share:.1} %"), "≤ 10 %");
    line("of that, a frame", &format!("{:.2} us", cpu / pdos as f64 / 1e3), "");
}

/// Nodes that send PDOs at the rate of a full bus, one millisecond's worth at a time.
fn talk(port: u16, over: &AtomicBool) {
    let mut bus = Bus::on(port);
    let mut nodes: Vec<_> = (1..=NODES).map(drive).collect();
    nodes.iter_mut().for_each(|node| node.power_on(bus.now()));
    let mut count = 0u32;
    let begin = bus.now();
    while !over.load(Relaxed) {
        while let Some(frame) = bus.receive() {
            nodes.iter_mut().for_each(|node| node.handle_rx(bus.now(), &frame));
        }
        let due = (bus.now().since(begin).as_nanos() as u64 * u64::from(FULL) / 1_000_000_000) as u32;
        for n in count..due {
            nodes[n as usize % usize::from(NODES)].set(0x606C, 0, i64::from(n));
            nodes[n as usize % usize::from(NODES)].handle_timeout(bus.now());
        }
        count = due;
        for node in &mut nodes {
            node.handle_timeout(bus.now());
            while let Some(frame) = node.poll_tx() {
                bus.send(frame);
            }
            while node.poll_event().is_some() {}
        }
        thread::sleep(Duration::from_millis(1));
    }
}
