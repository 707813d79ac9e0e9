//! CiA 402 axis of this project with `drive402.py` as its drive, which must never have to refuse a command.

use super::bus::PATIENCE;
use super::master::Side;
use base::{Duration, Instant};
use canopen::axis::modes::hm::{Homing, HomingConfig};
use canopen::axis::modes::pp::Setpoint;
use canopen::axis::modes::pv::VelocityStatus;
use canopen::axis::modes::switch::Access;
use canopen::axis::{Axis, AxisConfig, AxisEvent, Goal, PowerState, control};
use canopen::master::{Event, Expect, NodeConfig, PdoMapping, Ticket};
use canopen::{Payload, pdo, sdo};

const ID: u8 = 9;
/// Controlword, mode of operation, target velocity.
const RPDO1: [u32; 3] = [0x6040_0010, 0x6060_0008, 0x60FF_0020];
/// Target position, profile velocity.
const RPDO2: [u32; 2] = [0x607A_0020, 0x6081_0020];
/// Statusword, mode of operation display.
const TPDO1: [u32; 2] = [0x6041_0010, 0x6061_0008];
/// Actual position and velocity.
const TPDO2: [u32; 2] = [0x6064_0020, 0x606C_0020];
const PP: i8 = 1;
const PV: i8 = 3;

fn config() -> NodeConfig {
    let record = |record, cob_id: u32, entries: &[u32]| pdo::remap(record, cob_id, entries, 255, None, None);
    let writes = [
        record(0x1400, 0x209, &RPDO1),
        record(0x1401, 0x309, &RPDO2),
        record(0x1800, 0x4000_0189, &TPDO1),
        record(0x1801, 0x4000_0289, &TPDO2),
    ];
    NodeConfig {
        device_type: Some(0x0002_0192),
        identity: vec![Expect::equal(0x1018, 2, 402)],
        writes: writes.concat(),
        mappings: vec![PdoMapping::rpdo(ID, 1, &RPDO1), PdoMapping::tpdo(ID, 1, &TPDO1)],
        heartbeat: Duration::from_millis(100),
        // A Python interpreter may be delayed.
        heartbeat_limit: Duration::from_millis(1000),
        ..NodeConfig::new(ID, "drive")
    }
}

/// Axis on its bus.
struct Rig {
    side: Side,
    axis: Axis,
    setpoint: Setpoint,
    homing: Homing,
    ticket: Option<Ticket>,
    mode: i8,
    mode_shown: i8,
    target_velocity: i32,
    position: i32,
    velocity: i32,
    events: Vec<AxisEvent>,
    sent: Option<([u8; 7], [u8; 8])>,
}

impl Rig {
    /// Booted and operational, with the drive disabled.
    fn booted() -> Option<Self> {
        let mut side = Side::start("drive402.py", &[config()])?;
        side.until("boot-up", |event| matches!(event, Event::Booted { node: ID }));
        let homing = HomingConfig {
            method: 24,
            switch_speed: 4000,
            zero_speed: 500,
            acceleration: None,
            offset: Some(-100),
            mode_after: PP,
            timeout: Duration::from_secs(5),
        };
        Some(Self {
            side,
            axis: Axis::new(AxisConfig::default()),
            setpoint: Setpoint::new(Duration::from_millis(500)),
            homing: Homing::new(homing),
            ticket: None,
            mode: PV,
            mode_shown: 0,
            target_velocity: 0,
            position: 0,
            velocity: 0,
            events: Vec::new(),
            sent: None,
        })
    }

    fn now(&self) -> Instant {
        self.side.bus.now()
    }

    fn turn(&mut self) {
        self.side.turn();
        let now = self.now();
        for event in std::mem::take(&mut self.side.events) {
            match event {
                Event::Pdo { node: ID, number: 1, data, .. } => {
                    let word = u16::from_le_bytes([data[0], data[1]]);
                    self.mode_shown = data[2] as i8;
                    self.axis.handle_statusword(now, word);
                    self.setpoint.handle_statusword(now, word);
                    self.homing.handle_statusword(now, word);
                }
                Event::Pdo { node: ID, number: 2, data, .. } => {
                    let [position, velocity] =
                        [0, 4].map(|at| i32::from_le_bytes(data[at..at + 4].try_into().expect("4 bytes")));
                    (self.position, self.velocity) = (position, velocity);
                }
                Event::SdoRead { ticket, data, .. } => self.sdo_done(ticket, Ok(data)),
                Event::SdoWritten { ticket, .. } => self.sdo_done(ticket, Ok(Payload::EMPTY)),
                Event::SdoFailed { ticket, error, .. } => self.sdo_done(ticket, Err(error)),
                Event::Lost { reason, .. } => panic!("the drive is lost: {reason}"),
                _ => {}
            }
        }
        self.axis.handle_timeout(now);
        self.setpoint.handle_timeout(now);
        self.homing.handle_timeout(now);
        self.request();
        while let Some(event) = self.axis.poll_event() {
            self.events.push(event);
        }
        self.command();
    }

