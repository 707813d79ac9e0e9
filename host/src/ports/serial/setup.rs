//! Set-up command of a port, for boards that need a register written to enable EIA-485: run before each opening,
//! without blocking.

use crate::clock;
use crate::ports::Lost;
use crate::sys;
use base::{Duration, Instant};
use std::io::Read;
use std::process::{Child, Command, ExitStatus, Stdio};

/// Timeout of the command.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Delay before a failed command is retried.
const RETRY_DELAY: Duration = Duration::from_secs(5);
/// Maximum length of its error output in the report, bytes.
const ERROR_OUTPUT_MAX: u64 = 200;

/// A command and its progress.
pub struct Setup {
    command: Vec<String>,
    state: State,
}

enum State {
    NotRun,
    Runs { child: Child, until: Instant },
    Done,
    Failed { why: Lost, again: Instant },
}

impl Setup {
    /// Creates a command from a program and its arguments; an empty one succeeds at once.
    pub fn new(command: Vec<String>) -> Self {
        Self { command, state: State::NotRun }
    }

    /// True while it is running.
    pub fn runs(&self) -> bool {
        matches!(self.state, State::Runs { .. })
    }

    /// Requires a new run before the next opening.
    pub fn forget(&mut self) {
        if matches!(self.state, State::Done) {
            self.state = State::NotRun;
        }
    }

    /// Starts the command or checks on it. `Ok` if the port may be opened; to be called again soon while
    /// [`Setup::runs`].
    pub fn proceed(&mut self) -> Result<(), Lost> {
        let now = clock::now();
        if let State::Failed { again, .. } = self.state
            && again <= now
        {
            self.state = State::NotRun;
        }
        if let (State::NotRun, Some((program, arguments))) = (&self.state, self.command.split_first()) {
            self.state = match start(program, arguments) {
                Ok(child) => State::Runs { child, until: now + TIMEOUT },
                Err(error) => self.failed(now, &error.to_string()),
            };
        }
        if let State::Runs { child, until } = &mut self.state {
            let news = match child.try_wait() {
                Ok(None) if now < *until => return Err(format!("set-up command {} is running", self.command[0])),
                Ok(None) => {
                    // Killed and reaped, so that no zombie is left.
                    let _ = child.kill().and_then(|()| child.wait());
                    Err(format!("it took longer than {} s", TIMEOUT.as_secs()))
                }
                Ok(Some(status)) if status.success() => Ok(()),
                Ok(Some(status)) => Err(describe_failure(child, status)),
                Err(error) => Err(error.to_string()),
            };
            self.state = match news {
                Ok(()) => State::Done,
                Err(why) => self.failed(now, &why),
            };
        }
        match &self.state {
            State::Failed { why, .. } => Err(why.clone()),
            _ => Ok(()),
        }
    }

    fn failed(&self, now: Instant, why: &str) -> State {
        State::Failed { why: format!("set-up command {}: {why}", self.command.join(" ")), again: now + RETRY_DELAY }
    }
}

impl Drop for Setup {
    fn drop(&mut self) {
        if let State::Runs { child, .. } = &mut self.state {
            let _ = child.kill().and_then(|()| child.wait());
        }
    }
}

fn start(program: &str, arguments: &[String]) -> std::io::Result<Child> {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    sys::die_with_parent(&mut command);
    command.spawn()
}

/// Exit status and first line of stderr. The command has ended, but its children may hold stderr open: only available
/// data is read.
fn describe_failure(child: &mut Child, status: ExitStatus) -> String {
    let mut said = Vec::new();
    if let Some(stderr) = &mut child.stderr {
        use nix::fcntl::{FcntlArg, OFlag, fcntl};
        if fcntl(&*stderr, FcntlArg::F_SETFL(OFlag::O_NONBLOCK)).is_ok() {
            let _ = stderr.take(ERROR_OUTPUT_MAX).read_to_end(&mut said);
        }
    }
    let said = String::from_utf8_lossy(&said);
    match said.lines().next() {
        Some(line) if !line.is_empty() => format!("{status}: {}", line.escape_debug()),
        _ => status.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(command: &[&str]) -> Result<(), Lost> {
        let mut setup = Setup::new(command.iter().map(ToString::to_string).collect());
        loop {
            let result = setup.proceed();
            if !setup.runs() {
                return result;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    #[test]
    fn a_successful_or_empty_command_permits_opening() {
        assert_eq!(run(&["/bin/true"]), Ok(()));
        assert_eq!(run(&[]), Ok(()));
    }

    #[test]
    fn a_failed_command_is_reported_with_its_error_output() {
        let failed = run(&["/bin/sh", "-c", "echo no such register >&2; exit 3"]).unwrap_err();
        assert!(failed.starts_with("set-up command /bin/sh -c "), "{failed}");
        assert!(failed.ends_with("exit status: 3: no such register"), "{failed}");
        let absent = run(&["/no/such/program"]).unwrap_err();
        assert!(absent.starts_with("set-up command /no/such/program: No such file"), "{absent}");
    }

    #[test]
    fn a_command_runs_once_per_opening_and_is_retried_with_a_delay() {
        let file = std::env::temp_dir().join(format!("advee-setup-{}", std::process::id()));
        let script = format!("echo x >> {}; exit $(wc -l < {} | tr -d ' ')", file.display(), file.display());
        let mut setup = Setup::new(vec!["/bin/sh".into(), "-c".into(), script]);
        for _ in 0..200 {
            assert!(setup.proceed().is_err());
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "x\n");
        let _ = std::fs::remove_file(file);
    }
}
