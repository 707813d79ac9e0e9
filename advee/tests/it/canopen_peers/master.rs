//! Master of this project, with `slave.py` as its slave.

use super::bus::{Bus, PATIENCE, Script};
use base::Duration;
use canopen::master::{
    BootError, ConfigWrite, Event, Expect, LostReason, Master, MasterConfig, NodeConfig, PdoMapping, State, Step,
};
use canopen::{Abort, NmtCommand, Payload, pdo, sdo};

const ID: u8 = 5;
const TPDO2: [u32; 2] = [0x2005_0020, 0x2003_0010];

/// Master on a bus, and a script on the other side.
pub struct Side {
    pub bus: Bus,
    pub script: Script,
    pub master: Master,
    pub events: Vec<Event>,
    pub said: Vec<String>,
}

impl Side {
    /// Waits until the script is ready.
    pub fn start(script: &str, nodes: &[NodeConfig]) -> Option<Self> {
        let bus = Bus::new();
        let script = Script::start(&format!("advee/tests/it/canopen_peers/{script}"), &bus, &[])?;
        let master = Master::new(MasterConfig::default(), nodes).expect("a good configuration");
        let mut side = Self { bus, script, master, events: Vec::new(), said: Vec::new() };
        side.hear("ready");
        Some(side)
    }

    /// Waits for a line of the script while the master is idle.
    fn hear(&mut self, kind: &str) {
        while self.script_says(kind).is_none() {
            assert!(
                !self.script.is_over() && self.bus.now().as_nanos() < PATIENCE.as_nanos() as u64,
                "{kind} is not said"
            );
            self.bus.wait(None);
        }
    }

    /// Processes input and deadlines.
    pub fn turn(&mut self) {
        self.bus.wait(self.master.poll_timeout());
        while let Some(frame) = self.bus.receive() {
            self.master.handle_rx(self.bus.now(), &frame);
            self.drain();
        }
        self.master.handle_timeout(self.bus.now());
        self.drain();
    }

    fn drain(&mut self) {
        while let Some(frame) = self.master.poll_tx() {
            self.bus.send(frame);
        }
        while let Some(event) = self.master.poll_event() {
            self.events.push(event);
        }
    }

    /// Printed line of this kind, without its first word.
    pub fn script_says(&mut self, kind: &str) -> Option<String> {
        while let Some(line) = self.script.heard() {
            self.said.push(line);
        }
        let at = self.said.iter().position(|line| line.split(' ').next() == Some(kind))?;
        Some(self.said.remove(at)[kind.len()..].trim().into())
    }

    #[track_caller]
    pub fn until_said(&mut self, kind: &str) -> String {
        let begin = self.bus.now();
        loop {
            if let Some(said) = self.script_says(kind) {
                return said;
            }
            assert!(!self.script.is_over() && self.bus.now().since(begin) < PATIENCE, "{kind} is not said");
            self.turn();
        }
    }

    /// Takes the events up to the first one that satisfies `is`, and returns that.
    #[track_caller]
    pub fn until(&mut self, what: &str, is: impl Fn(&Event) -> bool) -> Event {
        let begin = self.bus.now();
        loop {
            if let Some(at) = self.events.iter().position(&is) {
                return self.events.drain(..=at).next_back().expect("it is there");
            }
            assert!(self.bus.now().since(begin) < PATIENCE, "{what} does not come: {:?}", self.events);
            self.turn();
        }
    }

    pub fn pass(&mut self, millis: u64) {
        let end = self.bus.now() + Duration::from_millis(millis);
        while self.bus.now() < end {
            self.turn();
        }
    }

    /// Ends the script, which must succeed.
    #[track_caller]
    pub fn quit(mut self) {
        self.script.say("quit");
        while !self.script.is_over() {
            self.turn();
        }
    }

    fn written(&mut self) -> Vec<(u16, u8, String)> {
        self.script.say("written");
        serde_json::from_str(&self.until_said("written")).expect("JSON")
    }
}

/// Identity and setup of the slave.
fn config() -> NodeConfig {
    let mut writes = vec![ConfigWrite::new(0x2004, 0, 0x0BAD_CAFE_u32)];
    writes.extend(pdo::remap(0x1801, 0x4000_0285, &TPDO2, 1, Some(100), Some(0)));
    NodeConfig {
        device_type: Some(0x191),
        identity: vec![
            Expect::equal(0x1018, 1, 0xFEED),
            Expect::equal(0x1018, 2, 0x8000_0001),
            Expect::at_least(0x1018, 3, 0x0002_0000),
        ],
        writes,
        mappings: vec![PdoMapping::tpdo(ID, 2, &TPDO2)],
        heartbeat: Duration::from_millis(50),
        // A Python interpreter may be delayed.
        heartbeat_limit: Duration::from_millis(500),
        ..NodeConfig::new(ID, "slave")
    }
}