    /// Object accesses requested by homing.
    fn request(&mut self) {
        if let Some(access) = self.homing.poll_sdo() {
            let now = self.now();
            let ticket = match access {
                Access::Read { index, sub } => self.side.master.sdo_read(now, ID, index, sub),
                Access::Write { index, sub, data } => {
                    if index == 0x6060 {
                        // The PDO contains it too.
                        self.mode = data.first().map_or(0, |mode| *mode as i8);
                    }
                    self.side.master.sdo_write(now, ID, index, sub, data)
                }
            };
            self.ticket = Some(ticket.expect("the node is there"));
        }
    }

    fn sdo_done(&mut self, ticket: Ticket, result: Result<Payload, sdo::Error>) {
        let now = self.now();
        if self.ticket.take_if(|ours| *ours == ticket).is_some() {
            self.homing.handle_sdo(now, result);
        }
    }

    /// Sends commands that have changed. Set-points precede the controlword.
    fn command(&mut self) {
        let mut word = self.axis.controlword();
        let (bits, target) = self.setpoint.command();
        if self.axis.is_enabled() {
            word |= if self.mode == PP { bits } else { self.homing.controlword_bits() };
        }
        let [a, b] = word.to_le_bytes();
        let [c, d, e, f] = self.target_velocity.to_le_bytes();
        let first = [a, b, self.mode as u8, c, d, e, f];
        let mut second = [0; 8];
        second[..4].copy_from_slice(&target.to_le_bytes());
        second[4..].copy_from_slice(&20_000u32.to_le_bytes());
        if self.sent == Some((first, second)) {
            return;
        }
        if self.sent.is_none_or(|(_, before)| before != second) {
            self.side.master.send_pdo(ID, 2, &second).expect("it is Operational");
        }
        self.side.master.send_pdo(ID, 1, &first).expect("it is Operational");
        self.sent = Some((first, second));
    }

    #[track_caller]
    fn until(&mut self, what: &str, holds: impl Fn(&Self) -> bool) {
        let begin = self.now();
        while !holds(self) {
            assert!(
                self.now().since(begin) < PATIENCE,
                "{what} does not come: {:?} {:04X}, mode {}, {:?}",
                self.axis.state(),
                self.axis.statusword(),
                self.mode_shown,
                self.events
            );
            self.turn();
        }
    }

    #[track_caller]
    fn go(&mut self, goal: Goal) {
        let now = self.now();
        self.axis.set_goal(now, goal);
        self.until("the goal", |rig| rig.axis.is_reached());
    }

    fn enable(&mut self, mode: i8) {
        self.mode = mode;
        self.go(Goal::Enabled);
        self.until("the mode", |rig| rig.mode_shown == mode);
    }

    fn speed(&self) -> VelocityStatus {
        VelocityStatus::decode(self.axis.statusword())
    }

    /// Commands refused by the drive, and its transitions, since the last report.
    fn report(&mut self) -> (Vec<(String, String)>, Vec<u8>) {
        self.side.script.say("report");
        loop {
            if let Some(report) = self.side.script_says("report") {
                return serde_json::from_str(&report).expect("JSON");
            }
            self.turn();
        }
    }

    #[track_caller]
    fn quit(mut self) {
        assert_eq!(self.report().0, [], "the drive refused something");
        self.side.quit();
    }
}

