//! Serial devices on pseudo-terminals: everything except parity.

use super::*;
use crate::clock;
use crate::ports::{Port, PortConfig, PortState};
use crate::sys;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;

fn path(name: &str) -> PathBuf {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let count = NEXT.fetch_add(1, Ordering::Relaxed);
    std::env::temp_dir().join(format!("advee-serial-{name}-{}-{count}", std::process::id()))
}

fn offer(link: &Path) -> Serial {
    let mut side = Serial::pseudo(link.into(), 115_200);
    side.open().unwrap();
    side
}

#[test]
fn a_pseudo_terminal_is_refused_for_parity_by_the_name_of_its_driver() {
    let link = path("parity");
    let _side = offer(&link);
    let config = TerminalConfig { transport: Transport::Parity, ..TerminalConfig::new(link.clone(), 115_200) };
    let refused = Serial::terminal(config).open().unwrap_err();
    assert!(refused.starts_with(&format!("{}: transport \"parity\" needs a real port", link.display())), "{refused}");
    assert!(refused.contains("(pty) drops PARENB") && !refused.contains('\n'), "{refused}");
}

#[test]
fn a_port_without_a_wire_does_not_report_the_end_of_transmission() {
    let side = offer(&path("wire"));
    assert_eq!(sys::line_has_sent(side.file.as_ref().unwrap().as_fd()).unwrap(), None);
    let (no_terminal, _other) = nix::unistd::pipe().unwrap();
    assert!(sys::line_has_sent(no_terminal.as_fd()).is_err());
}

#[test]
fn a_stale_link_is_removed_before_the_first_terminal_is_open() {
    let link = path("left");
    std::os::unix::fs::symlink("/dev/pts/0", &link).unwrap();
    let _side = Serial::pseudo(link.clone(), 115_200);
    assert!(!link.is_symlink());
}

/// A link that is left to a terminal that ended, and one to the next terminal of that number; `None` if another process
/// was given the number.
fn reused() -> Option<(PathBuf, PathBuf, Serial)> {
    let (first, left, next) = (path("first"), path("left"), path("next"));
    let ended = offer(&first);
    let place = std::fs::read_link(&first).unwrap();
    std::os::unix::fs::symlink(&place, &left).unwrap();
    drop(ended);
    // The clock of files has steps of some milliseconds.
    thread::sleep(std::time::Duration::from_millis(20));
    let side = offer(&next);
    (std::fs::read_link(&next).unwrap() == place).then_some((left, next, side))
}

#[test]
fn a_link_that_is_older_than_its_pseudo_terminal_is_not_opened() {
    let (left, next, _side) = (0..100).find_map(|_| reused()).expect("numbers are given away again");
    let refused = Serial::terminal(TerminalConfig::new(left.clone(), 115_200)).open().unwrap_err();
    assert!(refused.contains("leads to a pseudo-terminal that has ended"), "{refused}");
    // What leads to a link is not judged by its age.
    std::fs::remove_file(&left).unwrap();
    std::os::unix::fs::symlink(&next, &left).unwrap();
    for good in [&left, &next] {
        Serial::terminal(TerminalConfig::new(good.clone(), 115_200)).open().unwrap();
    }
    std::fs::remove_file(&left).unwrap();
}

#[test]
fn a_rate_beyond_the_list_of_posix_is_set_exactly() {
    let link = path("rate");
    let side = offer(&link);
    let mut device = Serial::terminal(TerminalConfig::new(link, 250_000));
    device.open().unwrap();
    let settings = sys::line_settings(side.file.as_ref().unwrap().as_fd()).unwrap();
    assert_eq!((settings.c_ospeed, settings.c_ispeed), (250_000, 250_000));
}

#[test]
fn unsupported_settings_are_reported_in_one_line() {
    let link = path("direction");
    let _side = offer(&link);
    let direction = Direction { rts_on_send: true, rts_after_send: false, delay_before_ms: 0, delay_after_ms: 0 };
    let config = TerminalConfig { direction: Some(direction), ..TerminalConfig::new(link.clone(), 115_200) };
    let refused = Serial::terminal(config).open().unwrap_err();
    assert!(refused.contains("rs485_direction: the port does not support direction control (TIOCSRS485)"), "{refused}");
    let low_latency = TerminalConfig { low_latency: true, ..TerminalConfig::new(link, 115_200) };
    let mut device = Serial::terminal(low_latency);
    assert_eq!((device.open(), device.notes.len()), (Ok(()), 0), "a pseudo-terminal collects nothing");
    assert_eq!(
        Serial::terminal(TerminalConfig::new("/dev/null".into(), 9600)).open(),
        Err("/dev/null: is no terminal".into())
    );
}

/// Attempts to open the port until `done`, for two seconds at most; returns the reports.
fn try_until(port: &mut Port, done: impl Fn(&Port) -> bool) -> Vec<Result<(), Lost>> {
    let mut reported = Vec::new();
    for _ in 0..400 {
        reported.extend(port.try_open(clock::now()));
        if done(port) {
            return reported;
        }
        thread::sleep(std::time::Duration::from_millis(5));
    }
    panic!("{reported:?}")
}

