//! A master, a drive, and the pieces between them, a millisecond at a time on a wire that takes none.

use crate::axis::modes::Mode;
use crate::axis::modes::cyclic::{Cyclic, interpolation_period};
use crate::axis::modes::hm::{Homing, HomingConfig, HomingError};
use crate::axis::modes::pp::Setpoint;
use crate::axis::modes::switch::{Access, Switch, SwitchError};
use crate::axis::servo::Config;
use crate::axis::servo::twin::{Load, Twin};
use crate::axis::{Axis, AxisConfig, Goal};
use crate::dictionary::{Access::ReadWrite, DataType, Entry};
use crate::eds::Eds;
use crate::master::{ConfigWrite, Master, MasterConfig, NodeConfig, PdoMapping, Ticket};
use crate::wire::Service;
use crate::{Dictionary, Event, Payload};
use base::{Duration, Instant};
use std::vec::Vec;

pub const NODE: u8 = 5;
/// SYNC, ms.
pub const PERIOD: u32 = 10;

const MS: Duration = Duration::from_millis(1);

/// What is mapped: RPDO1 the controlword, 2 ip, 3 position, 4 velocity; 2 to 4 at SYNC in cyclic modes.
pub enum Piece {
    Idle,
    Position,
    Velocity(i32),
    Homing,
    Cyclic(Cyclic),
}

pub struct Rig {
    pub now: Instant,
    pub master: Master,
    pub twin: Twin,
    pub axis: Axis,
    pub setpoint: Setpoint,
    pub piece: Piece,
    pub position: i32,
    pub velocity: i32,
    pub statusword: u16,
    /// Code and register.
    pub emergencies: Vec<(u16, u8)>,
    /// What the drive says in PDOs is lost.
    pub mute: bool,
    pub master_dead: bool,
    /// Sent instead of the axis's controlword.
    pub word: Option<u16>,
    mode: Mode,
    switch: Switch,
    homing: Option<Homing>,
    ticket: Option<Ticket>,
    booted: bool,
    sent: Option<(u8, [u8; 6])>,
}

/// A drive with all modes: another project's EDS (Apache-2.0), and what it lacks of them.
fn dictionary(values: &[(u16, i64)]) -> Dictionary {
    let eds = Eds::parse(include_bytes!("../../../../eds/others/ros2_cia402_slave.eds")).unwrap();
    let number = |index, sub, data_type, value| Entry::new(index, sub, data_type, ReadWrite, value).mappable();
    let mut objects = eds.dictionary(NODE).with(&[
        number(0x1016, 0, DataType::U8, 1),
        number(0x1016, 1, DataType::U32, 0),
        number(0x6007, 0, DataType::I16, 1),
        number(0x603F, 0, DataType::U16, 0),
        number(0x605A, 0, DataType::I16, 2),
        number(0x605B, 0, DataType::I16, 0),
        number(0x605C, 0, DataType::I16, 1),
        number(0x605D, 0, DataType::I16, 1),
        number(0x605E, 0, DataType::I16, 2),
        number(0x6065, 0, DataType::U32, 500),
        number(0x6066, 0, DataType::U16, 100),
        number(0x607F, 0, DataType::U32, 5000),
        number(0x60C1, 0, DataType::U8, 1),
        number(0x60C1, 1, DataType::I32, 0),
        number(0x6502, 0, DataType::U32, 0x1E5),
    ]);
    for (index, value) in values {
        let entry = number(*index, 0, if *index == 0x6502 { DataType::U32 } else { DataType::I16 }, *value);
        objects = objects.with(&[entry]);
    }
    objects
}

impl Rig {
    /// Enabled in a mode.
    pub fn enabled(mode: Mode) -> Self {
        let mut rig = Self::with(&[]);
        rig.enable(mode);
        rig
    }

    /// With these objects of the drive.
    pub fn with(values: &[(u16, i64)]) -> Self {
        Self::new(values, Load::default())
    }

    pub fn at(load: Load) -> Self {
        Self::new(&[], load)
    }

    fn new(values: &[(u16, i64)], load: Load) -> Self {
        let now = Instant::from_millis(1000);
        let mut twin = Twin::new(dictionary(values), MS * 10, Config::default(), load);
        twin.power_on(now);
        Self {
            now,
            master: Master::new(MasterConfig::default(), &[]).unwrap(),
            twin,
            axis: Axis::new(AxisConfig { resumes: true, ..AxisConfig::default() }),
            setpoint: Setpoint::new(MS * 100),
            piece: Piece::Idle,
            position: 0,
            velocity: 0,
            statusword: 0,
            emergencies: Vec::new(),
            mute: false,
            master_dead: false,
            word: None,
            mode: Mode::ProfilePosition,
            switch: Switch::new(MS * 500),
            homing: None,
            ticket: None,
            booted: false,
            sent: None,
        }
    }

