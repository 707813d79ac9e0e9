//! Several contexts of one process on a bus in a folder of its own.
#![allow(clippy::disallowed_methods, reason = "real files, threads and processes")]

use super::Bus;
use super::ring::{CONTROL, Copy, Kind, Message, Read, Reader, Ring, Writer};
use super::station::{HEAD, SIZE};
use super::sync::{Value, Word};
use crate::url::Udpm;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU16, Ordering};

/// A bus of its own, taken away with its folder.
struct Place {
    root: PathBuf,
    url: Udpm,
}

impl Place {
    fn new() -> Self {
        static COUNTER: AtomicU16 = AtomicU16::new(1);
        let counter = COUNTER.fetch_add(1, Ordering::Relaxed);
        let root = PathBuf::from(format!("/dev/shm/lcm-test-{}-{counter}", std::process::id()));
        fs::create_dir(&root).unwrap();
        let group = Ipv4Addr::new(239, 193, (std::process::id() >> 8) as u8, std::process::id() as u8);
        Self { root, url: Udpm { group, port: 30_000 + counter, ..Udpm::default() } }
    }

    fn join(&self, number: u16) -> Bus {
        Bus::join_in(&self.root, &self.url, source(number), u32::from(number)).unwrap()
    }

    fn reader(&self, number: u16, channels: Option<&[&str]>) -> Bus {
        let mut bus = self.join(number);
        bus.set_interest(channels);
        assert!(all(&mut bus).is_empty());
        bus
    }

    fn folder(&self) -> PathBuf {
        fs::read_dir(&self.root).unwrap().next().unwrap().unwrap().path()
    }

    /// File of the context that joined last.
    fn station(&self) -> PathBuf {
        let stations = self.files().into_iter().filter(|name| name.ends_with(".station"));
        self.folder().join(stations.max().unwrap())
    }

    /// What lies in the folder but the board and its lock.
    fn files(&self) -> Vec<String> {
        // The last one takes the folder with it.
        let Some(folder) = fs::read_dir(&self.root).unwrap().next() else { return Vec::new() };
        let entries = fs::read_dir(folder.unwrap().path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name != "board" && name != "lock").collect()
    }

    /// Files as a context leaves them that dies: a copy of those that are there, which nobody holds a lock on.
    fn leave_dead(&self, name: &str) {
        fs::copy(self.station(), self.folder().join(format!("{name}.station"))).unwrap();
        fs::write(self.folder().join(format!("{name}.bell")), "").unwrap();
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.root);
    }
}

fn source(number: u16) -> SocketAddrV4 {
    SocketAddrV4::new(Ipv4Addr::LOCALHOST, number)
}

fn cut(path: &Path, len: u64) {
    fs::OpenOptions::new().write(true).open(path).unwrap().set_len(len).unwrap();
}

/// Everything until it sleeps.
fn all(bus: &mut Bus) -> Vec<(String, Vec<u8>)> {
    let mut got = Vec::new();
    loop {
        while bus.recv(|_| true, |_, _| true) {
            let (channel, payload, _) = bus.message();
            got.push((channel.to_string(), payload.to_vec()));
        }
        if bus.sleep(true) {
            return got;
        }
    }
}

fn names(bus: &mut Bus) -> Vec<String> {
    all(bus).into_iter().map(|(channel, _)| channel).collect()
}

fn rung(bus: &Bus) -> bool {
    poll(&mut [PollFd::new(bus.doorbell(), PollFlags::POLLIN)], PollTimeout::ZERO).unwrap() > 0
}

#[test]
fn what_is_published_after_a_reader_came_is_received_once_and_in_order() {
    let place = Place::new();
    let mut publisher = place.join(1);
    publisher.publish(0, "EARLY", b"", 0);
    let mut reader = place.reader(2, None);
    for n in 1..100 {
        publisher.publish(n, "A", &n.to_ne_bytes(), i64::from(n));
    }
    let got = all(&mut reader);
    let expected: Vec<_> = (1_u32..100).map(|n| ("A".to_string(), n.to_ne_bytes().to_vec())).collect();
    assert_eq!(got, expected);
    assert_eq!(reader.take_lost(), 0);
}

