//! Files as power failures and crashes leave them.

use super::*;
use mcap::{Summary, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::os::unix::fs::symlink;
use std::process::Command;

/// A folder for one test, removed at its end.
struct Made(PathBuf);

impl Made {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-repair-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(path.join("run")).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    fn repair(&self) -> Vec<String> {
        let mut told = Vec::new();
        repair(&self.0, u64::MAX, |line| told.push(line));
        told
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A file of 50 chunks with 20 messages each.
fn whole() -> Vec<u8> {
    let options = WriteOptions::new().compression(None).chunk_size(None);
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    let channel = writer.add_channel(0, "COUNT", "lcm", &BTreeMap::new()).unwrap();
    for n in 0..1000u32 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: n,
            log_time: n.into(),
            publish_time: n.into(),
        };
        writer.write_to_known_channel(&header, &[n as u8; 100]).unwrap();
        if n % 20 == 19 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn messages(path: &Path) -> u64 {
    let bytes = fs::read(path).unwrap();
    Summary::read(&bytes).unwrap().expect("an index").stats.expect("statistics").message_count
}

#[test]
fn a_truncated_log_is_indexed_once() {
    let (made, whole) = (Made::new("cut"), whole());
    let data = whole.len() * 9 / 10;
    let path = made.file("run/log_000.mcap", &whole);
    assert_eq!(made.repair(), [""; 0]);
    let mut last = 0;
    for cut in (200..data).step_by(997) {
        fs::write(&path, &whole[..cut]).unwrap();
        let told = made.repair();
        let count = messages(&path);
        assert_eq!(told, [format!("run/log_000.mcap: index added: {count} messages")], "cut at {cut}");
        assert!(count >= last && count.is_multiple_of(20), "whole chunks: {count}");
        last = count;
        assert_eq!(made.repair(), [""; 0]);
    }
    assert!(last > 800, "{last}");
    // Some file systems leave a block of zeros at the end.
    fs::write(&path, [&whole[..data], &[0; 4096]].concat()).unwrap();
    assert_eq!((made.repair().len(), messages(&path)), (1, last));
}

#[test]
fn other_files_and_logs_in_use_are_left_unchanged() {
    let (made, whole) = (Made::new("others"), whole());
    let half = &whole[..whole.len() / 2];
    let outside = made.0.with_extension("outside");
    fs::write(&outside, half).unwrap();
    symlink(&outside, made.0.join("run/link.mcap")).unwrap();
    symlink("/", made.0.join("root")).unwrap();
    let held = made.file("run/log_001.mcap", half);
    let lock = Flock::lock(File::open(&held).unwrap(), FlockArg::LockExclusiveNonblock).unwrap();
    let files = ["run/log_001.mcap", "run/inputs/log_000.mcap", "log_000.mcap", "run/notes.txt", "run/.hidden.mcap"];
    files[1..].iter().for_each(|name| drop(made.file(name, half)));
    assert!(Command::new("mkfifo").arg(made.0.join("run/pipe.mcap")).status().unwrap().success());
    assert_eq!(made.repair(), [""; 0]);
    assert!(files.iter().all(|name| fs::read(made.0.join(name)).unwrap() == half));
    assert_eq!(fs::read(&outside).unwrap(), half);
    drop(lock);
    assert_eq!(made.repair().len(), 1, "it is written no more");
    fs::remove_file(&outside).unwrap();
}

#[test]
fn an_irreparable_log_is_reported_and_kept() {
    let (made, mut damaged) = (Made::new("damaged"), whole());
    damaged.truncate(60_000);
    damaged[30_000..33_000].fill(0xFF);
    let path = made.file("run/log_000.mcap", &damaged);
    made.file("run/log_001.mcap", b"");
    made.file("run/log_002.mcap", b"no log at all, but more than a few bytes of it");
    let told = made.repair();
    assert_eq!(told.len(), 3, "{told:?}");
    assert!(told[0].starts_with("run/log_000.mcap: damaged inside: use advee log recover"), "{told:?}");
    assert_eq!(told[1], "run/log_001.mcap: removed, because it was empty");
    assert_eq!(fs::read(&path).unwrap(), damaged);
    assert!(!made.0.join("run/log_001.mcap").exists());
}
