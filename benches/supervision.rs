//! Cost of supervising ten idle modules: `cargo bench --bench supervision`.
//!
//! `advee up`, the watchdog, and ten processes of the live host whose module does nothing: they send heartbeats,
//! announce themselves and receive the watchdog's messages. All their processor time is supervision. Goal: 0.5 % of a
//! core.

#[path = "../advee/tests/support.rs"]
mod support;

use base::Instant;
use host::{self, HostConfig};
use module::{Actions, Event, Module, Shell, ShellConfig};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{ExitCode, Stdio};

const MODULES: usize = 10;
const SECONDS: f64 = 30.0;

/// Module that does nothing.
struct Idle;

impl Module for Idle {
    fn handle(&mut self, _now: Instant, event: Event<'_>, out: &mut Actions) {
        if let Event::Start = event {
            out.working();
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().collect();
    if let [_, word, name] = &args[..]
        && word == "module"
    {
        let lcm_url = std::env::var("LCM_DEFAULT_URL").unwrap_or_default();
        let config = HostConfig {
            lcm_url,
            ports: Vec::new(),
            raw: Vec::new(),
            policy: module::admission::Policy::default(),
            launch: None,
            beats: None,
            inputs: None,
        };
        return ExitCode::from(host::run(Shell::new(ShellConfig::new(name), Box::new(Idle)), config).unwrap_or(1));
    }
    let folder = std::env::temp_dir().join(format!("advee-bench-{}", std::process::id()));
    configure(&folder.join("conf"));
    let url = format!("udpm://239.255.76.67:{}?ttl=0&shm=auto", support::can_port());
    let mut up = support::advee(&url, &folder.join("run"))
        .args(["up", "--headless", "--config"])
        .arg(folder.join("conf"))
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the executable is built");
    sleep(3.0);
    let pids = family(up.id());
    assert_eq!(pids.len(), 2 + MODULES, "the parent, the watchdog and ten modules");
    let before: Vec<f64> = pids.iter().map(|pid| cpu_s(*pid)).collect();
    sleep(SECONDS);
    let used: Vec<f64> =
        pids.iter().zip(before).map(|(pid, before)| (cpu_s(*pid) - before) / SECONDS * 100.0).collect();
    println!(
        "{MODULES} idle modules guarded: {:.2} % of a core over {SECONDS} s (advee up {:.2}, watchdog {:.2}, all \
         modules {:.2})",
        used.iter().sum::<f64>(),
        used[0],
        used[1],
        used[2..].iter().sum::<f64>()
    );
    support::signal(up.id() as i32, "TERM");
    let ended = up.wait().expect("it is our child");
    let _ = fs::remove_dir_all(&folder);
    ExitCode::from(u8::from(!ended.success()))
}

fn sleep(seconds: f64) {
    std::thread::sleep(std::time::Duration::from_secs_f64(seconds));
}

/// Robot of the checkout with ten modules that are this executable.
fn configure(folder: &Path) {
    fs::create_dir_all(folder).expect("a folder");
    let shipped = support::workspace().join("conf/advee/robot.toml");
    fs::copy(shipped, folder.join("robot.toml")).expect("a copy");
    let own: PathBuf = std::env::current_exe().expect("it has a name");
    let module = |n| format!("[[modules]]\nname = \"idle{n}\"\ncommand = {own:?}\nargs = [\"module\", \"idle{n}\"]\n");
    fs::write(folder.join("modules.toml"), (0..MODULES).map(module).collect::<String>()).expect("a file");
}

/// Process, the watchdog below it, and the modules, which are children of either.
fn family(up: u32) -> Vec<u32> {
    let children = |parent| host::processes::children(parent);
    let (watchdog, adopted): (Vec<u32>, Vec<u32>) = children(up).into_iter().partition(|pid| {
        fs::read(format!("/proc/{pid}/cmdline")).is_ok_and(|line| String::from_utf8_lossy(&line).contains("watchdog"))
    });
    let own = watchdog.iter().flat_map(|pid| children(*pid)).collect();
    [vec![up], watchdog, adopted, own].concat()
}

/// Processor time, s (proc(5), schedstat).
fn cpu_s(pid: u32) -> f64 {
    let text = fs::read_to_string(format!("/proc/{pid}/schedstat")).unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) / 1e9
}
