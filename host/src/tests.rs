//! The host with test modules on its own bus; ports in pairs.

mod scribe;

use super::ports::{Device, Port, PortConfig, PortState, Received, TerminalConfig};
use super::{HostConfig, bus, clock, run, sys};
use base::serial::Word;
use base::{Duration, Instant, can};
use messages::{Channel, Message, common, lowlevel};
use module::{Actions, Event, Input, Line, Module, Output, PortId, PortSpec, Shell, ShellConfig};
use nix::sys::signal::{Signal, raise};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

/// Numbers that no other test uses at the same time, in this process or another.
fn unique() -> (u16, u8, u8) {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let count = NEXT.fetch_add(1, Ordering::Relaxed);
    let pid = std::process::id();
    let port = 40_000 + (pid as u16 & 0x3FF) * 16 + count % 16;
    (port, (pid >> 8) as u8, pid as u8)
}

fn lcm_url() -> String {
    let (port, a, b) = unique();
    format!("udpm://239.67.{a}.{b}:{port}?ttl=0")
}

fn path(name: &str) -> PathBuf {
    let (port, ..) = unique();
    std::env::temp_dir().join(format!("advee-{name}-{}-{port}", std::process::id()))
}

/// Events noted by a test module, read by its test.
type Notes = Arc<Mutex<Vec<String>>>;

/// Notes all events, answers each odometry message, ticks every 10 ms, ends by itself after `life`.
struct Toy {
    ports: Vec<PortSpec>,
    notes: Notes,
    next: Option<Instant>,
    end: Option<Instant>,
    life: Duration,
    send: Option<Output>,
}

impl Toy {
    fn new(life: Duration, bus: Option<(&str, Line)>, send: Option<Output>) -> (Self, Notes) {
        let notes = Notes::default();
        let ports = bus.map(|(bus, line)| PortSpec { bus: bus.into(), line }).into_iter().collect();
        let toy = Self { ports, notes: notes.clone(), next: None, end: None, life, send };
        (toy, notes)
    }

    fn note(&self, text: impl Into<String>) {
        self.notes.lock().unwrap().push(text.into());
    }
}

impl Module for Toy {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataOdo]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.next = Some(now + Duration::from_millis(10));
                self.end = Some(now + self.life);
                out.working();
            }
            Event::Timer => {
                if self.end.is_some_and(|end| end <= now) {
                    self.end = None;
                    // To this thread, in which the host runs.
                    raise(Signal::SIGTERM).unwrap();
                }
                self.next = self.next.map(|next| next + Duration::from_millis(10));
                self.note("tick");
            }
            Event::Message { at, message: Message::LlDataOdo(odo), .. } => {
                assert!(at <= now && now.since(at) < Duration::from_secs(1));
                self.note(format!("odo {}", odo.ticks_left));
                out.publish(lowlevel::DataBus { bus: format!("{}", odo.ticks_left), ..Default::default() });
            }
            Event::Port { input: Input::Up, .. } => {
                self.note("up");
                if let Some(output) = self.send.clone() {
                    out.push(module::Action::Send(PortId(0), output));
                }
            }
            Event::Port { input: Input::Down(reason), .. } => self.note(format!("down {reason}")),
            Event::Port { input: Input::Sent, .. } => self.note("sent"),
            Event::Port { input: Input::CanNotice(notice), .. } => self.note(format!("{notice:?}")),
            Event::Port {
                input:
                    input @ (Input::I2c(_)
                    | Input::I2cRequested(_)
                    | Input::OneWire(_)
                    | Input::Thermal(_)
                    | Input::Gamepad(_)
                    | Input::Gpio(_)
                    | Input::Store(_)),
                ..
            } => self.note(format!("{input:?}")),
            Event::Port { input: Input::Words(words), .. } => {
                words
                    .iter()
                    .for_each(|word| self.note(format!("{:02x}{}", word.byte, if word.ninth { "!" } else { "" })));
            }
            Event::Port { input: Input::Can { frame, .. }, .. } => self.note(format!("{:?}", frame.data())),
            Event::State(state) => self.note(state.name()),
            Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        [self.next, self.end].into_iter().flatten().min()
    }
}

fn host(toy: Toy, lcm_url: &str, ports: Vec<PortConfig>) -> u8 {
    host_of(toy, lcm_url, ports)
}

