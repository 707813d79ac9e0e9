use super::*;
use base::{Duration, gamepad, gpio, i2c, store, thermal, w1};
use messages::{common, lowlevel};
use module::admission::{Origin, Process};
use module::{
    Actions, Event, ExitStatus, Input, Module, Output, PortId, ProcessCommand, ProcessEvent, Shell, ShellConfig,
};
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;

/// Sends a set-point for each command, and zero if none came for `ttl`.
struct Driver {
    ttl: Duration,
    until: Option<Instant>,
}

impl Module for Driver {
    fn subscriptions(&self) -> &[messages::Channel] {
        &[messages::Channel::LlCmdMotion]
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => out.working(),
            Event::Message { at, message: Message::LlCmdMotion(motion), .. } => {
                self.until = Some(at + self.ttl);
                out.send_can(PortId(0), can::Frame::standard(0x201, &motion.speed.to_le_bytes()));
            }
            Event::Timer if self.until.is_some_and(|until| until <= now) => {
                self.until = None;
                out.send_can(PortId(0), can::Frame::standard(0x201, &[0; 8]));
                out.raise(Severity::Warning, Fault::WatchdogSilent, "", "nobody commands");
            }
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.until
    }
}

fn shell(ttl_ms: u64) -> Shell {
    Shell::new(ShellConfig::new("driver"), Box::new(Driver { ttl: Duration::from_millis(ttl_ms), until: None }))
}

fn header() -> Header {
    let texts = vec![("robot.toml".into(), "[limits]\n".into()), ("--set".into(), "a=1".into())];
    Header { program: "advee 0.1.0".into(), module: "driver".into(), wanted: State::Run, texts }
}

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn transfer(write: &[u8], read: i2c::Read) -> i2c::Transfer {
    let address = i2c::Address::new(0x18).unwrap();
    i2c::Transfer { address, write: i2c::Bytes::from_slice(write).unwrap(), read }
}

/// Temperatures of computers.
fn heat() -> Vec<thermal::State> {
    let throttles = [(false, false), (true, false), (false, true), (true, true)];
    let throttles = throttles.map(|(slowed, under_voltage)| Some(thermal::Throttle { slowed, under_voltage }));
    let state = |throttle| {
        let mut state = thermal::State::default();
        state.throttle = throttle;
        assert!(throttle.is_none() || state.push("coretemp/Core 0", 45_000) && state.push("", i32::MIN));
        state
    };
    [None].into_iter().chain(throttles).map(state).collect()
}

fn list(roms: &[w1::Rom]) -> w1::Answer {
    w1::Answer::List(roms.iter().copied().collect())
}

type File = Rc<RefCell<Vec<u8>>>;

/// A shell with a recorder, and its file. `room` returns true while the sink accepts records.
fn recorded(limit: u64, room: impl Fn() -> bool + 'static) -> (Shell, File) {
    let file = File::default();
    let (mut shell, to) = (shell(250), file.clone());
    shell.record(Recorder::new(&header(), limit, move |bytes| {
        let taken = room();
        if taken {
            to.borrow_mut().extend(bytes);
        }
        taken
    }));
    (shell, file)
}

fn command(speed: f64) -> Message {
    lowlevel::CmdMotion { timestamp: 1, speed, steering: 0.0, priority: 1, source: "test".into() }.into()
}

/// Drives for a second, falls silent, and ends.
fn drive(shell: &mut Shell) {
    let mut out = Actions::new(Epoch { offset_us: 1_767_225_600_000_000 });
    shell.handle(at(1000), Event::Start, &mut out);
    shell.raise(at(1000), Report::new(Severity::Warning, Fault::PortDown, "lcm", "refuses"), &mut out);
    shell.clear(at(1001), Report::new(Severity::Notice, Fault::PortDown, "lcm", "takes"), &mut out);
    for n in 0..20_u32 {
        let message = command(0.1 * f64::from(n));
        shell.handle(
            at(1002 + 50 * u64::from(n)),
            Event::Message { at: at(1001), from: Origin::DUE, message: &message },
            &mut out,
        );
    }
    while let Some(due) = shell.poll_timeout().filter(|due| *due < at(3000)) {
        shell.handle(due.max(at(2000)), Event::Timer, &mut out);
    }
    shell.terminate(at(3000), &mut out);
    shell.handle(at(3001), Event::Timer, &mut out);
}