#[test]
fn a_publisher_that_comes_later_is_heard_from_its_first_message_even_when_it_has_left() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    publisher.publish(0, "FIRST", b"1", 0);
    publisher.publish(1, "SECOND", &vec![7; 3 << 20], 0);
    drop(publisher);
    assert!(rung(&reader));
    let got = all(&mut reader);
    assert_eq!(got.len(), 2);
    assert_eq!((got[0].0.as_str(), got[1].0.as_str(), got[1].1.len()), ("FIRST", "SECOND", 3 << 20));
    assert_eq!(place.files().len(), 2, "only the reader's station and bell are left: {:?}", place.files());
}

#[test]
fn a_context_hears_itself() {
    let place = Place::new();
    let mut bus = place.reader(1, Some(&["A"]));
    bus.publish(0, "A", b"x", 5);
    assert!(rung(&bus));
    assert_eq!(names(&mut bus), ["A"]);
    assert_eq!(bus.message(), ("A", &b"x"[..], 5));
}

#[test]
fn messages_of_all_sizes_arrive_whole() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    let sizes = [0, 1, 7, 8, 9, 1000, 1024, 65_536, 1 << 20, (1 << 20) + 1, 10 << 20, 3];
    for (n, size) in (0_u32..).zip(sizes) {
        let payload: Vec<u8> = (0..size).map(|i| (i * 7 + i / 251 + n as usize) as u8).collect();
        publisher.publish(n, &"N".repeat(n as usize % 63 + 1), &payload, 0);
        let got = all(&mut reader);
        assert!(got.len() == 1 && got[0].1 == payload, "{size}");
    }
    assert_eq!(reader.take_lost(), 0);
}

#[test]
fn only_who_sleeps_and_wants_the_channel_is_rung() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let [mut wants, mut other, mut every] =
        [place.reader(2, Some(&["A"])), place.reader(3, Some(&["B"])), place.reader(4, None)];
    assert!(!rung(&wants) && !rung(&other) && !rung(&every));
    publisher.publish(0, "A", b"", 0);
    assert!(rung(&wants) && !rung(&other) && rung(&every));
    publisher.publish(1, "B", b"", 0);
    assert!(rung(&other));
    assert_eq!(names(&mut every), ["A", "B"]);
    // The names that share a bucket are told apart by the caller.
    assert!(
        wants.recv(|name| name == "A", |_, _| true)
            && !wants.recv(|name| name == "A", |_, _| true)
            && wants.sleep(true)
    );
    assert!(
        other.recv(|name| name == "B", |_, _| true)
            && !other.recv(|name| name == "B", |_, _| true)
            && other.sleep(true)
    );
    assert!(!rung(&wants) && !rung(&other) && !rung(&every));
}

#[test]
fn the_bell_stays_readable_until_everything_was_received() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    for n in 0..3 {
        publisher.publish(n, "A", b"", 0);
    }
    for _ in 0..3 {
        assert!(rung(&reader));
        assert!(reader.recv(|_| true, |_, _| true));
    }
    assert!(rung(&reader) && !reader.recv(|_| true, |_, _| true) && reader.sleep(true) && !rung(&reader));
    // Also when the reader finds a message before it is rung for it.
    publisher.publish(3, "A", b"", 0);
    publisher.publish(4, "A", b"", 0);
    assert!(reader.recv(|_| true, |_, _| true) && rung(&reader) && reader.recv(|_| true, |_, _| true));
    assert!(!reader.recv(|_| true, |_, _| true) && reader.sleep(true) && !rung(&reader));
}

#[test]
fn a_bell_that_rang_for_nothing_is_silenced() {
    let place = Place::new();
    let _publisher = place.join(1);
    let mut reader = place.reader(2, None);
    nix::unistd::write(reader.doorbell(), &[0; 3]).unwrap();
    assert!(rung(&reader) && !reader.recv(|_| true, |_, _| true) && reader.sleep(true) && !rung(&reader));
}

