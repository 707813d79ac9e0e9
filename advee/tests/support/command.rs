//! Outcome of a completed command.

use serde_json::Value;
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Exit code and output of a command.
#[derive(Debug)]
pub struct Outcome {
    /// Exit code; `None` if a signal ended it.
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Outcome {
    pub fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).expect("output is text");
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    /// Runs a command to its end; one that takes longer than `patience` is killed, and fails the test.
    #[track_caller]
    pub fn within(command: &mut Command, patience: Duration) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().expect("the executable is built");
        let (pid, (ended, end)) = (child.id(), mpsc::channel());
        std::thread::spawn(move || ended.send(child.wait_with_output()));
        match end.recv_timeout(patience) {
            Ok(output) => Self::of(output.expect("it is our child")),
            Err(_) => {
                crate::support::signal(pid as i32, "KILL");
                panic!("not ended within {patience:?}: {command:?}");
            }
        }
    }

    /// Standard output of a command that succeeded without output on standard error.
    #[track_caller]
    pub fn good(self) -> String {
        assert_eq!((self.code, self.err.as_str()), (Some(0), ""), "{}", self.out);
        self.out
    }

    /// Standard output of a successful command, one JSON value per line.
    #[track_caller]
    pub fn values(self) -> Vec<Value> {
        values(&self.good())
    }

    /// Single line on standard error of a failed command.
    #[track_caller]
    pub fn bad(self) -> String {
        assert!(self.code.is_some_and(|code| code != 0), "{self:?}");
        assert_eq!(self.err.lines().count(), 1, "{}", self.err);
        self.err.trim_end().into()
    }

    /// Single line on standard error of a failed command without output on standard output.
    #[track_caller]
    pub fn refused(self) -> String {
        assert_eq!(self.out, "");
        self.bad()
    }
}

/// Parses lines of JSON.
#[track_caller]
pub fn values(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}
