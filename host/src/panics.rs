//! What a panic of a module does: one line on stderr, and an exit code of its own.

use super::clock;
use super::log::{OneLine, TimeOfDay};
use super::sys;
use module::exit;
use std::io::Write;
use std::panic::{self, PanicHookInfo};
use std::thread;

/// Variable of the standard library that asks for a backtrace.
const BACKTRACE: &str = "RUST_BACKTRACE";

/// From now on a panic of any thread ends the process with [`exit::PANIC`], after a line in the module's name with its
/// file and line. Nothing else is done: no destructor runs, as with an abort, and the state of the module may be
/// invalid. With `RUST_BACKTRACE` set the standard library prints the backtrace and the process ends by SIGABRT, so
/// that the kernel can keep a core file; where panics unwind (a build for tests) its exit code is the standard
/// library's.
pub fn end_process(module: &str) {
    if std::env::var_os(BACKTRACE).is_some_and(|value| value != "0") {
        return;
    }
    let module = module.to_owned();
    panic::set_hook(Box::new(move |info| {
        let line = line(clock::wall(), &module, thread::current().name(), info);
        let _ = std::io::stderr().write_all(line.as_bytes());
        sys::exit_now(exit::PANIC);
    }));
}

fn line(now: u64, module: &str, thread: Option<&str>, info: &PanicHookInfo<'_>) -> String {
    let place = info.location().map(|at| format!(" at {}:{}", at.file(), at.line())).unwrap_or_default();
    let payload = info.payload();
    let why = payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    let why = why.unwrap_or("no message");
    let thread = thread.unwrap_or("?");
    format!("{} {module} ERROR panic{place} in thread {thread}: {}\n", TimeOfDay(now), OneLine(why))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Set in the process that panics.
    const PANICS: &str = "ADVEE_TEST_PANICS";

    /// Started again by the test below.
    #[test]
    fn a_process_that_panics() {
        if std::env::var_os(PANICS).is_some() {
            end_process("toy");
            panic!("two\nlines");
        }
    }

    #[test]
    fn a_panic_is_one_line_with_its_place_and_has_an_exit_code_of_its_own() {
        let program = std::env::current_exe().unwrap();
        let test = "panics::tests::a_process_that_panics";
        let mut command = Command::new(program);
        command.args(["--exact", test, "--nocapture"]).env(PANICS, "1").env_remove(BACKTRACE);
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(i32::from(exit::PANIC)), "{said}");
        let last = said.lines().last().unwrap();
        let (place, why) = last.split_once(" in thread ").unwrap();
        assert!(place.contains(" toy ERROR panic at ") && place.contains("panics.rs:"), "{said}");
        assert!(why.ends_with(": two lines"), "{said}");
    }
}