fn driven() -> Vec<u8> {
    let (mut shell, file) = recorded(1 << 20, || true);
    drive(&mut shell);
    file.take()
}

/// Reads to the end; returns the number of records and the reason for the end.
fn read(bytes: &[u8]) -> Result<(u32, End), Refusal> {
    let (mut reader, mut count) = (Reader::open(bytes)?, 0);
    let mut end = None;
    while let Some(item) = reader.read()? {
        match item {
            Item::Record(record) => {
                record.answer()?;
                count += 1;
            }
            Item::End(how) => end = Some(how),
        }
    }
    Ok((count, end.expect("a file has an end")))
}

fn play(bytes: &[u8], shell: Shell) -> Option<Box<Difference>> {
    let (mut reader, mut player) = (Reader::open(bytes).unwrap(), Player::new(shell));
    while let Some(item) = reader.read().unwrap() {
        if let Item::Record(record) = item
            && let Err(difference) = player.play(&record).unwrap()
        {
            return Some(difference);
        }
    }
    None
}

#[test]
fn the_same_shell_answers_the_same() {
    let file = driven();
    assert_eq!(Reader::open(&file).unwrap().header(), &header());
    let (count, end) = read(&file).unwrap();
    assert!(count > 24, "{count}");
    assert_eq!(end, End::Exited);
    assert!(play(&file, shell(250)).is_none());
}

#[test]
fn a_changed_constant_is_found_at_the_first_affected_call() {
    let difference = play(&driven(), shell(249)).unwrap();
    assert_eq!((difference.at, &*difference.call), (at(1002), "message LL_CMD_MOTION"));
    let First::Wake { was, is } = difference.first else { panic!("{difference:?}") };
    assert_eq!((was, is), (Some(at(1251)), Some(at(1250))));
}

#[test]
fn a_different_action_is_shown_beside_the_recorded_one() {
    let file = driven();
    let mut config = ShellConfig::new("driver");
    config.report_from = Severity::Error;
    let other = Shell::new(config, Box::new(Driver { ttl: Duration::from_millis(250), until: None }));
    let difference = play(&file, other).unwrap();
    assert!(difference.call.contains("PortDown lcm"), "{}", difference.call);
    let First::Action { place: 1, was: Some(was), is: None } = difference.first else { panic!("{difference:?}") };
    let Action::Publish(Message::CmEventError(error)) = *was else { panic!("{was:?}") };
    assert!(error.file.ends_with("record/src/tests.rs"), "{}", error.file);
}

#[test]
fn a_truncation_anywhere_is_found_with_its_offset() {
    let file = driven();
    let mut whole = 0;
    for len in 0..file.len() {
        match read(&file[..len]) {
            Ok((_, end)) => {
                assert_eq!(end, End::Open, "{len}");
                whole += 1;
            }
            Err(refusal) => {
                assert_eq!(refusal.why, Why::Cut, "{len}");
                assert!(refusal.place <= len);
            }
        }
    }
    let (count, _) = read(&file).unwrap();
    // After the header, after the epoch, after each record.
    assert_eq!(whole, count + 2);
}

#[test]
fn a_damaged_bit_anywhere_is_found() {
    let file = driven();
    for place in 0..file.len() {
        for bit in [0, 3, 7] {
            let mut damaged = file.clone();
            damaged[place] ^= 1 << bit;
            let refusal = read(&damaged).expect_err("damage is noticed");
            assert!(refusal.place <= place, "byte {place}: {refusal}");
            match place {
                0..8 => assert_eq!(refusal.why, Why::NotOne),
                8..10 => assert!(matches!(refusal.why, Why::Version(_))),
                // A record longer than the file looks like one that was truncated.
                _ => assert!(matches!(refusal.why, Why::Damaged | Why::Cut), "byte {place}: {refusal}"),
            }
        }
    }
}