    fn is_cyclic(mode: Mode) -> bool {
        matches!(mode, Mode::Interpolated | Mode::CyclicPosition | Mode::CyclicVelocity)
    }

    /// Boots the drive for a mode, switches to it and enables the axis.
    pub fn enable(&mut self, mode: Mode) {
        let kind = if Self::is_cyclic(mode) { 1 } else { 255_u8 };
        let (mantissa, exponent) = interpolation_period(MS * u64::from(PERIOD) as u32).unwrap();
        let mapped = |number, value| PdoMapping::rpdo(NODE, number, &[0x6040_0010, value]).adjusted();
        let status = |number, value| PdoMapping::tpdo(NODE, number, &[0x6041_0010, value]).adjusted();
        let node = NodeConfig {
            identity: [Mode::expect(&[Mode::ProfilePosition, Mode::ProfileVelocity, Mode::Homing])].into(),
            writes: [
                ConfigWrite::new(0x6081, 0, 2000_u32),
                ConfigWrite::new(0x6083, 0, 2000_u32),
                ConfigWrite::new(0x6084, 0, 2000_u32),
                ConfigWrite::new(0x6085, 0, 10_000_u32),
                ConfigWrite::new(0x60C2, 1, mantissa),
                ConfigWrite::new(0x60C2, 2, exponent),
                ConfigWrite::new(0x1401, 2, kind),
                ConfigWrite::new(0x1402, 2, kind),
                ConfigWrite::new(0x1403, 2, kind),
                ConfigWrite::new(0x1802, 2, 255_u8),
                ConfigWrite::new(0x1803, 2, 255_u8),
            ]
            .into(),
            mappings: [
                PdoMapping { kind, ..mapped(2, 0x60C1_0120) },
                PdoMapping { kind, ..mapped(3, 0x607A_0020) },
                PdoMapping { kind, ..mapped(4, 0x60FF_0020) },
                status(3, 0x6064_0020),
                status(4, 0x606C_0020),
            ]
            .into(),
            master_limit: Some(MS * 200),
            ..NodeConfig::new(NODE, "drive")
        };
        let sync = Self::is_cyclic(mode).then_some(MS * PERIOD);
        self.master = Master::new(MasterConfig { sync, ..MasterConfig::default() }, &[node]).unwrap();
        for _ in 0..2000 {
            self.run(1);
            if self.booted {
                break;
            }
        }
        assert!(self.booted, "it does not boot");
        self.switch(mode);
        if mode == Mode::ProfilePosition {
            self.piece = Piece::Position;
        }
        self.axis.set_goal(self.now, Goal::Enabled);
        self.run(100);
        assert!(self.axis.is_enabled(), "{:?} {:04X}", self.axis.state(), self.statusword);
    }

    pub fn switch(&mut self, mode: Mode) {
        self.try_switch(mode).unwrap();
    }

    pub fn try_switch(&mut self, mode: Mode) -> Result<(), SwitchError> {
        self.switch.start(mode);
        for _ in 0..2000 {
            self.run(1);
            if let Some(result) = self.switch.poll_finished() {
                if result.is_ok() {
                    self.mode = mode;
                }
                return result;
            }
        }
        panic!("neither switched nor refused");
    }

    pub fn start_homing(&mut self, method: i8, offset: i32) {
        let mut homing = Homing::new(HomingConfig {
            method,
            switch_speed: 5000,
            zero_speed: 500,
            acceleration: Some(50_000),
            offset: Some(offset),
            mode_after: Mode::ProfilePosition.code(),
            timeout: Duration::from_secs(200),
        });
        homing.handle_statusword(self.now, self.statusword);
        homing.start();
        self.homing = Some(homing);
        self.piece = Piece::Homing;
    }

    pub fn home(&mut self, method: i8, offset: i32) -> Result<(), HomingError> {
        self.start_homing(method, offset);
        for _ in 0..200_000 {
            self.run(1);
            if let Some(result) = self.homing.as_mut().and_then(Homing::poll_finished) {
                self.homing = None;
                self.setpoint.reset(self.position);
                self.piece = Piece::Position;
                self.run(50);
                return result;
            }
        }
        panic!("homing has no end");
    }

    pub fn cyclic(&mut self) -> &mut Cyclic {
        match &mut self.piece {
            Piece::Cyclic(cyclic) => cyclic,
            _ => panic!("no cyclic mode"),
        }
    }

    /// An object, as the drive has it.
    pub fn read(&self, index: u16) -> i32 {
        self.twin.node().get(index, 0).unwrap() as i32
    }

    /// Lets so many ms pass.
    pub fn run(&mut self, millis: u32) {
        for _ in 0..millis {
            self.now += MS;
            if !self.master_dead {
                self.master.handle_timeout(self.now);
            }
            self.twin.handle_timeout(self.now);
            for _ in 0..20 {
                self.exchange();
            }
            self.act();
        }
    }

