//! Modules that serve sockets in real time beside a robot in virtual time: processes of their own on the LCM bus.

use base::{Duration, Instant};
use host::log::Log;
use host::{clock, notify, processes, sys};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use robot::config::Config;
use robot::place::RobotLocation;
use robot::recording;
use std::process::{Child, Command, Stdio};
use std::thread;

/// Modules of this kind.
const SERVING: [&str; 2] = [web::NAME, "ros2"];
/// Real time from the end of one to its next start.
const AGAIN: Duration = Duration::from_secs(1);
/// Real time for one to end, before it is killed.
const END: Duration = Duration::from_secs(3);
const LOOK: Duration = Duration::from_millis(10);

/// A module of this kind.
struct Companion {
    module: &'static str,
    child: Option<Child>,
    /// Real time of its next start.
    start: Instant,
}

/// Those that the configuration has.
pub struct Companions(Vec<Companion>);

impl Companions {
    /// Those of a robot; the first call of [`Companions::watch`] starts them.
    pub fn new(config: &Config) -> Self {
        let has = |module: &&str| config.modules.iter().any(|entry| entry.name() == *module);
        let companion = |module| Companion { module, child: None, start: Instant::ZERO };
        Self(SERVING.into_iter().filter(has).map(companion).collect())
    }

    /// True if the web server is among them.
    pub fn serve(&self) -> bool {
        self.0.iter().any(|companion| companion.module == web::NAME)
    }

    /// Starts those that are to be started, again after an end that nobody asked for.
    pub fn watch(&mut self, now: Instant, log: &Log, place: &RobotLocation) {
        for companion in &mut self.0 {
            let ended = companion.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
            if let Some(status) = ended {
                log.line(format_args!("{} ended with {status}: it is started again", companion.module));
                (companion.child, companion.start) = (None, now + AGAIN);
            }
            if companion.child.is_none() && companion.start <= now {
                match command(companion.module, place).and_then(|mut command| command.spawn()) {
                    Ok(child) => companion.child = Some(child),
                    Err(error) => {
                        log.line(format_args!("{} cannot be started: {error}", companion.module));
                        companion.start = now + AGAIN;
                    }
                }
            }
        }
    }

    /// The real time of the next start.
    pub fn poll_timeout(&self) -> Instant {
        let waiting = self.0.iter().filter(|companion| companion.child.is_none());
        waiting.map(|companion| companion.start).min().unwrap_or(Instant::NEVER)
    }

    /// Ends them; they are started again at once.
    pub fn restart(&mut self, now: Instant) {
        self.end();
        for companion in &mut self.0 {
            companion.start = now;
        }
    }

    /// Ends them, in good order if they can.
    pub fn end(&mut self) {
        for child in self.0.iter().filter_map(|companion| companion.child.as_ref()) {
            let _ = kill(Pid::from_raw(child.id() as i32), Signal::SIGTERM);
        }
        let until = clock::now() + END;
        for mut child in self.0.iter_mut().filter_map(|companion| companion.child.take()) {
            while matches!(child.try_wait(), Ok(None)) && clock::now() < until {
                thread::sleep(LOOK);
            }
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn command(module: &str, place: &RobotLocation) -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["run", module]).args(place.arguments()).stdin(Stdio::null());
    // No watchdog started it.
    for variable in ["NOTIFY_SOCKET", "WATCHDOG_PID", "WATCHDOG_USEC", notify::VARIABLE, processes::VARIABLE] {
        command.env_remove(variable);
    }
    command.env_remove(recording::VARIABLE);
    sys::die_with_parent(&mut command);
    Ok(command)
}