#[test]
fn a_removed_record_is_found() {
    let file = driven();
    let mut reader = Reader::open(&file).unwrap();
    let mut places = Vec::new();
    while let Some(item) = reader.read().unwrap() {
        if let Item::Record(record) = item {
            places.push(record.place);
        }
    }
    let without = [&file[..places[4]], &file[places[5]..]].concat();
    let refusal = read(&without).unwrap_err();
    assert_eq!(refusal.why, Why::Missing(refusal.record + 1));
    assert_eq!(refusal.place, places[4]);
    assert!(refusal.to_string().starts_with("a gap: record 7 follows at byte "), "{refusal}");
    let twice = [&file[..places[5]], &file[places[4]..]].concat();
    assert!(matches!(read(&twice).unwrap_err().why, Why::Missing(_)));
    let more = [&file[..], b"x"].concat();
    assert_eq!(read(&more).unwrap_err().why, Why::More);
}

#[test]
fn rejected_records_leave_a_gap_with_their_number() {
    let (calls, room) = (Rc::new(RefCell::new(0)), 10..13);
    let count = calls.clone();
    let (mut shell, file) = recorded(1 << 20, move || {
        *count.borrow_mut() += 1;
        !room.contains(&*count.borrow())
    });
    drive(&mut shell);
    let refusal = read(&file.borrow()).unwrap_err();
    // One call did not fit; nor did the record of that gap with the next two calls.
    assert_eq!(refusal.why, Why::Gap(3));
    assert_eq!(refusal.record, 9);
}

#[test]
fn a_gap_before_the_end_is_recorded_too() {
    let (count, counted) = (Cell::new(0), Rc::new(Cell::new(0)));
    let all = counted.clone();
    let (mut shell, _) = recorded(1 << 20, move || {
        counted.set(counted.get() + 1);
        true
    });
    drive(&mut shell);
    // The last record is the end; before it comes the call that led to it.
    let (mut shell, file) = recorded(1 << 20, move || {
        count.set(count.get() + 1);
        count.get() != all.get() - 1
    });
    drive(&mut shell);
    assert_eq!(read(&file.borrow()).unwrap_err().why, Why::Gap(1));
}

#[test]
fn without_room_for_the_header_there_is_no_file_and_gaps_are_known() {
    let (mut shell, file) = recorded(u64::MAX, || false);
    assert!(shell.has_lost_inputs());
    drive(&mut shell);
    assert_eq!(file.borrow().len(), 0);
}

#[test]
fn a_file_ends_validly_at_its_size_limit() {
    let (mut shell, file) = recorded(1200, || true);
    drive(&mut shell);
    let file = file.take();
    let (count, end) = read(&file).unwrap();
    assert_eq!(end, End::Limit);
    assert!(count > 5 && file.len() <= 1200 + 16, "{count} records, {} bytes", file.len());
    assert!(play(&file, self::shell(250)).is_none());
}

#[test]
fn a_file_of_another_format_is_rejected() {
    for (bytes, why) in [
        (&b""[..], Why::Cut),
        (b"ADVEE", Why::Cut),
        (b"\x89MCAP0\r\n", Why::NotOne),
        (b"ADVEEIN\n", Why::Cut),
        (b"ADVEEIN\n\x03\x00rest", Why::Version(3)),
        (b"ADVEEIN\n\x00\x00rest", Why::Version(0)),
    ] {
        assert_eq!(Reader::open(bytes).unwrap_err().why, why);
    }
}

#[test]
fn a_file_of_the_previous_version_is_read_but_not_compared() {
    let mut file = driven();
    assert!(Reader::open(&file).unwrap().comparable().is_ok());
    file[MAGIC.len()] = 1;
    assert_eq!(read(&file).unwrap().1, End::Exited);
    let refusal = Reader::open(&file).unwrap().comparable().unwrap_err();
    assert_eq!(refusal.why, Why::Outdated(1));
    assert!(refusal.to_string().contains("CM_DATA_FAULTS"), "{refusal}");
}

fn pad() -> gamepad::Device {
    let mut device = gamepad::Device::new("a pad");
    for code in [gamepad::ABS_X, gamepad::ABS_Y] {
        device.add_axis(gamepad::Axis { code, min: i32::MIN, max: i32::MAX, fuzz: 16, flat: 128, value: -1 });
    }
    device.add_button(gamepad::Button { code: gamepad::BTN_TL, pressed: true });
    device
}