/// A watch over a bell by its edges.
fn edges(bus: &Bus) -> Epoll {
    let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).unwrap();
    epoll.add(bus.doorbell(), EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLET, 0)).unwrap();
    epoll
}

/// True if there was an edge since the latest call.
fn edge(epoll: &Epoll) -> bool {
    epoll.wait(&mut [EpollEvent::empty()], EpollTimeout::ZERO).unwrap() > 0
}

fn empty(bus: &Bus) -> usize {
    nix::unistd::read(bus.doorbell(), &mut [0; 70_000]).unwrap_or_default()
}

#[test]
fn a_reader_that_waits_for_edges_is_rung_for_every_sleep_and_seldom_empties_its_bell() {
    let place = Place::new();
    let [mut publisher, mut other] = [1, 2].map(|number| place.join(number));
    let mut reader = place.reader(3, Some(&["A"]));
    let epoll = edges(&reader);
    assert!(reader.sleep(false));
    edge(&epoll);
    for n in 0..1000 {
        assert!(!edge(&epoll), "{n}");
        publisher.publish(n, "A", b"", 0);
        other.publish(n, "A", b"", 0);
        assert!(edge(&epoll), "{n}");
        for more in [true, true, false] {
            assert_eq!(reader.recv(|_| true, |_, _| true), more);
        }
        assert!(reader.sleep(false));
        if n % 100 == 99 {
            assert!(!super::bus::bell_has_edges() || rung(&reader), "its bytes are not read each time");
        }
    }
    assert!(empty(&reader) <= 256, "from time to time they are");
    assert_eq!(reader.take_lost(), 0);
}

#[test]
fn who_finds_a_bell_full_sends_a_datagram() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, Some(&["A"]));
    publisher.publish(0, "A", b"", 0);
    publisher.look_again();
    assert!(!publisher.publish(1, "A", b"", 0), "nobody else listens");
    assert_eq!(all(&mut reader).len(), 2);
    while nix::unistd::write(reader.doorbell(), &[0; 4096]).is_ok() {}
    while nix::unistd::write(reader.doorbell(), &[0]).is_ok() {}
    assert!(publisher.publish(2, "A", b"", 0), "it makes no edge");
    assert_eq!(all(&mut reader).len(), 1);
    assert!(!publisher.publish(3, "A", b"", 0), "it was emptied");
    assert_eq!(all(&mut reader).len(), 1);
}

#[test]
fn a_reader_that_is_awake_is_not_taken_for_one_that_has_read_all() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, Some(&["A"]));
    let payload = [0; 60_000];
    for n in 0..3 {
        publisher.publish(n, "A", &payload, 0);
    }
    assert!(reader.recv(|_| true, |_, _| true));
    // As a publisher of another user leaves it, who may not mark it as woken.
    reader.sleep_word(9);
    for n in 3..40 {
        publisher.publish(n, "A", &payload, 0);
        reader.sleep_word(9);
    }
    assert_eq!((all(&mut reader).len(), reader.take_lost()), (39, 0));
}

#[test]
fn a_reader_that_only_announced_its_sleep_is_not_taken_for_one_that_has_read_all() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, Some(&["A"]));
    let payload = [0; 60_000];
    publisher.publish(0, "A", &payload, 0);
    assert_eq!(all(&mut reader).len(), 1);
    // It found the ring empty, announces a sleep, and is preempted before it looks into the ring once more.
    for n in 1..40 {
        publisher.publish(n, "A", &payload, 0);
        reader.announce();
    }
    assert_eq!((all(&mut reader).len(), reader.take_lost()), (39, 0));
}

#[test]
fn a_reader_that_falls_behind_loses_the_oldest_and_counts_them() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, Some(&["A"]));
    let count = 100_000_u32;
    let payload = [1; 100];
    for n in 0..count {
        publisher.publish(n, if n % 2 == 0 { "A" } else { "B" }, &payload, i64::from(n));
    }
    let mut got = Vec::new();
    loop {
        while reader.recv(|name| name == "A", |_, _| true) {
            got.push(reader.message().2);
        }
        if reader.sleep(true) {
            break;
        }
    }
    assert!(got.is_sorted_by(|a, b| a < b) && got.last() == Some(&i64::from(count - 2)));
    assert!(got.len() > 5000, "{} of the newest are there", got.len());
    assert_eq!(got.len() as u64 + reader.take_lost(), u64::from(count / 2), "those of other channels do not count");
}

