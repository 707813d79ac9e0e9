//! CANopen: `cargo bench -p advee --bench canopen`.
//!
//! 1. SDO in virtual wire time at 1 Mbit/s, our master and our server without device time, compared with the bound: the
//!    wire time of the frames that the protocol needs for the transfer, computed here from CiA 301, one after another
//!    (a peer without latency). Goal: 95 %.
//! 2. CPU time per frame in the engines, and allocations. Goals: 1 us, no allocation.
//! 3. A full bus in real time: 8700 PDOs/s over UDP into a master in a live host; CPU time of that host's thread:
//!    poller, socket, msgpack, module, engine. Goal: 10 % of a core.
//! 4. SDO over UDP to a server of ours, by our client and by python-canopen's in turn. The ratio is reported.
//!
//! `-- wire engine load peer` selects parts.

#[path = "canopen/engine.rs"]
mod engine;
#[path = "canopen/load.rs"]
mod load;
#[path = "canopen/peer.rs"]
mod peer;
#[path = "../advee/tests/it/canopen_peers/store.rs"]
mod store;
#[path = "sys.rs"]
mod sys;
#[path = "canopen/wire.rs"]
mod wire;

#[path = "../advee/tests/it/canopen_peers/bus.rs"]
mod bus;
#[path = "../advee/tests/support.rs"]
mod support;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

const PARTS: [(&str, fn()); 4] =
    [("wire", wire::report), ("engine", engine::report), ("load", load::report), ("peer", peer::report)];

fn main() {
    // Cargo adds an argument: `--bench`.
    let chosen: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    for (name, report) in PARTS {
        if chosen.is_empty() || chosen.iter().any(|part| part == name) {
            report();
        }
    }
}

/// Prints a line of the tables: name, figure, goal.
fn line(what: &str, figure: &str, goal: &str) {
    println!("{what:58} {figure:>22}  {goal}");
}

/// Median.
fn median(mut figures: Vec<f64>) -> f64 {
    figures.sort_by(f64::total_cmp);
    figures[figures.len() / 2]
}
