//! SDO over UDP: our client and python-canopen's, in turn, with one server of ours.

use crate::bus::{Bus, PATIENCE, Script};
use crate::store::Store;
use crate::{line, median};
use base::Duration;
use base::can::Frame;
use canopen::sdo::Client;
use canopen::wire::Service;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Barrier};
use std::thread;

const NODE: u8 = 1;
const ROUNDS: usize = 5;
/// Same values as in `client.py`.
const EXPEDITED: u32 = 1000;
const SEGMENTED: usize = 3500;
const BLOCK: usize = 70_000;
const TESTS: [&str; 6] = [
    "expedited download, 4 bytes, /s",
    "expedited upload, 4 bytes, /s",
    "segmented download, 3500 bytes, kB/s",
    "segmented upload, 3500 bytes, kB/s",
    "block download, 70 000 bytes, kB/s",
    "block upload, 70 000 bytes, kB/s",
];

/// Each client has a separate bus and server: otherwise python-canopen would still process the traffic of ours.
pub fn report() {
    println!("\nSDO over UDP with one kind of server, ours, median of {ROUNDS} rounds in turn");
    let mut buses = [Bus::new(), Bus::new()];
    let (over, open) = (Arc::new(AtomicBool::new(false)), Arc::new(Barrier::new(3)));
    let servers = buses.each_ref().map(|bus| {
        let (port, over, open) = (bus.port, over.clone(), open.clone());
        thread::spawn(move || serve(port, &open, &over))
    });
    open.wait();
    let [ours, theirs] = &mut buses;
    if let Some(mut script) = Script::start("benches/canopen/client.py", theirs, &[]) {
        compare(ours, theirs, &mut script);
    }
    over.store(true, Relaxed);
    for server in servers {
        server.join().expect("the server ends in good order");
    }
}

fn compare(our_bus: &mut Bus, their_bus: &mut Bus, script: &mut Script) {
    let mut rounds = [vec![], vec![]];
    for _ in 0..ROUNDS {
        rounds[0].push(ours(our_bus));
        script.say("go");
        rounds[1].push(theirs(their_bus, script));
    }
    for (at, test) in TESTS.into_iter().enumerate() {
        let of = |who: usize| median(rounds[who].iter().map(|figures: &Vec<f64>| figures[at]).collect());
        let (ours, theirs) = (of(0), of(1));
        line(test, &format!("{ours:.0}"), &format!("{:.1} x python-canopen's {theirs:.0}", ours / theirs));
    }
}

fn serve(port: u16, open: &Barrier, over: &AtomicBool) {
    let mut bus = Bus::on(port);
    open.wait();
    let mut store = Store::new(NODE);
    while !over.load(Relaxed) {
        bus.wait(store.poll_timeout());
        while let Some(frame) = bus.receive() {
            store.handle_rx(bus.now(), &frame);
            while let Some(frame) = store.poll_tx() {
                bus.send(frame);
            }
        }
        store.handle_timeout(bus.now());
    }
}

/// Results of `client.py`, six figures in a line.
fn theirs(bus: &mut Bus, script: &mut Script) -> Vec<f64> {
    let begin = bus.now();
    loop {
        if let Some(line) = script.heard() {
            return line.split(' ').map(|figure| figure.parse().expect("a figure")).collect();
        }
        assert!(!script.is_over() && bus.now().since(begin) < PATIENCE, "the script goes on");
        bus.wait(None);
        while bus.receive().is_some() {}
    }
}

fn ours(bus: &mut Bus) -> Vec<f64> {
    while bus.receive().is_some() {}
    let data = |length: usize| -> Vec<u8> { (0..length).map(|n| (n * n / 7 + 31 * n) as u8).collect() };
    let (short, long) = (data(SEGMENTED), data(BLOCK));
    let mut client = Client::new(Duration::from_secs(1));
    let mut took = |ask: &dyn Fn(&mut Client, base::Instant) -> bool| transfer(bus, &mut client, ask);
    let mut rates = Vec::new();
    let value = [1, 2, 3, 4];
    for write in [true, false] {
        let all: Duration = (0..EXPEDITED)
            .map(|_| match write {
                true => took(&|client, now| client.write(now, 0x2000, 2, value[..].into())),
                false => took(&|client, now| client.read(now, 0x2000, 2)),
            })
            .sum();
        rates.push(f64::from(EXPEDITED) / all.as_secs_f64());
    }
    let segmented = [
        took(&|client, now| client.write(now, 0x2000, 1, short[..].into())),
        took(&|client, now| client.read(now, 0x2000, 1)),
    ];
    let block = [
        took(&|client, now| client.write_block(now, 0x2000, 0, long[..].into())),
        took(&|client, now| client.read_block(now, 0x2000, 0)),
    ];
    rates.extend(segmented.map(|took| SEGMENTED as f64 / took.as_secs_f64() / 1e3));
    rates.extend(block.map(|took| BLOCK as f64 / took.as_secs_f64() / 1e3));
    rates
}

/// One transfer, from the request to its end.
fn transfer(bus: &mut Bus, client: &mut Client, ask: &dyn Fn(&mut Client, base::Instant) -> bool) -> Duration {
    let begin = bus.now();
    assert!(ask(client, begin), "the client is idle");
    loop {
        while let Some(data) = client.poll_tx() {
            bus.send(Frame::standard(Service::SdoRequest { node: NODE }.cob_id(), &data));
        }
        if let Some(done) = client.poll_done() {
            done.result.expect("it succeeds");
            return bus.now().since(begin);
        }
        bus.wait(client.poll_timeout());
        while let Some(frame) = bus.receive() {
            if Service::of(&frame) == Some(Service::SdoResponse { node: NODE }) {
                client.handle_rx(bus.now(), frame.data());
            }
        }
        client.handle_timeout(bus.now());
    }
}