#[test]
fn what_was_not_wanted_is_no_loss_later() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, Some(&["A"]));
    for n in 0..50 {
        publisher.publish(n, "B", b"", 0);
    }
    reader.set_interest(Some(&["A", "B"]));
    publisher.publish(50, "B", b"", 0);
    while reader.recv(|_| true, |_, _| true) {}
    assert_eq!(reader.take_lost(), 0);
}

#[test]
fn datagrams_go_out_until_it_is_known_that_nobody_else_listens() {
    let place = Place::new();
    let mut publisher = place.join(1);
    assert!(publisher.publish(0, "A", b"", 0), "nobody reads: nobody would hear a listener come");
    let mut reader = place.reader(2, None);
    assert!(!publisher.publish(1, "A", b"", 0), "a look at the sockets found none");
    assert!(!publisher.publish(2, "A", b"", 0));
    // A self-test: of one of us it is no news.
    reader.self_test(source(1));
    assert!(!publisher.publish(3, "A", b"", 0));
    reader.self_test(source(99));
    assert!(publisher.publish(4, "A", b"", 0));
}

#[test]
fn a_plain_listener_is_found_by_its_socket() {
    let listen = |port| std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port)).unwrap();
    let place = Place::new();
    let _listener = listen(place.url.port);
    let mut publisher = place.join(1);
    let _reader = place.reader(2, None);
    assert!(publisher.publish(0, "A", b"", 0));
}

#[test]
fn beyond_this_host_everything_goes_out() {
    let mut place = Place::new();
    place.url.ttl = 1;
    let mut publisher = place.join(1);
    let _reader = place.reader(2, None);
    assert!(publisher.publish(0, "A", b"", 0) && publisher.publish(1, "A", b"", 0));
}

#[test]
fn datagrams_of_those_with_a_ring_are_dropped_and_those_of_others_are_not() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    assert!(!reader.takes(source(2), 0, 0), "nobody of ours");
    let mut publisher = place.join(2);
    publisher.publish(0, "A", b"", 0);
    assert!(reader.takes(source(2), 0, 0));
    publisher.moved(source(3));
    assert!(reader.takes(source(3), 1, 0) && !reader.takes(source(2), 0, 0));
    drop(publisher);
    assert!(reader.takes(source(3), 1, 0), "not read yet");
    assert_eq!(names(&mut reader), ["A"]);
    let now = super::bus::realtime();
    assert!(reader.takes(source(3), 1, now), "one that was under way");
    assert!(!reader.takes(source(3), 1, now + 10_000_000_000), "another process with that port");
}

#[test]
fn what_the_dead_left_is_taken_away_whoever_has_their_process_id() {
    let place = Place::new();
    let first = place.join(1);
    // Process id and all else are those of a living process: this one.
    place.leave_dead("dead");
    fs::write(place.folder().join("dead.17"), "a payload").unwrap();
    fs::copy(place.folder().join("dead.station"), place.folder().join("half.new")).unwrap();
    fs::write(place.folder().join("half.bell"), "").unwrap();
    assert_eq!(place.files().len(), 7);
    let second = place.join(2);
    assert_eq!(place.files().len(), 4, "{:?}", place.files());
    drop((first, second));
    assert_eq!(fs::read_dir(&place.root).unwrap().count(), 0, "the folder is gone, too");
}

#[test]
fn a_reader_takes_all_of_a_dead_publisher_before_it_is_taken_away() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    for n in 0..10 {
        publisher.publish(n, "A", b"x", 0);
    }
    // Dead with all that it has published; the living one publishes on.
    place.leave_dead("9999-dead");
    let third = place.join(3);
    assert!(place.files().contains(&"9999-dead.station".to_string()), "the reader has not read it");
    assert_eq!(names(&mut reader).len(), 20);
    assert!(!place.files().contains(&"9999-dead.station".to_string()));
    drop(third);
}

