//! Skips of tests whose peer or machine feature is missing.

use std::fs::OpenOptions;
use std::io::Write;
use std::thread;

/// Requirement of a test, or one line on what is missing.
pub type Found<T> = Result<T, String>;

/// Requires a peer that a package registry has.
///
/// Returns `None` if it is missing and `ADVEE_PEERS` is not `required`; the test then returns.
///
/// # Panics
/// If it is missing and `ADVEE_PEERS=required`.
#[track_caller]
pub fn peer_or_skip<T>(found: Found<T>) -> Option<T> {
    let required = std::env::var_os("ADVEE_PEERS").is_some_and(|value| value == "required");
    peer(found, required)
}

/// Requires a feature of this machine that no package provides: a device, a kernel feature, a privilege.
///
/// Returns `None` if it is missing; the test, or the part that needs it, then returns.
#[track_caller]
pub fn machine_or_skip<T>(found: Found<T>) -> Option<T> {
    found.map_err(|why| skip("machine", &why)).ok()
}

#[track_caller]
fn peer<T>(found: Found<T>, required: bool) -> Option<T> {
    match found {
        Ok(found) => Some(found),
        Err(why) if required => panic!("a peer is missing: {why}"),
        Err(why) => {
            skip("peer", &why);
            None
        }
    }
}

/// Reports the skip on standard error, past the capture of passing tests, and appends it to the file of `make test`.
fn skip(kind: &str, why: &str) {
    let thread = thread::current();
    let test = thread.name().unwrap_or("a test");
    // One write each: other tests print and append at the same time.
    let _ = std::io::stderr().write_all(format!("skipped: {test}: {why}\n").as_bytes());
    if let Some(path) = std::env::var_os("ADVEE_SKIPPED") {
        let file = OpenOptions::new().create(true).append(true).open(path);
        let line = format!("{kind}\t{test}\t{}\n", why.replace(['\n', '\t'], " "));
        file.and_then(|mut file| file.write_all(line.as_bytes())).expect("the file named by ADVEE_SKIPPED is writable");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_present_peer_is_returned() {
        assert_eq!((peer(Ok(1), true), peer(Ok(2), false), machine_or_skip(Ok(3))), (Some(1), Some(2), Some(3)));
    }

    #[test]
    #[should_panic(expected = "a peer is missing: no python-can")]
    fn a_missing_peer_fails_where_peers_are_required() {
        peer::<()>(Err("no python-can".into()), true);
    }

    #[test]
    fn a_skip_is_appended_to_the_file_with_kind_test_and_reason() {
        let file = std::env::temp_dir().join(format!("advee-skipped-{}", std::process::id()));
        let this = std::env::current_exe().expect("a running program");
        let mut again = std::process::Command::new(this);
        again.args(["--exact", "skip::tests::skips_what_no_machine_has"]).env("ADVEE_SKIPPED", &file);
        assert!(again.output().expect("this program").status.success());
        let text = std::fs::read_to_string(&file).expect("it is written");
        std::fs::remove_file(file).expect("it is there");
        assert_eq!(text, "machine\tskip::tests::skips_what_no_machine_has\tno  perpetual motion\n");
    }

    /// Run by the test above in a separate process.
    #[test]
    fn skips_what_no_machine_has() {
        if std::env::var_os("ADVEE_SKIPPED").is_some_and(|path| path.to_string_lossy().contains("advee-skipped-")) {
            assert_eq!(machine_or_skip::<()>(Err("no \tperpetual motion".into())), None);
        }
    }
}