fn host_of(module: impl Module + 'static, lcm_url: &str, ports: Vec<PortConfig>) -> u8 {
    let shell = Shell::new(ShellConfig::new("toy"), Box::new(module));
    run(
        shell,
        HostConfig {
            lcm_url: lcm_url.into(),
            ports,
            raw: Vec::new(),
            policy: module::admission::Policy::default(),
            launch: None,
            beats: None,
            inputs: None,
        },
    )
    .unwrap()
}

fn count(notes: &Notes, what: &str) -> usize {
    notes.lock().unwrap().iter().filter(|note| *note == what).count()
}

const SHORT: Duration = Duration::from_millis(300);

#[test]
fn timers_keep_their_period_and_sigterm_ends_in_good_order() {
    let (shell, notes) = Toy::new(SHORT, None, None);
    assert_eq!(host(shell, &lcm_url(), Vec::new()), 0);
    let ticks = count(&notes, "tick");
    assert!((25..=32).contains(&ticks), "{ticks} ticks of 10 ms in 300 ms");
    let notes = notes.lock().unwrap();
    assert_eq!((notes[0].as_str(), notes[notes.len() - 1].as_str()), ("RUN", "TERMINATE"));
}

#[test]
fn messages_are_exchanged_and_malformed_ones_reported_once_per_kind() {
    let url = lcm_url();
    let (shell, notes) = Toy::new(Duration::from_millis(600), None, None);
    let mut lcm = lcm::live::Lcm::new(&lcm::Url::parse(&url).unwrap().0).unwrap();
    lcm.subscribe("LL_DATA_BUS|CM_DATA_STATE|CM_EVENT_ERROR").unwrap();
    let peer = thread::spawn(move || {
        let (mut answers, mut states, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        let mut sent = false;
        let until = clock::now() + Duration::from_secs(3);
        while clock::now() < until && !states.contains(&5) {
            lcm.wait(Duration::from_millis(20)).unwrap();
            while let Some(received) = lcm.recv().unwrap() {
                match Message::receive(received.channel, received.payload).unwrap().unwrap() {
                    Message::LlDataBus(bus) => answers.push(bus.bus),
                    Message::CmDataState(state) => states.push(state.state),
                    Message::CmEventError(error) => errors.push(error.message),
                    other => panic!("{other:?}"),
                }
            }
            if !sent && states.contains(&3) {
                sent = true;
                let mut data = Vec::new();
                for ticks_left in 0..200 {
                    data.clear();
                    Message::from(lowlevel::DataOdo { ticks_left, ..Default::default() }).encode(&mut data).unwrap();
                    lcm.publish("LL_DATA_ODO", &data).unwrap();
                    // Too short, and of another type.
                    lcm.publish("LL_DATA_ODO", &data[..9]).unwrap();
                    data.clear();
                    Message::from(common::DataState::default()).encode(&mut data).unwrap();
                    lcm.publish("LL_DATA_ODO", &data).unwrap();
                }
            }
        }
        (answers, states, errors)
    });
    assert_eq!(host(shell, &url, Vec::new()), 0);
    let (answers, states, errors) = peer.join().unwrap();
    let expected: Vec<String> = (0..200).map(|count| count.to_string()).collect();
    assert_eq!(answers, expected, "all, in order");
    assert_eq!(count(&notes, "odo 199"), 1);
    assert_eq!((states.first(), states.last()), (Some(&1), Some(&5)), "INIT to TERMINATE");
    assert_eq!(errors.len(), 2, "one for each kind: {errors:?}");
}

#[test]
fn a_flood_of_messages_does_not_delay_timers() {
    let url = lcm_url();
    let mut lcm = lcm::live::Lcm::new(&lcm::Url::parse(&url).unwrap().0).unwrap();
    let (toy, notes) = Toy::new(SHORT, None, None);
    let flood = thread::spawn(move || {
        let mut data = Vec::new();
        Message::from(lowlevel::DataOdo::default()).encode(&mut data).unwrap();
        let until = clock::now() + SHORT;
        while clock::now() < until {
            let _ = lcm.publish("LL_DATA_ODO", &data);
        }
    });
    assert_eq!(host(toy, &url, Vec::new()), 0);
    flood.join().unwrap();
    assert!(count(&notes, "odo 0") > 1000);
    assert!(count(&notes, "tick") >= 15, "{} ticks of 10 ms in 300 ms", count(&notes, "tick"));
}

#[test]
fn words_cross_a_pair_of_pseudo_terminal_and_terminal() {
    let link = path("line");
    let words = [Word::address(0x20), Word::data(0xFF), Word::data(0x00), Word::address(0xFF)];
    let line = Some(("rs485.a", Line::Serial { baud: 115_200 }));
    let (simulator, heard) = Toy::new(Duration::from_millis(600), line, None);
    let (driver, answered) = Toy::new(SHORT, line, Some(Output::Words(words.to_vec())));
    let (offer, url) = (PortConfig::Pseudo { link: link.clone(), baud: 115_200 }, lcm_url());
    let other_url = lcm_url();
    let side = thread::spawn(move || host(simulator, &url, vec![offer]));
    let taken = PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200));
    assert_eq!(host(driver, &other_url, vec![taken]), 0);
    assert_eq!(side.join().unwrap(), 0);
    let heard: Vec<String> =
        heard.lock().unwrap().iter().filter(|note| note.len() <= 3 && *note != "RUN").cloned().collect();
    assert_eq!(heard, ["up", "20!", "ff", "00", "ff!"]);
    assert_eq!((count(&answered, "up"), count(&answered, "sent")), (1, 1));
    assert!(!link.is_symlink(), "the link is removed");
}