#[test]
fn our_axis_walks_a_foreign_drive_up_down_and_out_of_its_faults_without_an_illegal_command() {
    let Some(mut rig) = Rig::booted() else { return };
    rig.go(Goal::Disabled);
    rig.enable(PV);
    assert_eq!(rig.report(), (vec![], vec![2, 3, 4]));
    rig.go(Goal::Disabled);
    assert_eq!(rig.report(), (vec![], vec![5, 6, 7]));

    rig.enable(PV);
    rig.target_velocity = 3000;
    rig.until("the velocity", |rig| rig.velocity == 3000 && rig.speed().reached);
    rig.axis.halt(true);
    rig.until("the halt", |rig| rig.velocity == 0 && rig.speed().stands && rig.axis.is_enabled());
    rig.axis.halt(false);
    rig.until("the velocity", |rig| rig.velocity == 3000 && rig.speed().reached);
    rig.target_velocity = 0;
    rig.go(Goal::QuickStop);
    rig.until("standing", |rig| rig.velocity == 0 && rig.axis.state() == Some(PowerState::SwitchOnDisabled));
    assert_eq!(rig.report(), (vec![], vec![2, 3, 4, 11, 12]));

    rig.enable(PV);
    rig.target_velocity = -2000;
    rig.until("the velocity", |rig| rig.velocity == -2000);
    rig.events.clear();
    rig.side.script.say("fault");
    rig.until("the fault", |rig| rig.axis.state() == Some(PowerState::Fault));
    assert!(rig.events.iter().any(|event| matches!(event, AxisEvent::Fault { .. })), "{:?}", rig.events);
    assert_eq!(rig.axis.goal(), Goal::Disabled);
    rig.target_velocity = 0;
    rig.until("standing", |rig| rig.velocity == 0);
    let now = rig.now();
    rig.axis.reset_fault(now);
    rig.until("the reset", |rig| rig.axis.state() == Some(PowerState::SwitchOnDisabled));
    // Not automatically: a deliberate act is required.
    rig.axis.set_goal(rig.now(), Goal::Enabled);
    let end = rig.now() + Duration::from_millis(200);
    while rig.now() < end {
        rig.turn();
    }
    assert_eq!(rig.axis.state(), Some(PowerState::SwitchOnDisabled));
    rig.axis.release();
    rig.enable(PV);
    rig.until("it is enabled", |rig| rig.axis.is_enabled());
    assert_eq!(rig.report(), (vec![], vec![2, 3, 4, 13, 14, 15, 2, 3, 4]));
    rig.go(Goal::Disabled);
    rig.quit();
}

#[test]
fn our_axis_goes_to_positions_of_a_foreign_drive_by_the_handshake() {
    let Some(mut rig) = Rig::booted() else { return };
    rig.enable(PP);
    for target in [1500, -800, -800, 0, 12_345] {
        let now = rig.now();
        rig.setpoint.set(now, target);
        rig.until("the position", |rig| {
            rig.setpoint.accepted() == Some(target)
                && rig.position == target
                && rig.setpoint.is_reached(rig.axis.statusword())
        });
    }
    rig.go(Goal::Disabled);
    rig.quit();
}

#[test]
fn our_axis_homes_a_foreign_drive_and_goes_on_from_there() {
    let Some(mut rig) = Rig::booted() else { return };
    rig.enable(PP);
    rig.homing.start();
    rig.until("the end of homing", |rig| !rig.homing.is_running());
    assert_eq!(rig.homing.poll_finished(), Some(Ok(())));
    rig.until("the home position", |rig| rig.position == -100 && rig.mode_shown == PP);
    let now = rig.now();
    rig.setpoint.reset(-100);
    rig.setpoint.set(now, 250);
    rig.until("the position", |rig| rig.position == 250 && rig.setpoint.is_reached(rig.axis.statusword()));
    rig.go(Goal::Disabled);
    rig.quit();
}

/// Invalid commands that the drive refuses and counts: a controlword that skips two states, a reset without a fault.
#[test]
fn the_foreign_drive_refuses_commands_that_are_invalid_in_a_state() {
    let Some(mut rig) = Rig::booted() else { return };
    rig.go(Goal::Disabled);
    let _ = rig.report();
    for word in [control::ENABLE, control::FAULT_RESET] {
        rig.side.master.send_pdo(ID, 1, &[word as u8, 0, PV as u8, 0, 0, 0, 0]).expect("it is Operational");
        let end = rig.now() + Duration::from_millis(100);
        while rig.now() < end {
            rig.side.turn();
        }
    }
    let (refused, taken) = rig.report();
    let refused: Vec<_> = refused.iter().map(|(state, command)| format!("{state}: {command}")).collect();
    assert_eq!(refused, ["switch on disabled: enable 000F", "switch on disabled: fault reset 0080"]);
    assert!(taken.is_empty(), "{taken:?}");
    rig.side.quit();
}