#[test]
fn a_gamepad_with_too_many_axes_is_rejected() {
    let mut bytes = Vec::new();
    pad::gamepad(&mut bytes, gamepad::Input::Found(&pad()));
    // The second axis with the code of the first.
    let place = bytes.iter().position(|byte| *byte == 2).unwrap() + 1;
    assert_eq!(bytes[place], gamepad::ABS_X as u8);
    bytes[place] = gamepad::ABS_Y as u8;
    assert_eq!(pad::take_gamepad(&mut Decoder(&bytes)), Err(Malformed("a gamepad")));
}

#[test]
fn a_message_whose_sender_makes_no_difference_is_recorded_as_ever() {
    let message = command(0.3);
    let kind = |from| {
        let mut out = Vec::new();
        call::put(&mut out, at(7), &Call::Event(Event::Message { at: at(7), from, message: &message }));
        let read = call::take(&mut Decoder(&out), at(7), |call| match call {
            Call::Event(Event::Message { from, .. }) => Some(from),
            _ => None,
        });
        assert_eq!(read, Ok(Some(from)));
        out[0]
    };
    // Recordings without senders replay as before.
    assert_eq!(kind(Origin::DUE), 2);
    assert_eq!(kind(Origin { due: false, process: None }), 36);
    let unknown = [36, 0, 4];
    assert_eq!(call::take(&mut Decoder(&unknown), at(7), |_| ()), Err(Malformed("a sender")));
}