#[test]
fn a_missing_port_is_reported_once_and_opened_when_it_appears() {
    let link = path("late");
    let line = Some(("rs485.a", Line::Serial { baud: 115_200 }));
    let (driver, notes) = Toy::new(Duration::from_millis(800), line, None);
    let late = link.clone();
    let simulator = thread::spawn(move || {
        thread::sleep(Duration::from_millis(200));
        let mut port = Port::new("rs485.a".into(), PortConfig::Pseudo { link: late, baud: 115_200 });
        port.device.open().unwrap();
        thread::sleep(Duration::from_millis(200));
    });
    assert_eq!(host(driver, &lcm_url(), vec![PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200))]), 0);
    simulator.join().unwrap();
    let notes: Vec<String> = notes.lock().unwrap().iter().filter(|note| *note != "tick").cloned().collect();
    let absent = format!("down {}: No such file or directory", link.display());
    assert_eq!(notes.len(), 5, "{notes:?}");
    assert_eq!((&notes[1], notes[2].as_str()), (&absent, "up"));
    assert!(notes[3].starts_with("down "), "lost with its other side: {notes:?}");
}

/// Reads inputs until one comes, for a second at most.
fn next_words(port: &mut dyn Device) -> Vec<Word> {
    for _ in 0..100 {
        match port.receive(clock::now()).unwrap() {
            Received::Input { input: Input::Words(words), .. } => return words.to_vec(),
            Received::Nothing => thread::sleep(Duration::from_millis(10)),
            _ => panic!(),
        }
    }
    panic!("nothing comes")
}

#[test]
fn the_simulator_s_end_survives_closing_and_reopening_of_the_other() {
    let link = path("again");
    let mut simulator = Port::new("a".into(), PortConfig::Pseudo { link: link.clone(), baud: 115_200 });
    assert_eq!(simulator.try_open(clock::now()), Some(Ok(())));
    for byte in [1, 2] {
        let mut driver = Port::new("a".into(), PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200)));
        assert_eq!(driver.try_open(clock::now()), Some(Ok(())));
        let words = vec![Word::address(byte)];
        assert_eq!(driver.device.send(clock::now(), &Output::Words(words.clone())), Ok(true));
        assert_eq!(next_words(&mut *simulator.device), words);
        assert_eq!(simulator.device.send(clock::now(), &Output::Words(words.clone())), Ok(true));
        assert_eq!(next_words(&mut *driver.device), words);
        driver.device.close();
        // No listener: the words are lost, their time passes all the same, and the next listener receives nothing old.
        assert!(matches!(simulator.device.receive(clock::now()), Ok(Received::Nothing)));
        assert_eq!(simulator.device.send(clock::now(), &Output::Words(vec![Word::data(9); 100])), Ok(true));
        assert!(!simulator.device.wants_to_write() && simulator.device.sent_at().is_some());
    }
    drop(simulator);
    assert!(!link.is_symlink());
}