#[test]
fn what_a_publisher_left_stays_until_a_reader_that_was_interrupted_has_read_it() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    let mut other = place.join(3);
    publisher.publish(0, "A", b"", 0);
    publisher.publish(1, "BIG", &vec![7; 3 << 20], 0);
    drop(publisher);
    // As after a turn of the socket, which had nothing.
    assert!(reader.recv(|_| true, |_, _| true) && !reader.sleep(true));
    other.look_around();
    let got = all(&mut reader);
    assert!(got.len() == 1 && got[0].1.len() == 3 << 20, "{}", got.len());
    assert_eq!(reader.take_lost(), 0);
}

#[test]
fn what_is_no_station_or_of_another_layout_disturbs_nobody() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let folder = place.folder();
    fs::write(folder.join("short.station"), "too short").unwrap();
    fs::write(folder.join("other.station"), vec![0xa5; SIZE]).unwrap();
    fs::create_dir(folder.join("folder.station")).unwrap();
    let mut publisher = place.join(2);
    publisher.publish(0, "A", b"", 0);
    assert_eq!(names(&mut reader), ["A"]);
    assert!(!folder.join("short.station").exists() && !folder.join("other.station").exists());
}

#[test]
fn a_reader_that_cannot_map_a_ring_asks_for_datagrams() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    assert!(!publisher.publish(0, "A", b"", 0));
    // Held by a living process, and of another layout.
    let path = place.folder().join("other.station");
    fs::write(&path, vec![0xa5; SIZE]).unwrap();
    let file = fs::OpenOptions::new().read(true).open(&path).unwrap();
    let _lock = nix::fcntl::Flock::lock(file, nix::fcntl::FlockArg::LockExclusive).unwrap();
    publisher.moved(source(1));
    all(&mut reader);
    assert!(publisher.publish(1, "A", b"", 0));
}

#[test]
fn a_bus_whose_folder_is_taken_away_goes_on_by_datagrams() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    assert!(!publisher.publish(0, "A", b"", 0));
    fs::remove_dir_all(place.folder()).unwrap();
    publisher.look_again();
    assert!(publisher.publish(1, "A", b"", 0) && publisher.publish(2, "A", b"", 0));
    assert_eq!(names(&mut reader), ["A", "A"]);
    assert!(reader.takes(source(1), 1, 0) && !reader.takes(source(1), 2, 0), "the ring has what came before");
}

#[test]
fn a_reader_whose_own_station_was_cut_hears_those_who_were_there_and_those_who_come() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let own = place.station();
    let mut publisher = place.join(2);
    cut(&own, 0);
    let mut newcomer = place.join(3);
    for n in 0..3 {
        assert!(publisher.publish(n, "A", b"", 0) && newcomer.publish(n, "B", b"", 0), "its bell cannot be rung");
        let mut got = names(&mut reader);
        got.sort();
        assert_eq!(got, ["A", "B"]);
        assert!(reader.takes(source(2), n, 0) && reader.takes(source(3), n, 0), "they are in the rings");
    }
}

/// It does not show how far it has read.
#[test]
fn a_reader_whose_own_station_was_cut_loses_nothing_of_a_burst() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let own = place.station();
    let mut publisher = place.join(2);
    assert!(all(&mut reader).is_empty());
    cut(&own, 0);
    for n in 0..40 {
        publisher.publish(n, "A", &[0; 60_000], 0);
    }
    assert_eq!(all(&mut reader).len(), 40);
}

#[test]
fn a_board_that_was_cut_makes_no_message_come_twice() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    publisher.publish(0, "A", b"", 0);
    cut(&place.folder().join("board"), 0);
    assert!(publisher.publish(1, "A", b"", 0) && publisher.publish(2, "A", b"", 0));
    assert_eq!(names(&mut reader), ["A", "A"]);
    assert!(reader.takes(source(2), 1, 0) && !reader.takes(source(2), 2, 0), "the ring had what came before");
    // Makes a new board, which the others do not see.
    let mut newcomer = place.join(3);
    assert!(newcomer.publish(0, "B", b"", 0), "the reader cannot find its ring");
    assert!(!reader.takes(source(3), 0, 0));
    reader.look_around();
    assert!(names(&mut reader).is_empty(), "it was received");
    assert!(!reader.takes(source(3), 1, 0));
}

