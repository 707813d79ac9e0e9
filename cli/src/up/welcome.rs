//! What a person at the terminal of `advee up` is shown when the robot is up, and when it has ended. Nothing is shown
//! where standard error is no terminal: there it is a log, and codes belong into none.

use crate::qr;
use host::log::Log;
use host::runs;
use std::fs;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant, SystemTime};
use web::center::session_store::{ShownCodes, ask, spaced};

/// Time for the lines of modules that start to come first.
const SETTLED: Duration = Duration::from_millis(300);
/// Time limit for a web server to be there.
const SERVED: Duration = Duration::from_secs(3);
const LOOK: Duration = Duration::from_millis(100);

/// Shows the card beside everything else: a web server that answers late delays nothing.
pub fn greet(run_dir: PathBuf, serves: bool) {
    if !std::io::stderr().is_terminal() {
        return;
    }
    thread::spawn(move || {
        thread::sleep(SETTLED);
        let begun = Instant::now();
        let mut servers = Vec::new();
        while serves && servers.is_empty() && begun.elapsed() < SERVED {
            thread::sleep(LOOK);
            servers = ask(&run_dir).unwrap_or_default();
        }
        // A failure cannot be reported.
        let _ = std::io::stderr().write_all(card(servers.first(), serves).as_bytes());
    });
}

/// One write, so that lines of other processes do not mix with it.
fn card(server: Option<&ShownCodes>, serves: bool) -> String {
    let mut rows = vec![("The robot is up.", String::new())];
    if server.is_none() && serves {
        rows.push(("web page", "not there yet; its address and codes: advee web code".into()));
    }
    if let Some(server) = server {
        let (operator, engineer) = (spaced(&server.operator), spaced(&server.engineer));
        let minutes = server.valid_s.div_ceil(60);
        rows.extend([
            ("web page", format!("http://{}/", server.address)),
            ("operator code", operator),
            ("engineer code", format!("{engineer}   or the link {}", server.link(&server.engineer))),
            ("", format!("each pairs one device within {minutes} minutes; later: advee web code")),
        ]);
    }
    rows.extend([
        ("in a terminal", "advee diag; advee help has the other commands".into()),
        ("Ctrl-C", "ends it".into()),
    ]);
    let lines: Vec<String> = rows.iter().map(|(name, text)| format!(" {name:<14} {text}").trim_end().into()).collect();
    let width = lines.iter().map(|line| line.chars().count()).max().unwrap_or_default() + 1;
    let rule = "\u{2500}".repeat(width);
    let picture = server.filter(|server| server.is_reachable()).map(|server| {
        let head = " The operator's link for a phone:".to_owned();
        [vec![head], qr::lines(&server.link(&server.operator), true)].concat().join("\n") + "\n"
    });
    format!("{rule}\n{}\n{rule}\n{}", lines.join("\n"), picture.unwrap_or_default())
}

/// Says where the run is kept that was recorded since then.
pub fn farewell(log: &Log, logs: &Path, since: SystemTime) {
    if std::io::stderr().is_terminal() {
        match newest(logs, since) {
            Some(run) => log.line(format_args!("ended; the run is kept: advee plot {}", run.display())),
            None => log.line("ended"),
        }
    }
}

/// The newest run with a log that was written since then.
fn newest(logs: &Path, since: SystemTime) -> Option<PathBuf> {
    let runs = fs::read_dir(logs).ok()?.flatten().map(|entry| entry.path());
    let written = |run: &PathBuf| {
        let files = runs::log_files(run).into_iter();
        files.filter_map(|file| fs::metadata(file).ok()?.modified().ok()).max().filter(|at| *at >= since)
    };
    let mut found: Vec<_> = runs.filter(|run| run.is_dir()).filter_map(|run| Some((written(&run)?, run))).collect();
    found.sort();
    found.pop().map(|(_, run)| run)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_card_has_address_codes_and_link_within_one_frame() {
        let server = ShownCodes {
            address: "127.0.0.1:8080".into(),
            operator: "12345678".into(),
            engineer: "87654321".into(),
            valid_s: 599,
        };
        let card = card(Some(&server), true);
        for told in ["http://127.0.0.1:8080/\n", "1234 5678", "http://127.0.0.1:8080/#87654321", "10 minutes", "Ctrl-C"]
        {
            assert!(card.contains(told), "{told}: {card}");
        }
        let width = card.lines().next().unwrap().chars().count();
        assert!(card.lines().all(|line| line.chars().count() <= width), "{card}");
        assert!(!super::card(None, false).contains("http") && !super::card(None, false).contains("web"));
        assert!(super::card(None, true).contains("advee web code"));
        assert!(!card.contains("for a phone"), "a phone does not reach a loopback address");
        let reachable = ShownCodes { address: "192.168.1.7:8080".into(), ..server };
        let card = super::card(Some(&reachable), true);
        let picture = qr::lines("http://192.168.1.7:8080/#12345678", true).join("\n");
        assert!(card.ends_with(&format!(" The operator's link for a phone:\n{picture}\n")), "{card}");
    }

    #[test]
    fn the_run_that_is_kept_is_the_newest_with_a_log_of_this_time() {
        let folder = std::env::temp_dir().join(format!("advee-welcome-{}", std::process::id()));
        let begun = SystemTime::now() - Duration::from_secs(1);
        for (run, file) in [("one", "log_0.mcap"), ("two", "other")] {
            fs::create_dir_all(folder.join(run)).unwrap();
            fs::write(folder.join(run).join(file), "").unwrap();
        }
        assert_eq!(newest(&folder, begun), Some(folder.join("one")));
        assert_eq!(newest(&folder, SystemTime::now() + Duration::from_secs(60)), None);
        assert_eq!(newest(&folder.join("none"), begun), None);
        fs::remove_dir_all(&folder).unwrap();
    }
}