fn booted(event: &Event) -> bool {
    matches!(event, Event::Booted { node: ID })
}

#[test]
fn our_master_boots_a_slave_of_python_canopen_and_changes_its_pdos() {
    let Some(mut side) = Side::start("slave.py", &[config()]) else { return };
    side.until("boot-up", booted);
    assert_eq!(side.until_said("nmt"), "130");
    assert_eq!(side.until_said("nmt"), "1");
    let written = side.written();
    let at = |index, sub, data: &str| {
        let found = written.iter().position(|write| *write == (index, sub, String::from(data)));
        found.unwrap_or_else(|| panic!("{index:04X}:{sub} = {data} was not written: {written:?}"))
    };
    // CiA 301, 9.5.4: off, count 0, entries, count, type and times, on.
    let order = [
        at(0x1801, 1, "850200c0"),
        at(0x1A01, 0, "00"),
        at(0x1A01, 1, "20000520"),
        at(0x1A01, 2, "10000320"),
        at(0x1A01, 0, "02"),
        at(0x1801, 2, "01"),
        at(0x1801, 1, "85020040"),
    ];
    assert!(order.is_sorted(), "{written:?}");
    at(0x2004, 0, "fecaad0b");
    at(0x1017, 0, "3200");

    // One PDO in each direction.
    side.script.say("tpdo -777 -3");
    let pdo = side.until("a TPDO", |event| matches!(event, Event::Pdo { .. }));
    let layout = pdo::Layout::new(&TPDO2).expect("a mapping");
    let Event::Pdo { node: ID, number: 2, data, len: 6 } = pdo else { panic!("{pdo:?}") };
    let values: Vec<i64> = layout.unpack(&data[..6]).expect("6 bytes").map(|(_, value)| value).collect();
    // The mapping alone does not tell that a number is signed.
    assert_eq!(values.iter().map(|value| *value as i32 as i16).collect::<Vec<_>>(), [-777, -3]);
    side.script.say("listen");
    side.pass(200);
    side.master.send_pdo(ID, 1, &[0x5A, 0xFD, 0xFF]).expect("it is Operational");
    assert_eq!(side.until_said("pdo"), "90 -3");

    // Unchanged values are not written again.
    side.master.reboot(side.bus.now(), ID);
    side.until("boot-up", booted);
    let again = side.written();
    assert!(again.iter().any(|(index, ..)| *index == 0x1801), "reset communication forgets PDOs: {again:?}");
    assert!(!again.iter().any(|(index, ..)| *index == 0x2004), "{again:?}");
    side.quit();
}

#[test]
fn our_master_loses_a_slave_of_python_canopen_that_falls_silent_or_reboots() {
    let Some(mut side) = Side::start("slave.py", &[config()]) else { return };
    side.until("boot-up", booted);
    side.script.say("silent");
    side.until("the loss", |event| matches!(event, Event::Lost { node: ID, reason: LostReason::Heartbeat }));
    assert_ne!(side.master.state(ID), Some(State::Operational));
    side.until("boot-up", booted);
    side.script.say("boot");
    side.until("the loss", |event| matches!(event, Event::Lost { node: ID, reason: LostReason::BootUp }));
    side.until("boot-up", booted);
    side.master.nmt(canopen::master::Target::Node(ID), NmtCommand::Stop);
    side.until("the loss", |event| {
        matches!(event, Event::Lost { node: ID, reason: LostReason::State(canopen::NmtState::Stopped) })
    });
    side.until("boot-up", booted);
    side.quit();
}

#[test]
fn our_master_refuses_a_slave_of_python_canopen_with_another_identity() {
    let Some(mut side) = Side::start("slave.py", &[config()]) else { return };
    side.script.say("identity 2 17");
    side.hear("changed");
    let failed = side.until("the refusal", |event| matches!(event, Event::BootFailed { .. }));
    let mismatch = BootError::Mismatch { index: 0x1018, sub: 2, expected: 0x8000_0001, found: 17 };
    assert_eq!(failed, Event::BootFailed { node: ID, step: Step::Identity, reason: mismatch });
    assert!(side.written().is_empty(), "nothing is set up in a stranger");
    // The right device is connected.
    side.script.say(&format!("identity 2 {}", 0x8000_0001_u32));
    side.until("boot-up", booted);
    side.quit();
}