#[test]
fn a_folder_that_cannot_be_listed_for_a_moment_makes_no_message_come_twice() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    let (folder, away) = (place.folder(), place.root.with_extension("away"));
    fs::rename(&folder, &away).unwrap();
    let dropped = reader.takes(source(2), 0, 0);
    fs::rename(&away, &folder).unwrap();
    assert!(!dropped && publisher.publish(0, "A", b"", 0) && !reader.takes(source(2), 0, 0), "it comes as a datagram");
    publisher.moved(source(2));
    assert!(names(&mut reader).is_empty(), "it was received");
    assert!(publisher.publish(1, "A", b"", 0) && !reader.takes(source(2), 1, 0));
}

#[test]
fn datagrams_of_a_publisher_that_has_retired_wait_for_its_ring() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    publisher.publish(0, "A", b"", 0);
    assert!(!reader.is_behind() && !reader.overtakes(source(2), 0));
    cut(&place.folder().join("board"), 0);
    publisher.publish(1, "A", b"", 0);
    publisher.publish(2, "A", b"", 0);
    assert!(reader.overtakes(source(2), 2) && !reader.overtakes(source(2), 1), "that one is in the ring, too");
    assert!(reader.is_behind());
    assert_eq!(names(&mut reader), ["A", "A"]);
    assert!(!reader.is_behind() && !reader.overtakes(source(2), 3));
    assert_eq!(reader.take_lost(), 1);
}

#[test]
fn late_datagrams_of_a_cut_publisher_that_has_left_are_not_taken_again() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    let station = place.station();
    (0..3).for_each(|n| assert!(!publisher.publish(n, "A", b"", 0)));
    assert_eq!(names(&mut reader).len(), 3);
    cut(&station, 0);
    assert!(publisher.publish(3, "A", b"", 0));
    assert!(names(&mut reader).is_empty());
    drop(publisher);
    drop(place.join(4));
    assert!(names(&mut reader).is_empty() && !station.exists());
    let taken: Vec<bool> = (1..6).map(|n| !reader.takes(source(2), n, 0)).collect();
    assert_eq!(taken, [false, false, true, true, true], "what was in the ring is dropped");
    assert!(reader.takes(source(2), 3, 0), "an earlier one than the latest");
}

#[test]
fn a_ring_that_was_cut_short_gives_no_torn_message() {
    let place = Place::new();
    let mut reader = place.reader(1, None);
    let mut publisher = place.join(2);
    // Within the fourth message.
    let (station, left) = (place.station(), (HEAD + 10_000) as u64);
    let payload = |n: u32| vec![n as u8 + 1; 3000];
    assert!(all(&mut reader).is_empty());
    (0..10).for_each(|n| assert!(!publisher.publish(n, "A", &payload(n), 0)));
    for n in 0..3 {
        assert!(reader.recv(|_| true, |_, _| true));
        assert_eq!(reader.message().1, payload(n));
    }
    cut(&station, left);
    assert!(all(&mut reader).is_empty());
    assert!(reader.take_lost() > 0);
    // The ring wants to grow beyond the memory that was reserved.
    (10..100).for_each(|n| assert!(publisher.publish(n, "A", &payload(n), 0)));
    assert_eq!(fs::metadata(&station).unwrap().len(), left, "it is not made longer again");
    assert!(reader.takes(source(2), 2, 0) && !reader.takes(source(2), 10, 0));
}

#[test]
fn a_station_without_its_last_byte_is_cut() {
    for length in [0, HEAD, HEAD + 1_000_000, SIZE - 4096, SIZE - 1] {
        let place = Place::new();
        let mut reader = place.reader(1, None);
        let mut publisher = place.join(2);
        let station = place.station();
        publisher.publish(0, "A", b"", 0);
        assert_eq!((names(&mut reader).len(), publisher.is_cut()), (1, false));
        cut(&station, length as u64);
        assert!(publisher.is_cut() && !reader.is_cut(), "{length}");
        assert!(publisher.publish(1, "A", b"", 0) && !reader.takes(source(2), 1, 0), "{length}");
    }
}