#[test]
fn a_line_of_bytes_carries_one_byte_for_each_word_in_both_directions() {
    let link = path("bytes");
    let mut side = Serial::pseudo_bytes(link.clone(), 19_200);
    side.open().unwrap();
    let config = TerminalConfig { bytes: Some(ByteParity::Even), ..TerminalConfig::new(link, 19_200) };
    let mut device = Serial::terminal(config);
    assert_eq!(device.open(), Ok(()), "a pseudo-terminal has no parity");
    // All values, with those that a terminal could take for control characters.
    let bytes: Vec<u8> = (0..=255).collect();
    let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
    let pass = |from: &mut Serial, to: &mut Serial| {
        assert_eq!(from.send(clock::now(), &Output::Words(words.clone())), Ok(true));
        let mut heard = Vec::new();
        while heard.len() < words.len() {
            if let Received::Input { input: Input::Words(came), .. } = to.receive(clock::now()).unwrap() {
                heard.extend_from_slice(came);
            }
        }
        assert_eq!(heard, words);
    };
    pass(&mut side, &mut device);
    pass(&mut device, &mut side);
    assert!(device.sent_at().is_some_and(|at| at > clock::now()), "256 characters take 147 ms");
}

#[test]
fn an_adapter_that_vanishes_is_lost_and_found_again_when_it_returns_elsewhere() {
    let link = path("adapter");
    let first = offer(&link);
    let mut port = Port::new("rs485.a".into(), PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200)));
    assert_eq!(try_until(&mut port, |port| port.state == PortState::Up), [Ok(())]);
    // Half a word is in the codec when the adapter is unplugged.
    write(first.file.as_ref().unwrap(), &[0x55]).unwrap();
    while !matches!(port.device.receive(clock::now()), Ok(Received::Input { .. })) {}
    drop(first);
    let lost = (0..200).find_map(|_| {
        thread::sleep(std::time::Duration::from_millis(1));
        port.device.receive(clock::now()).err()
    });
    assert!(lost.is_some(), "detected by reading");
    port.lose(clock::now());
    let away_until = clock::now() + Duration::from_millis(100);
    let reported = try_until(&mut port, |_| clock::now() > away_until);
    assert_eq!(reported, [Err(format!("{}: No such file or directory", link.display()))], "once");
    let mut second = offer(&link);
    assert_eq!(try_until(&mut port, |port| port.state == PortState::Up), [Ok(())]);
    let words = [Word::address(0x20), Word::data(1)];
    assert_eq!(second.send(clock::now(), &Output::Words(words.to_vec())), Ok(true));
    for _ in 0..200 {
        if let Received::Input { input: Input::Words(heard), .. } = port.device.receive(clock::now()).unwrap() {
            assert_eq!(heard, words, "without the half word from before");
            return;
        }
        thread::sleep(std::time::Duration::from_millis(1));
    }
    panic!("nothing comes");
}

/// After a simulator was killed its links lead to numbers that the next one, of any robot, may use for another line.
#[test]
fn a_device_that_the_path_no_longer_leads_to_is_given_up_to_its_own_line() {
    let (link, other) = (path("stale"), path("other"));
    let _other_side = offer(&other);
    std::os::unix::fs::symlink(fs::read_link(&other).unwrap(), &link).unwrap();
    let mut device = Serial::terminal(TerminalConfig::new(link.clone(), 115_200));
    device.open().unwrap();
    let poll = Output::Words(vec![Word::address(0x20)]);
    let mut now = clock::now();
    assert_eq!(device.send(now, &poll), Ok(true));
    fs::remove_file(&link).unwrap();
    now += PATH_PERIOD;
    assert_eq!(device.send(now, &poll), Ok(true), "a path that leads nowhere says nothing");
    let mut side = offer(&link);
    assert_eq!(device.send(now, &poll), Ok(true), "checked once a second");
    now += PATH_PERIOD;
    assert_eq!(device.send(now, &poll), Err(format!("{} is another device now", link.display())));
    device.open().unwrap();
    assert_eq!(device.send(now, &poll), Ok(true));
    let heard = (0..200).any(|_| {
        thread::sleep(std::time::Duration::from_millis(1));
        matches!(side.receive(clock::now()), Ok(Received::Input { .. }))
    });
    assert!(heard, "by the line that the path leads to");
    let mut owner = Serial::terminal(TerminalConfig::new(other.clone(), 115_200));
    assert_eq!(owner.open(), Ok(()), "its own line has it again");
}

#[test]
fn the_set_up_command_is_run_before_each_opening_and_its_failure_keeps_the_port_shut() {
    let (link, count) = (path("setup"), path("count"));
    let side = offer(&link);
    let script = format!("sleep 0.1; echo x >> {}", count.display());
    let setup = vec!["/bin/sh".into(), "-c".into(), script];
    let config = TerminalConfig { setup, ..TerminalConfig::new(link.clone(), 115_200) };
    let mut port = Port::new("rs485.a".into(), PortConfig::Terminal(config.clone()));
    // The wait is not reported.
    assert_eq!(try_until(&mut port, |port| port.state == PortState::Up), [Ok(())]);
    port.lose(clock::now());
    assert_eq!(try_until(&mut port, |port| port.state == PortState::Up), [Ok(())]);
    assert_eq!(fs::read_to_string(&count).unwrap(), "x\nx\n");
    drop(port);
    let setup = vec!["/bin/sh".into(), "-c".into(), "echo no such register >&2; exit 3".into()];
    let mut port = Port::new("rs485.a".into(), PortConfig::Terminal(TerminalConfig { setup, ..config }));
    let reported = try_until(&mut port, |port| matches!(port.state, PortState::Down { reported: true, .. }));
    let [Err(why)] = &reported[..] else { panic!("{reported:?}") };
    assert!(why.contains("exit status: 3: no such register"), "{why}");
    let _ = fs::remove_file(count);
    drop(side);
}