#[test]
fn every_call_is_read_as_it_was_written() {
    let report = Report::new(Severity::Error, Fault::BoardLost, "sd1", "no answer").fatal();
    let words = [Word::address(0x10), Word::data(0xFF), Word::data(0)];
    let words: Vec<Word> = words.into_iter().cycle().take(19).collect();
    let message = command(f64::NAN);
    let long = Message::from(common::Error { message: "x".repeat(300), ..Default::default() });
    let port = PortId(3);
    let input = |input| Call::Event(Event::Port { port, input });
    let frame = |id, data: &[u8]| can::Frame::new(id, data).unwrap();
    let health = can::Health { state: can::BusState::Off, transmit_errors: 255, receive_errors: 7 };
    let process = |event| Call::Event(Event::Process(event));
    let (module, pid) = ("driver", 4711);
    let block = transfer(&[0x00], i2c::Read::Block { extra: 1 });
    let read = [&[][..], &[0xFF, 0x00, 0x18], &[7; i2c::MAX]].map(|read| Ok(i2c::Bytes::from_slice(read).unwrap()));
    let errors = [i2c::Error::NoAddress, i2c::Error::NoData { at: 35 }, i2c::Error::Arbitration, i2c::Error::Stretched];
    let errors = errors.into_iter().chain([i2c::Error::Stuck, i2c::Error::Other]).map(Err);
    let outcomes: Vec<i2c::Outcome> = read.into_iter().chain(errors).collect();
    let [rom, other] = [0, (1 << 48) - 1].map(|serial| w1::Rom::new(0x28, serial).unwrap());
    let temperatures = [Ok(-55_000), Ok(i32::MAX), Err(w1::Error::Absent), Err(w1::Error::Crc)];
    let temperatures = temperatures.into_iter().chain([Err(w1::Error::Nonsense), Err(w1::Error::Other)]);
    let answers = temperatures.map(|said| w1::Answer::Temperature(rom, said));
    let switches = [Ok(0), Ok(255), Err(w1::Error::Absent), Err(w1::Error::Other)];
    let answers = answers.chain(switches.map(|said| w1::Answer::Switch(other, said)));
    let answers: Vec<w1::Answer> = answers.chain([&[][..], &[rom, other]].map(list)).collect();
    let of_process = |due| Origin { due, process: Some(Process { pid: 4711, uid: 1000 }) };
    let pad = pad();
    let calls = [
        Call::Event(Event::Start),
        Call::Event(Event::Timer),
        Call::Event(Event::State(State::Pause)),
        Call::Event(Event::Message { at: Instant::ZERO, from: Origin::DUE, message: &message }),
        Call::Event(Event::Message { at: Instant::NEVER, from: Origin::DUE, message: &long }),
        Call::Event(Event::Message { at: at(7), from: Origin { due: false, process: None }, message: &message }),
        Call::Event(Event::Message { at: at(7), from: of_process(true), message: &message }),
        Call::Event(Event::Message { at: at(7), from: of_process(false), message: &message }),
        input(Input::Up),
        input(Input::Down("bus-off")),
        input(Input::Can { frame: frame(can::Id::Standard(0x7FF), &[1, 2, 3]), at: at(5000) }),
        input(Input::Can { frame: frame(can::Id::Extended(0x1FFF_FFFF), &[0; 8]), at: at(4820) }),
        input(Input::Can { frame: can::Frame::remote(can::Id::Standard(5), 8).unwrap(), at: Instant::ZERO }),
        input(Input::CanNotice(can::Notice::Health(health))),
        input(Input::CanNotice(can::Notice::NoAcknowledge)),
        input(Input::CanNotice(can::Notice::Errors(u32::MAX))),
        input(Input::CanNotice(can::Notice::Lost(0))),
        input(Input::Words(&words)),
        input(Input::Words(&[])),
        input(Input::Sent),
        input(Input::I2cRequested(&block)),
        input(Input::Gamepad(gamepad::Input::Found(&pad))),
        input(Input::Gamepad(gamepad::Input::Gone)),
        input(Input::Gamepad(gamepad::Input::Axis { code: gamepad::ABS_RX, value: i32::MIN })),
        input(Input::Gamepad(gamepad::Input::Button { code: u16::MAX, pressed: true })),
        input(Input::Gamepad(gamepad::Input::Button { code: gamepad::BTN_TL, pressed: false })),
        input(Input::Gamepad(gamepad::Input::Frame)),
        input(Input::Gpio(gpio::Signal::Read)),
        input(Input::Gpio(gpio::Signal::Level(true))),
        process(ProcessEvent::Started { module, pid }),
        process(ProcessEvent::Earlier { module, wanted: State::Stop, held: true, pid: None }),
        process(ProcessEvent::Earlier { module, wanted: State::Run, held: false, pid: Some(pid) }),
        process(ProcessEvent::Unstartable { module, reason: "no such file" }),
        process(ProcessEvent::Exited { pid, status: ExitStatus::Code(-1) }),
        process(ProcessEvent::Exited { pid, status: ExitStatus::Signal(9) }),
        process(ProcessEvent::HeartbeatStarted { pid }),
        process(ProcessEvent::HeartbeatLate { pid, thread: "main", last: at(7) }),
        process(ProcessEvent::BadHeartbeat { pid, why: "is cut short" }),
        process(ProcessEvent::CheckLate { by: Duration::from_millis(100) }),
        process(ProcessEvent::Usage { pid, cpu: 0.01, rss: -1 }),
        Call::Event(Event::RawMessage { at: at(7), channel: "OTHERS", data: &[1, 2, 3] }),
        Call::Terminate,
        Call::Raise(&report),
        Call::Clear(&report),
        Call::Say(Level::Warning, "a line"),
    ];
    let run = store::Entry { name: "run".into(), bytes: 1 << 40 };
    let stored = [
        store::Answer::Done { free: 7 },
        store::Answer::Listed { entries: vec![run], free: 0 },
        store::Answer::Failed(store::Trouble::Full),
        store::Answer::Failed(store::Trouble::ReadOnly),
        store::Answer::Failed(store::Trouble::Other("gone".into())),
    ];
    let outcomes = outcomes.iter().map(|outcome| input(Input::I2c(outcome)));
    let answers = answers.iter().map(|answer| input(Input::OneWire(answer)));
    let stored = stored.iter().map(|answer| input(Input::Store(answer)));
    let heat = heat();
    let heat = heat.iter().map(|state| input(Input::Thermal(state)));
    for call in calls.into_iter().chain(outcomes).chain(answers).chain(stored).chain(heat) {
        let mut bytes = Vec::new();
        call::put(&mut bytes, at(5000), &call);
        let mut rest = Decoder(&bytes);
        let shown = call::take(&mut rest, at(5000), |call| format!("{call:?}")).unwrap();
        assert_eq!(shown, format!("{call:?}"));
        assert!(rest.0.is_empty(), "{call}");
        for len in 0..bytes.len() {
            assert!(call::take(&mut Decoder(&bytes[..len]), at(5000), |_| ()).is_err(), "{call} cut to {len}");
        }
    }
}