#[test]
fn without_memory_left_messages_go_by_datagrams_from_one_number_on() {
    let place = Place::new();
    let mounted = Mounted::tmpfs(&place.root, "300k").ok_or_else(|| "this user may not mount a file system".into());
    let Some(_full) = testing::machine_or_skip(mounted) else { return };
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    let mut got = Vec::new();
    let mut datagrams = Vec::new();
    for n in 0..200_u32 {
        // Nobody sleeps, so the ring wants to grow.
        publisher.publish(n, "A", &[n as u8; 3000], i64::from(n));
        if n == 150 {
            publisher.publish(151, "BIG", &[0; 400_000], 0);
            datagrams = (149..153).filter(|&n| !reader.takes(source(1), n, 0)).collect();
        }
    }
    while reader.recv(|_| true, |_, _| true) {
        got.push(reader.message().2);
    }
    assert_eq!(got.last(), Some(&150), "{got:?}");
    assert_eq!(datagrams, [151, 152]);
    assert_eq!(got.len() as u64 + reader.take_lost(), 151);
}

/// A file system, taken away at the end.
struct Mounted<'a>(&'a std::path::Path);

impl<'a> Mounted<'a> {
    fn tmpfs(at: &'a std::path::Path, size: &str) -> Option<Self> {
        let mut mount = std::process::Command::new("mount");
        let done = mount.args(["-t", "tmpfs", "-o", &format!("size={size}"), "lcm-test"]).arg(at).output();
        done.is_ok_and(|done| done.status.success()).then_some(Self(at))
    }
}

impl Drop for Mounted<'_> {
    fn drop(&mut self) {
        // Lazily: the contexts of the test may still have it mapped.
        let _ = std::process::Command::new("umount").arg("-l").arg(self.0).output();
    }
}

#[test]
fn the_folder_of_another_user_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let place = Place::new();
    let _bus = place.join(1);
    fs::set_permissions(place.folder(), fs::Permissions::from_mode(0o755)).unwrap();
    let error = Bus::join_in(&place.root, &place.url, source(1), 1).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::PermissionDenied);
}

/// Numbers that look random, the same ones every time.
fn random(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}

#[test]
fn whatever_stands_in_a_ring_no_reader_panics_or_works_without_end() {
    let words = |count| (0..count).map(|_| Word::new(0)).collect::<Vec<Word>>();
    let (control, data) = (words(CONTROL), words(1024));
    let ring = Ring { control: &control, data: &data };
    let mut state = 0x9e37_79b9_7f4a_7c15;
    let mut copy = Copy::default();
    let mut messages = 0;
    for _ in 0..300 {
        control.iter().chain(&data).for_each(|word| word.store(0, Ordering::Relaxed));
        let mut writer = Writer::new(ring);
        let mut reader = Reader::from_start();
        for step in 0..60 {
            let len = (random(&mut state) % 1500) as usize;
            let payload = vec![step as u8; len];
            let message = Message { sequence: step, at: 0, channel: "NAME", payload: &payload, kind: Kind::Message };
            if let Some(place) = writer.place(ring, "NAME", len, || step % 3 == 0) {
                writer.write(ring, place, &message);
            }
            // Then something is damaged: a little of the data, or of the control words.
            for _ in 0..random(&mut state) % 4 {
                let value = random(&mut state) >> (random(&mut state) % 64);
                let all: &[Word] = if random(&mut state).is_multiple_of(4) { &control } else { &data };
                all[(random(&mut state) % all.len() as u64) as usize].store(value as Value, Ordering::Relaxed);
            }
            for _ in 0..5 {
                match reader.read(ring, &mut copy, |_| true, |_| true) {
                    Read::Empty => break,
                    Read::Message(_) => messages += 1,
                    Read::Passed => {}
                }
            }
        }
    }
    assert!(messages > 1000, "{messages}");
}

