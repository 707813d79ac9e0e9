//! Folders for tests; full and read-only disks where mounting is permitted.

use super::*;
use crate::ports::threaded::Threaded;
use crate::ports::{Device, Received};
use base::Instant;
use base::store::{Entry, Trouble};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sched::{CloneFlags, unshare};
use std::fs;
use std::os::unix::fs::symlink;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

type Store = Threaded<Files>;

/// A folder for one test, removed at its end.
struct Made(PathBuf);

impl Made {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-store-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir(&path).unwrap();
        Self(path)
    }

    fn disk(&self) -> Disk {
        Disk::new(&self.0.join("log"))
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join("log").join(name)).unwrap()
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn create(name: &str) -> Request {
    Request::Create { name: name.into() }
}

fn append(bytes: &[u8]) -> Request {
    Request::Append { bytes: Arc::new(bytes.to_vec()), sync: true }
}

fn remove(name: &str) -> Request {
    Request::Remove { name: name.into() }
}

#[track_caller]
fn done(answer: Answer) -> u64 {
    match answer {
        Answer::Done { free } => free,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn failed(answer: Answer) -> String {
    match answer {
        Answer::Failed(Trouble::Other(why)) => why,
        other => panic!("{other:?}"),
    }
}

fn listed(disk: &mut Disk) -> Vec<(String, u64)> {
    match disk.perform(Request::List) {
        Answer::Listed { entries, free } if free > 0 => {
            entries.into_iter().map(|Entry { name, bytes }| (name, bytes)).collect()
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn files_are_created_written_listed_and_removed() {
    let made = Made::new("life");
    let mut disk = made.disk();
    assert_eq!((listed(&mut disk), failed(disk.perform(append(b"x")))), (vec![], "no file is open".into()));
    assert!(done(disk.perform(create("run_b/log_000.mcap"))) > 0);
    done(disk.perform(append(b"one ")));
    done(disk.perform(append(b"two")));
    assert_eq!(made.read("run_b/log_000.mcap"), b"one two");
    done(disk.perform(create("run_b/log_001.mcap")));
    done(disk.perform(append(b"three")));
    assert_eq!(
        (made.read("run_b/log_000.mcap"), made.read("run_b/log_001.mcap")),
        (b"one two".into(), b"three".into())
    );
    assert!(failed(disk.perform(create("run_b/log_000.mcap"))).contains("exists"), "nothing is written over");
    assert_eq!(made.read("run_b/log_000.mcap"), b"one two");
    fs::create_dir_all(made.0.join("log/run_a/inputs")).unwrap();
    fs::write(made.0.join("log/run_a/inputs/driver"), [0; 100]).unwrap();
    fs::write(made.0.join("log/.hidden"), [0; 100]).unwrap();
    assert_eq!(listed(&mut disk), [("run_a".into(), 100), ("run_b".into(), 12)]);
    done(disk.perform(remove("run_a")));
    done(disk.perform(remove("run_b/log_000.mcap")));
    done(disk.perform(remove("never_was")));
    done(disk.perform(remove("never/was")));
    assert_eq!(listed(&mut disk), [("run_b".into(), 5)]);
}

#[test]
fn an_open_file_is_not_removed() {
    let made = Made::new("own");
    let mut disk = made.disk();
    done(disk.perform(create("run/log_000.mcap")));
    for name in ["run", "run/log_000.mcap"] {
        assert_eq!(failed(disk.perform(remove(name))), format!("{name} is being written"));
    }
    done(disk.perform(create("run2/log_000.mcap")));
    done(disk.perform(remove("run")));
}

#[test]
fn nothing_outside_is_touched() {
    let made = Made::new("links");
    let mut disk = made.disk();
    let (outside, folder) = (made.0.join("outside"), made.0.join("log"));
    fs::create_dir_all(outside.join("deep")).unwrap();
    fs::create_dir_all(folder.join("run")).unwrap();
    fs::write(outside.join("deep/precious"), [0; 10]).unwrap();
    symlink(&outside, folder.join("link")).unwrap();
    symlink(&outside, folder.join("run/link")).unwrap();
    symlink(outside.join("new"), folder.join("run/log_000.mcap")).unwrap();
    assert_eq!(listed(&mut disk), [("run".into(), 0)], "targets of links are not counted");
    for name in ["", "/etc/passwd", "../outside/new", "run/../../outside", ".", "a/b/c", "run/\0", "run\n/x"] {
        assert!(failed(disk.perform(create(name))).contains("is no valid file name"), "{name:?}");
        assert!(failed(disk.perform(remove(name))).contains("is no valid file name"), "{name:?}");
    }
    failed(disk.perform(create("link/new")));
    failed(disk.perform(create("run/log_000.mcap")));
    failed(disk.perform(remove("link/deep")));
    done(disk.perform(remove("link")));
    done(disk.perform(remove("run")));
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
    assert_eq!((fs::read(outside.join("deep/precious")).unwrap().len(), outside.join("new").exists()), (10, false));
}

#[test]
fn a_removed_folder_is_reported_and_created_again() {
    let made = Made::new("removed");
    let mut disk = made.disk();
    done(disk.perform(create("run/log_000.mcap")));
    fs::remove_dir_all(made.0.join("log")).unwrap();
    assert_eq!(failed(disk.perform(append(b"lost"))), "run/log_000.mcap: it was removed");
    assert_eq!(listed(&mut disk), []);
    done(disk.perform(create("run/log_000.mcap")));
    done(disk.perform(append(b"found")));
    assert_eq!(made.read("run/log_000.mcap"), b"found");
}

#[test]
fn a_file_in_place_of_the_folder_is_reported() {
    let made = Made::new("file");
    fs::write(made.0.join("log"), "").unwrap();
    let mut disk = made.disk();
    failed(disk.perform(create("run/log_000.mcap")));
    failed(disk.perform(remove("run")));
    failed(disk.perform(Request::List));
}

/// Runs a test on a disk of 1 MB that no other process sees; skipped if mounting is not permitted.
fn on_a_small_disk(name: &'static str, test: impl FnOnce(&Made) + Send + 'static) {
    // Mount namespace of this thread and its children; it ends with them.
    let tested = thread::spawn(move || {
        let made = Made::new(name);
        let mounted = unshare(CloneFlags::CLONE_NEWNS).is_ok()
            && mount(&["--make-rprivate", "/"])
            && mount(&["-t", "tmpfs", "-o", "size=1m,nr_inodes=64", "tmpfs", &made.0.to_string_lossy()]);
        if mounted {
            test(&made);
        }
        if mounted { Ok(()) } else { Err("no disk may be mounted here".to_string()) }
    });
    testing::machine_or_skip(tested.join().unwrap());
}

fn mount(args: &[&str]) -> bool {
    Command::new("mount").args(args).status().is_ok_and(|status| status.success())
}

#[test]
fn writes_to_a_full_disk_are_atomic_and_resume_with_free_space() {
    on_a_small_disk("full", |made| {
        let mut disk = made.disk();
        done(disk.perform(create("old/log_000.mcap")));
        done(disk.perform(append(&[1; 600_000])));
        done(disk.perform(create("run/log_000.mcap")));
        let free = done(disk.perform(append(&[2; 300_000])));
        assert!(free < 200_000, "{free}");
        for _ in 0..3 {
            assert_eq!(disk.perform(append(&[3; 300_000])), Answer::Failed(Trouble::Full));
            assert_eq!(made.read("run/log_000.mcap"), [2; 300_000], "a partial write is undone");
        }
        assert_eq!(listed(&mut disk), [("old".into(), 600_000), ("run".into(), 300_000)]);
        done(disk.perform(remove("old")));
        done(disk.perform(append(&[4; 300_000])));
        assert_eq!(made.read("run/log_000.mcap")[300_000..], [4; 300_000]);
        // Bytes of a file that another process removes are free at the next query of the free space.
        fs::remove_file(made.0.join("log/run/log_000.mcap")).unwrap();
        assert_eq!(listed(&mut disk), [("run".into(), 0)]);
        assert!(done(disk.perform(create("run/log_001.mcap"))) > 900_000);
        // No space for another name.
        let files = (0..100).find_map(|n| match disk.perform(create(&format!("run/log_{n:03}"))) {
            Answer::Failed(trouble) => Some(trouble),
            _ => None,
        });
        assert_eq!(files, Some(Trouble::Full));
    });
}

#[test]
fn a_disk_that_becomes_read_only_is_reported_as_such() {
    on_a_small_disk("read-only", |made| {
        let mut disk = made.disk();
        done(disk.perform(create("run/log_000.mcap")));
        done(disk.perform(append(b"one")));
        done(disk.perform(create("run2/log_000.mcap")));
        drop(disk);
        assert!(mount(&["-o", "remount,ro", &made.0.to_string_lossy()]));
        let mut disk = made.disk();
        for request in [create("run/log_001.mcap"), create("run3/log_000.mcap"), remove("run")] {
            assert_eq!(disk.perform(request), Answer::Failed(Trouble::ReadOnly));
        }
        assert_eq!(listed(&mut disk), [("run".into(), 3), ("run2".into(), 0)]);
    });
}

#[test]
fn a_folder_without_write_permission_is_reported_as_such() {
    if nix::unistd::geteuid().is_root() {
        testing::machine_or_skip::<()>(Err("a user other than root, who may write everywhere".into()));
        return;
    }
    let made = Made::new("forbidden");
    Command::new("chmod").arg("555").arg(&made.0).status().unwrap();
    assert_eq!(made.disk().perform(create("run/log_000.mcap")), Answer::Failed(Trouble::ReadOnly));
    Command::new("chmod").arg("755").arg(&made.0).status().unwrap();
}

fn answer(store: &mut Store) -> Option<Answer> {
    match store.receive(Instant::ZERO).unwrap() {
        Received::Input { input: Input::Store(answer), .. } => Some(answer.clone()),
        _ => None,
    }
}

fn wait(store: &mut Store) -> Answer {
    loop {
        if let Some(answer) = answer(store) {
            return answer;
        }
        poll(&mut [PollFd::new(store.fd().unwrap(), PollFlags::POLLIN)], PollTimeout::NONE).unwrap();
    }
}

/// True while the disk of the test below blocks.
static STUCK: AtomicBool = AtomicBool::new(true);

#[test]
fn a_blocked_disk_does_not_block_the_loop() {
    let made = Made::new("slow");
    let mut store = Store::new(Files::new(made.0.join("log")));
    store.service.before = |_| {
        while STUCK.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(1));
        }
    };
    store.open().unwrap();
    let (tell, told) = mpsc::channel();
    let (made, loops) = (
        Arc::new(made),
        thread::spawn(move || {
            let send = |store: &mut Store, request| store.send(Instant::ZERO, &Output::Store(request)).unwrap();
            assert!(send(&mut store, create("run/log_000.mcap")));
            let taken = (0..20).filter(|_| send(&mut store, append(&[7; 100_000]))).count();
            assert_eq!((taken, answer(&mut store)), (module::OUTSTANDING - 1, None));
            tell.send(()).unwrap();
            store
        }),
    );
    // None of these calls waited for the disk.
    told.recv_timeout(Duration::from_secs(10)).unwrap();
    let mut store = loops.join().unwrap();
    STUCK.store(false, Ordering::Relaxed);
    let free = (0..module::OUTSTANDING).map(|_| done(wait(&mut store))).min();
    assert!(free > Some(0));
    assert_eq!(made.read("run/log_000.mcap").len(), 700_000);
    store.close();
    while store.life.is_alive() {
        thread::yield_now();
    }
    store.open().unwrap();
}