#[test]
fn every_action_is_read_as_it_was_written() {
    let report = || Report::new(Severity::Notice, Fault::BoardLost, "sd1", "answers");
    let module = || String::from("driver");
    let rom = w1::Rom::parse("28-0316a2795bff").unwrap();
    let actions = [
        Action::Publish(command(0.5)),
        Action::Send(PortId(0), Output::Can(can::Frame::standard(0x80, &[]))),
        Action::Send(PortId(255), Output::Words(vec![Word::address(1), Word::data(2)])),
        Action::Send(PortId(1), Output::I2c(transfer(&[], i2c::Read::None))),
        Action::Send(PortId(1), Output::I2c(transfer(&[7; i2c::MAX], i2c::Read::Exactly(36)))),
        Action::Send(PortId(1), Output::I2cAnswer(Err(i2c::Error::Stuck))),
        Action::Send(PortId(2), Output::OneWire(w1::Request::List)),
        Action::Send(PortId(2), Output::OneWire(w1::Request::Temperature(rom))),
        Action::Send(PortId(2), Output::OneWire(w1::Request::Read(rom))),
        Action::Send(PortId(2), Output::OneWire(w1::Request::Write(rom, 2))),
        Action::Send(PortId(2), Output::OneWireState(w1::Answer::Temperature(rom, Ok(85_000)))),
        Action::Send(PortId(3), Output::Thermal),
        Action::Send(PortId(3), Output::ThermalState(heat().remove(1))),
        Action::Send(PortId(1), Output::Gamepad(gamepad::Event::Found(Box::new(pad())))),
        Action::Send(PortId(1), Output::Gamepad(gamepad::Event::Axis { code: gamepad::ABS_Y, value: -32_768 })),
        Action::Send(PortId(1), Output::Gpio(gpio::Signal::Read)),
        Action::Send(PortId(1), Output::Gpio(gpio::Signal::Level(false))),
        Action::Send(PortId(0), Output::Store(store::Request::Create { name: "run/log_000.mcap".into() })),
        Action::Send(PortId(0), Output::Store(store::Request::Append { bytes: Arc::new(vec![7; 300]), sync: true })),
        Action::Send(PortId(0), Output::Store(store::Request::Remove { name: "run".into() })),
        Action::Send(PortId(0), Output::Store(store::Request::List)),
        Action::Raise(report()),
        Action::Clear(report()),
        Action::Report(report()),
        Action::Note(Level::Info, "a line".into()),
        Action::Note(Level::Debug, "another".into()),
        Action::Condition(module::Condition::Working),
        Action::Condition(module::Condition::Failed),
        Action::Process(ProcessCommand::Spawn { module: module(), wanted: State::Run }),
        Action::Process(ProcessCommand::Terminate { pid: 1 }),
        Action::Process(ProcessCommand::Kill { pid: u32::MAX }),
        Action::Process(ProcessCommand::Remember { module: module(), wanted: State::Stop, held: true }),
        Action::Process(ProcessCommand::Health { healthy: true, status: "all well".into() }),
        Action::Run(vec!["/sbin/poweroff".into(), String::new()]),
        Action::State(State::Error),
        Action::Exit(0x20),
    ];
    for wake in [None, Some(None), Some(Some(Instant::ZERO)), Some(Some(Instant::NEVER))] {
        let mut bytes = Vec::new();
        answer::put(&mut bytes, at(5000), &actions, wake);
        let answer = answer::take(Decoder(&bytes), at(5000)).unwrap();
        assert_eq!(format!("{:?}", answer.actions), format!("{actions:?}"));
        assert_eq!(answer.wake, wake);
        for len in 0..bytes.len() {
            assert!(answer::take(Decoder(&bytes[..len]), at(5000)).is_err());
        }
    }
}

#[test]
fn a_message_that_cannot_be_encoded_is_recorded_as_a_text() {
    let message = lowlevel::CmdMotion { source: "a\0b".into(), ..Default::default() }.into();
    let mut bytes = Vec::new();
    answer::put(&mut bytes, at(0), &[Action::Publish(message)], None);
    let answer = answer::take(Decoder(&bytes), at(0)).unwrap();
    let [Action::Note(Level::Info, line)] = &answer.actions[..] else { panic!("{answer:?}") };
    assert!(line.starts_with("LL_CMD_MOTION cannot be sent: "), "{line}");
}
