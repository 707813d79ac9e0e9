//! Performance of the LCM, compared with plain multicast sockets and the official library: `cargo bench -p lcm --bench
//! lcm`.
//!
//! Options: `--rounds N` (5), `--only TEST,…`, `--transports NAME,…`, `--quick` (short measurements, to try it),
//! `--loaded` (does not wait for a quiet machine), `--json` instead of the table. Names: `lcm/report.rs`.
//!
//! Each measurement has separate processes, on a separate loopback interface: in a network namespace if the machine
//! permits. In a round all transports take their turn at each test, in random order; figures are medians over the
//! rounds. The independent peers need `.venv`, created by `tools/venv`, and a C compiler.
#![allow(clippy::disallowed_methods, reason = "a bench has processes, files and a clock")]

#[path = "lcm/peer.rs"]
mod peer;
#[path = "lcm/report.rs"]
mod report;
#[path = "lcm/run.rs"]
mod run;

use report::{Row, TRANSPORTS};
use run::{Bench, Test};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// First argument of the process within the namespace; the second names the network.
const WITHIN: &str = "within";

struct Options {
    rounds: usize,
    only: Option<Vec<String>>,
    transports: Option<Vec<String>>,
    quick: bool,
    loaded: bool,
    json: bool,
}

fn main() {
    let arguments: Vec<String> = env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        Some("peer") => peer::main(&arguments[1..]),
        Some(WITHIN) => measure(&options(&arguments[2..]), &arguments[1]),
        _ => {
            options(&arguments);
            enter(&arguments);
        }
    }
}

fn options(arguments: &[String]) -> Options {
    let mut options = Options { rounds: 5, only: None, transports: None, quick: false, loaded: false, json: false };
    let mut rest = arguments.iter();
    let list = |text: Option<&String>| text.map(|text| text.split(',').map(String::from).collect());
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--rounds" => options.rounds = rest.next().and_then(|text| text.parse().ok()).expect("--rounds N"),
            "--only" => options.only = list(rest.next()),
            "--transports" => options.transports = list(rest.next()),
            "--quick" => options.quick = true,
            "--loaded" => options.loaded = true,
            "--json" => options.json = true,
            "--bench" => {} // cargo
            _ => panic!("what is {argument}? See the head of benches/lcm.rs"),
        }
    }
    options
}

/// Continues within a network namespace with a loopback interface that routes multicast, or else in place.
fn enter(arguments: &[String]) {
    let me = env::current_exe().expect("my own path");
    let script = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec \"$0\" \"$@\"";
    // As root the receive buffers can have any size; as root of a user namespace they cannot.
    for flags in [&["--net"][..], &["--net", "--map-root-user"]] {
        let unshare = |words: &[&str]| {
            let mut command = Command::new("unshare");
            command.args(flags).args(["sh", "-c", script]).args(words);
            command
        };
        if unshare(&["true"]).output().is_ok_and(|output| output.status.success()) {
            let mut command = unshare(&[]);
            let error =
                command.arg(me).args([WITHIN, "a network namespace with a loopback alone"]).args(arguments).exec();
            panic!("unshare: {error}");
        }
    }
    let error = Command::new(me)
        .args([WITHIN, "the machine's own network (a namespace needs the right, and ip)"])
        .args(arguments)
        .exec();
    panic!("{error}");
}

fn measure(options: &Options, network: &str) {
    let mut bench = Bench::new(build_c_peer(), options.quick, options.loaded);
    let wanted =
        |list: &Option<Vec<String>>, name: &str| list.as_ref().is_none_or(|list| list.iter().any(|word| word == name));
    let mut rows: Vec<Row> = Vec::new();
    let mut random = Random(0x9e37_79b9);
    for round in 0..options.rounds {
        for test in report::tests().into_iter().filter(|test| wanted(&options.only, &test.name())) {
            let mut transports: Vec<_> = TRANSPORTS.into_iter().map(|(name, _)| name).collect();
            transports.retain(|name| wanted(&options.transports, name) && applies(test, name, round));
            random.shuffle(&mut transports);
            for transport in transports {
                match bench.measure(transport, test) {
                    Ok((figures, foreign)) => {
                        eprintln!(
                            "{round} {:10} {transport:10} {figures:.1?} foreign {:.0} %",
                            test.name(),
                            foreign * 100.0
                        );
                        rows.push(Row { round, test, transport, figures, foreign });
                    }
                    Err(error) => eprintln!("{round} {:10} {transport:10} not measured: {error}", test.name()),
                }
            }
        }
    }
    let machine = machine(network, bench.granted.get());
    println!("{}", if options.json { report::json(&rows, &machine) } else { report::markdown(&rows, &machine) });
}

/// True if the test applies. Plain sockets have no channels, so no subscriber is uninterested; tests that take long or
/// vary little are measured in fewer rounds.
fn applies(test: Test, transport: &str, round: usize) -> bool {
    let has_one = match test {
        Test::Crowd => transport != "raw",
        Test::Top => round < 3,
        Test::Idle => round == 0,
        _ => true,
    };
    has_one && (cfg!(feature = "shm") || !transport.starts_with("shm"))
}

/// xorshift; only the order of measurements depends on it.
struct Random(u32);

impl Random {
    fn shuffle<T>(&mut self, items: &mut [T]) {
        for end in (1..items.len()).rev() {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 17;
            self.0 ^= self.0 << 5;
            items.swap(end, self.0 as usize % (end + 1));
        }
    }
}

/// Compiles the peer for sockets and the official library, which is taken from the Python package.
fn build_c_peer() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let packages = fs::read_dir(root.join(".venv/lib")).into_iter().flatten().flatten();
    let package =
        packages.map(|entry| entry.path().join("site-packages")).find(|path| path.join("include/lcm/lcm.h").exists());
    let package = package.expect("the official LCM in .venv: run tools/venv");
    let peer = Path::new(env!("CARGO_TARGET_TMPDIR")).join("lcm-bench-peer");
    let library = package.join("lib");
    let mut cc = Command::new("cc");
    cc.args(["-O2", "-Wall", "-o"]).arg(&peer).arg(root.join("benches/peers/peer.c"));
    cc.arg("-I").arg(package.join("include")).arg(library.join("liblcm.so")).arg("-l:libglib-2.0.so.0");
    cc.arg(format!("-Wl,-rpath,{}", library.display()));
    assert!(cc.status().expect("a C compiler").success(), "benches/peers/peer.c does not compile");
    peer
}

/// Description of the machine in one line.
fn machine(network: &str, granted: Option<usize>) -> String {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let cpu = read("/proc/cpuinfo");
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("?");
    let cpus = cpu.lines().filter(|line| line.starts_with("processor")).count();
    let buffers = granted.map_or("as asked for".into(), |granted| format!("at most {} KiB: `rmem_max`", granted >> 10));
    format!(
        "{cpus} CPUs {}, Linux {}, {network}; receive buffers {buffers}.",
        model.trim_start_matches(['\t', ' ', ':']),
        read("/proc/sys/kernel/osrelease").trim()
    )
}