    fn exchange(&mut self) {
        while let Some(frame) = self.master.poll_tx() {
            if self.master_dead {
                continue;
            }
            self.twin.handle_rx(self.now, &frame);
            // The next set-point is under way long before the next SYNC.
            if matches!(Service::of(&frame), Some(Service::Sync)) {
                self.send(true);
            }
        }
        while let Some(frame) = self.twin.poll_tx() {
            let lost = self.mute && matches!(Service::of(&frame), Some(Service::Tpdo { .. }));
            if !lost && !self.master_dead {
                self.master.handle_rx(self.now, &frame);
            }
        }
        while let Some(event) = self.master.poll_event() {
            self.on_event(event);
        }
    }

    fn on_event(&mut self, event: Event) {
        let answer = match event {
            Event::Booted { .. } => {
                self.booted = true;
                // PDOs tell changes alone.
                self.master.sdo_read(self.now, NODE, 0x6041, 0).unwrap();
                return;
            }
            Event::BootFailed { step, reason, .. } => panic!("{step}: {reason}"),
            Event::Emergency { emergency, .. } => {
                self.emergencies.push((emergency.code, emergency.register));
                return;
            }
            Event::Pdo { number, data, .. } => return self.on_pdo(number, data),
            Event::SdoRead { index: 0x6041, data, .. } => return self.on_statusword(data.bits().unwrap() as u16),
            Event::SdoRead { ticket, data, .. } => (ticket, Ok(data)),
            Event::SdoWritten { ticket, .. } => (ticket, Ok(Payload::EMPTY)),
            Event::SdoFailed { ticket, error, .. } => (ticket, Err(error)),
            _ => return,
        };
        let (ticket, result) = answer;
        if self.ticket.take_if(|own| *own == ticket).is_some() {
            match &mut self.homing {
                Some(homing) => homing.handle_sdo(self.now, result),
                None => self.switch.handle_sdo(self.now, result),
            }
        }
    }

    fn on_pdo(&mut self, number: u8, data: [u8; 8]) {
        let [a, b, c, d, e, f, ..] = data;
        let value = i32::from_le_bytes([c, d, e, f]);
        match number {
            3 => self.position = value,
            4 => self.velocity = value,
            _ => {}
        }
        self.on_statusword(u16::from_le_bytes([a, b]));
    }

    fn on_statusword(&mut self, statusword: u16) {
        self.statusword = statusword;
        self.axis.handle_statusword(self.now, self.statusword);
        match &mut self.homing {
            Some(homing) => homing.handle_statusword(self.now, self.statusword),
            None => self.setpoint.handle_statusword(self.now, self.statusword),
        }
    }

    /// What is due of the pieces, and the PDOs of modes without SYNC.
    fn act(&mut self) {
        self.axis.handle_timeout(self.now);
        if self.axis.is_enabled() {
            self.setpoint.handle_timeout(self.now);
        }
        if let Some(homing) = &mut self.homing {
            homing.handle_timeout(self.now);
        }
        self.switch.handle_timeout(self.now);
        let access = match &mut self.homing {
            Some(homing) => homing.poll_sdo(),
            None => self.switch.poll_sdo(),
        };
        let asked = access.map(|access| match access {
            Access::Read { index, sub } => self.master.sdo_read(self.now, NODE, index, sub),
            Access::Write { index, sub, data } => self.master.sdo_write(self.now, NODE, index, sub, data),
        });
        if let Some(ticket) = asked {
            self.ticket = Some(ticket.unwrap());
        }
        self.send(false);
    }

    fn send(&mut self, synced: bool) {
        if !self.booted {
            return;
        }
        let word = self.word.unwrap_or_else(|| self.axis.controlword());
        let enabled = self.axis.is_enabled();
        let (number, word, value) = match &mut self.piece {
            Piece::Cyclic(_) if !synced => return,
            Piece::Cyclic(cyclic) => {
                let number = match self.mode {
                    Mode::Interpolated => 2,
                    Mode::CyclicPosition => 3,
                    _ => 4,
                };
                let (bits, value) = cyclic.sync();
                (number, word | bits, value)
            }
            Piece::Position if enabled => {
                let (bits, target) = self.setpoint.command();
                (3, word | bits, target)
            }
            Piece::Velocity(target) => (4, word, *target),
            Piece::Homing if enabled => (1, word | self.homing.as_ref().map_or(0, Homing::controlword_bits), 0),
            Piece::Idle | Piece::Position | Piece::Homing => (1, word, 0),
        };
        let ([a, b], [c, d, e, f]) = (word.to_le_bytes(), value.to_le_bytes());
        let data = [a, b, c, d, e, f];
        if synced || self.sent != Some((number, data)) {
            let len = if number == 1 { 2 } else { 6 };
            if self.master.send_pdo(NODE, number, &data[..len]).is_ok() {
                self.sent = Some((number, data));
            }
        }
    }
}