#[test]
fn a_flood_of_emergencies_from_python_canopen_is_counted_and_limited() {
    let Some(mut side) = Side::start("slave.py", &[config()]) else { return };
    side.until("boot-up", booted);
    side.script.say("emergencies 500");
    let mut told = Vec::new();
    let begin = side.bus.now();
    while side.master.stats(ID).expect("it is configured").emergencies < 500 {
        side.turn();
        assert!(side.bus.now().since(begin) < PATIENCE, "{:?}", side.master.stats(ID));
    }
    let took = side.bus.now().since(begin);
    side.pass(300);
    for event in side.events.drain(..) {
        match event {
            Event::Emergency { node: ID, emergency, suppressed } => told.push((emergency, suppressed)),
            Event::Lost { .. } => panic!("{event:?}"),
            _ => {}
        }
    }
    let few = 3 + took.as_millis() as usize / 100 + 3;
    assert!((2..=few).contains(&told.len()), "{} told in {took:?}", told.len());
    let (first, last) = (&told[0].0, &told[told.len() - 1].0);
    assert_eq!((first.code, first.register, first.info[0]), (0x8100, 0x11, 0));
    // 499 is 0x1F3.
    assert_eq!((last.code, last.info[..2].to_vec()), (0x81F3, vec![0xF3, 1]));
    let suppressed: u32 = told.iter().map(|(_, suppressed)| suppressed).sum();
    assert_eq!(told.len() as u32 + suppressed, 500);
    side.quit();
}

/// Node without configuration: object access only.
#[test]
fn our_client_reads_and_writes_every_size_in_python_canopen_and_falls_back_where_it_has_no_blocks() {
    let Some(mut side) = Side::start("slave.py", &[]) else { return };
    let refused = |side: &mut Side, index, sub, write: Option<&[u8]>, code| {
        let now = side.bus.now();
        let ticket = match write {
            Some(data) => side.master.sdo_write(now, ID, index, sub, data),
            None => side.master.sdo_read(now, ID, index, sub),
        };
        let ticket = ticket.expect("a node id");
        match side.until("an answer", |event| ticket_of(event) == Some(ticket)) {
            Event::SdoFailed { error: sdo::Error::Refused(abort), .. } => assert_eq!(abort, code),
            other => panic!("{other:?}"),
        }
    };
    refused(&mut side, 0x5FFF, 0, None, Abort::NO_OBJECT);
    refused(&mut side, 0x1018, 9, None, Abort::NO_SUB_INDEX);
    refused(&mut side, 0x2007, 0, None, Abort::WRITE_ONLY);
    refused(&mut side, 0x2006, 0, Some(&[1, 2]), Abort::READ_ONLY);
    refused(&mut side, 0x2004, 0, Some(&[1, 2]), Abort(0x0607_0010));
    for (nth, length) in (1..=32).chain([127, 128, 888, 889, 890, 1778, 4096, 10_000]).enumerate() {
        let data: Vec<u8> = (0..length).map(|n: usize| (n * n / 7 + 31 * n) as u8).collect();
        let blocks = nth % 2 == 0;
        let now = side.bus.now();
        let ticket = match blocks {
            true => side.master.sdo_write_block(now, ID, 0x2000, 0, &data[..]),
            false => side.master.sdo_write(now, ID, 0x2000, 0, &data[..]),
        };
        let ticket = ticket.expect("a node id");
        let done = side.until("the end of the write", |event| ticket_of(event) == Some(ticket));
        assert!(matches!(done, Event::SdoWritten { .. }), "{length} bytes: {done:?}");
        let now = side.bus.now();
        let ticket = match blocks {
            true => side.master.sdo_read_block(now, ID, 0x2000, 0),
            false => side.master.sdo_read(now, ID, 0x2000, 0),
        };
        let ticket = ticket.expect("a node id");
        match side.until("the end of the read", |event| ticket_of(event) == Some(ticket)) {
            Event::SdoRead { data: read, .. } => assert_eq!(read, Payload::from(&data[..]), "{length} bytes"),
            other => panic!("{length} bytes: {other:?}"),
        }
    }
    side.quit();
}

fn ticket_of(event: &Event) -> Option<canopen::master::Ticket> {
    match event {
        Event::SdoRead { ticket, .. } | Event::SdoWritten { ticket, .. } | Event::SdoFailed { ticket, .. } => {
            Some(*ticket)
        }
        _ => None,
    }
}