#[test]
fn who_joins_while_the_last_one_leaves_is_on_the_same_bus_as_all_others() {
    let place = Place::new();
    std::thread::scope(|scope| {
        for thread in 0..3_u16 {
            let place = &place;
            scope.spawn(move || {
                for round in 0..300_u32 {
                    let mut reader = place.join(10 + thread);
                    reader.set_interest(Some(&["A"]));
                    let mut publisher = place.join(20 + thread);
                    publisher.publish(round, "A", &[thread as u8], 0);
                    assert!(all(&mut reader).iter().any(|(_, payload)| payload == &[thread as u8]));
                }
            });
        }
    });
    assert_eq!(fs::read_dir(&place.root).unwrap().count(), 0);
}

/// Beyond that there is perhaps no memory: touching it would cut the ring.
#[test]
fn a_ring_that_may_not_grow_touches_only_what_was_reserved() {
    let words = |count| (0..count).map(|_| Word::new(0)).collect::<Vec<Word>>();
    let (control, data) = (words(CONTROL), words(4096 / size_of::<Value>()));
    let ring = Ring { control: &control, data: &data };
    let (mut writer, mut reader, mut copy) = (Writer::new(ring), Reader::from_start(), Copy::default());
    let reserved = 2048;
    writer.limit(reserved);
    // Of 128 bytes in the ring: 16 of them are as long as what was reserved.
    let payload = [1; 96];
    for sequence in 0..100 {
        let message = Message { sequence, at: 0, channel: "A", payload: &payload, kind: Kind::Message };
        let place = writer.place(ring, "A", payload.len(), || false).unwrap();
        assert!(place.reach <= reserved, "{sequence}");
        writer.write(ring, place, &message);
        let beyond = &data[reserved / size_of::<Value>()..];
        assert!(beyond.iter().all(|word| word.load(Ordering::Relaxed) == 0), "{sequence}");
        // Perhaps after the end of a lap.
        let read = (0..2).map(|_| reader.read(ring, &mut copy, |_| true, |_| true)).find(|read| *read != Read::Passed);
        assert_eq!((read, copy.header.sequence), (Some(Read::Message(Kind::Message)), sequence));
    }
    assert_eq!((reader.lost, reader.corrupt), (0, 0));
}

/// A ring full of records whose payloads lie in files that are gone.
#[test]
fn payloads_that_cannot_be_fetched_end_a_turn() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    for n in 0..1000 {
        publisher.publish(n, "A", &vec![0; 2 << 20], 0);
        // All but the latest ones; those that are still there are removed by hand.
        if n % 7 == 0 {
            remove_asides(&place);
        }
    }
    remove_asides(&place);
    let mut turns = 0;
    loop {
        assert!(!reader.recv(|_| true, |_, _| true), "none is there");
        turns += 1;
        if reader.take_lost() == 0 {
            break;
        }
        assert!(reader.sleep(true), "it is readable, and does other work first");
    }
    assert!((1000 / 256..20).contains(&turns), "{turns}");
}

fn remove_asides(place: &Place) {
    let is_aside = |name: &String| name.rsplit_once('.').is_some_and(|(_, end)| end.parse::<u32>().is_ok());
    place.files().into_iter().filter(is_aside).for_each(|name| fs::remove_file(place.folder().join(name)).unwrap());
}

#[test]
fn a_payload_in_a_file_is_taken_up_to_the_size_of_its_subscription() {
    let place = Place::new();
    let mut publisher = place.join(1);
    let mut reader = place.reader(2, None);
    for (n, len) in [(0, 2 << 20), (1, (2 << 20) + 1)] {
        publisher.publish(n, "A", &vec![0; len], 0);
    }
    let takes = |channel: &str, len| channel == "A" && len <= 2 << 20;
    assert!(reader.recv(|_| true, takes));
    assert_eq!(reader.message().1.len(), 2 << 20);
    assert!(!reader.recv(|_| true, takes));
    assert_eq!(reader.take_lost(), 1);
}