#[test]
fn sent_is_reported_after_the_time_on_the_wire() {
    let link = path("wire");
    let mut simulator = Port::new("a".into(), PortConfig::Pseudo { link: link.clone(), baud: 9600 });
    simulator.device.open().unwrap();
    let mut driver = Port::new("a".into(), PortConfig::Terminal(TerminalConfig::new(link, 9600)));
    driver.device.open().unwrap();
    let now = clock::now();
    let words = Output::Words(vec![Word::data(0); 96]);
    assert_eq!(driver.device.send(now, &words), Ok(true));
    assert_eq!(driver.device.send(now, &words), Ok(true));
    assert_eq!(driver.device.sent_at(), Some(now + Duration::from_millis(110)));
    assert!(!driver.device.take_sent(now + Duration::from_millis(109)));
    assert!(driver.device.take_sent(now + Duration::from_millis(110)));
    assert_eq!(driver.device.sent_at(), Some(now + Duration::from_millis(220)), "one after the other");
    assert!(driver.device.take_sent(now + Duration::from_millis(220)));
    assert!(!driver.device.take_sent(now + Duration::from_millis(220)), "once each");
    // Output that does not leave is bounded, and rejected as a whole.
    let refused = (0..200).find(|_| driver.device.send(now, &words) == Ok(false));
    assert!(refused.is_some() && driver.device.wants_to_write());
}

#[test]
fn a_terminal_is_exclusive_even_for_root() {
    let link = path("held");
    let mut simulator = Port::new("a".into(), PortConfig::Pseudo { link: link.clone(), baud: 115_200 });
    simulator.device.open().unwrap();
    let mut first = Port::new("a".into(), PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200)));
    first.device.open().unwrap();
    let mut second = Port::new("a".into(), PortConfig::Terminal(TerminalConfig::new(link.clone(), 115_200)));
    assert_eq!(second.device.open(), Err(format!("{}: another process holds it", link.display())));
    // Whoever held it, it opens again, for others than root too.
    let held = std::fs::File::open(&link).unwrap();
    assert!(!sys::is_for_root_alone(held.as_fd()).unwrap());
    first.device.close();
    assert_eq!(second.device.open(), Ok(()));
}

#[test]
fn frames_cross_a_multicast_bus_without_own_and_invalid_ones() {
    let (port, a, b) = unique();
    let bus = SocketAddrV4::new(Ipv4Addr::new(239, 68, a, b), port);
    let mut ends = [0, 1].map(|_| Port::new("can.main".into(), PortConfig::CanUdp { bus }));
    for end in &mut ends {
        assert_eq!(end.try_open(clock::now()), Some(Ok(())));
        assert_eq!(end.state, PortState::Up);
    }
    let [left, right] = &mut ends;
    let frame = can::Frame::standard(0x181, &[1, 2, 3]);
    assert_eq!(left.device.send(clock::now(), &Output::Can(frame)), Ok(true));
    let stranger = UdpSocket::bind("0.0.0.0:0").unwrap();
    stranger.set_multicast_ttl_v4(0).unwrap();
    stranger.send_to(b"nonsense", bus).unwrap();
    let mut heard = Vec::new();
    for _ in 0..20 {
        match right.device.receive(clock::now()).unwrap() {
            Received::Input { input: Input::Can { frame, .. }, .. } => heard.push(format!("{:?}", frame.data())),
            Received::Fault(_, why) => heard.push(why.split_once(" is ").unwrap().1.into()),
            Received::Nothing => thread::sleep(Duration::from_millis(5)),
            _ => panic!(),
        }
    }
    assert_eq!(heard, ["[1, 2, 3]", "not a frame: it is not a map"]);
    let Ok(Received::Fault(..)) = left.device.receive(clock::now()) else { panic!("its own frame, or nothing") };
    assert!(matches!(left.device.receive(clock::now()), Ok(Received::Nothing)));
}

#[test]
fn an_invalid_bus_is_reported_in_one_line() {
    let Err(why) = bus::Bus::open("http://localhost", &[]) else { panic!() };
    assert!(why.contains("udpm://") && !why.contains('\n'), "{why}");
}
