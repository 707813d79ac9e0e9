//! Answers of each protocol, as a probe takes them.

use super::{Ask, Identity, PACKETS, PACKETS_MIN, Packets, Probe};
use crate::event::{Health, Text, text};
use crate::hokuyo::wire::{LF, Parameters, checked};
use crate::ld::wire::{CLOCK_MODULUS_MS, LENGTH, Packet, SAMPLES};
use crate::rplidar;
use crate::rplidar::wire::{DESCRIPTOR, Descriptor, Info, answer, conf};
use crate::sick::Dialect;
use crate::sick::wire::{ETX, HEADER_B, Reader, STX, TELEGRAM_MAX, checksum};
use crate::ydlidar;

/// Time between packets of an LDROBOT that follow each other at most, ms; usually it is below 3.
const GAP_MS: u32 = 50;
/// Longest line of SCIP, checksum included.
const LINE_MAX: usize = 128;

/// As many bytes as have room.
fn kept(bytes: &[u8]) -> Text {
    bytes.trim_ascii().iter().copied().take(Text::new().capacity()).collect()
}

/// The worse of two.
fn worse(one: Option<Health>, other: Health) -> Option<Health> {
    let rank = |health: &Health| match health {
        Health::Good => 0,
        Health::Warning { .. } => 1,
        Health::Error { .. } => 2,
    };
    one.into_iter().chain([other]).max_by_key(rank)
}

impl Probe {
    /// True if the last bytes are the last packet that is needed.
    pub(super) fn take_packet(&mut self) -> bool {
        let Some(begin) = self.rx.len().checked_sub(LENGTH) else { return false };
        let packet = <&[u8; LENGTH]>::try_from(&self.rx[begin..]).ok().and_then(Packet::decode);
        let Some(packet) = packet else {
            // What is older than a packet belongs to none.
            if begin > LENGTH {
                self.rx.drain(..begin);
            }
            return false;
        };
        self.rx.clear();
        let packets = &mut self.packets;
        let modulus = u32::from(CLOCK_MODULUS_MS);
        let elapsed = |last: u16| (modulus + u32::from(packet.timestamp_ms) - u32::from(last)) % modulus;
        let elapsed_ms = packets.last_ms.map_or(0, elapsed);
        // A checksum of 8 bits is right by chance now and then, but not in packets without anything between them. After
        // a gap, as behind what a buffer had kept, rates begin anew.
        if begin > 0 && packets.count < PACKETS_MIN || elapsed_ms > GAP_MS {
            *packets = Packets::default();
        } else {
            packets.took_ms += elapsed_ms;
        }
        packets.last_ms = Some(packet.timestamp_ms);
        packets.count += 1;
        packets.speed_sum += u32::from(packet.speed);
        let is_enough = packets.count >= PACKETS;
        if is_enough {
            self.measured();
        }
        is_enough
    }

    /// Rates of an LDROBOT, once enough packets arrived.
    pub(super) fn measured(&mut self) {
        let packets = self.packets;
        if packets.count < PACKETS_MIN {
            return;
        }
        self.is_found = true;
        self.identity.model = text(format_args!("LDROBOT"));
        self.identity.rate_hz = Some(f64::from(packets.speed_sum) / f64::from(packets.count) / 360.0);
        // A clock of 1 ms needs some time to be one.
        if packets.took_ms >= 100 {
            let samples = f64::from(packets.count - 1) * SAMPLES as f64;
            self.identity.samples_per_s = Some(samples * 1000.0 / f64::from(packets.took_ms));
        }
    }

    /// True if the answer of an RPLIDAR is complete.
    pub(super) fn take_answer(&mut self, ask: Ask) -> bool {
        let (kind, len) = match ask {
            Ask::Info => (answer::INFO, 20),
            Ask::Health => (answer::HEALTH, 3),
            _ => (answer::CONF, 8),
        };
        let Some(payload) = self.payload(kind, len) else { return false };
        match ask {
            Ask::Info => {
                let Some(info) = Info::decode(payload) else { return false };
                self.identity = identified(&info, &self.identity);
                (self.is_found, self.has_speed) = (true, info.has_conf());
            }
            Ask::Health => {
                let Some(health) = health(payload) else { return false };
                self.identity.health = Some(health);
            }
            _ => {
                let Some([low, high, ..]) = payload.strip_prefix(&conf::DESIRED_SPEED.to_le_bytes()) else {
                    return false;
                };
                self.identity.rate_hz = Some(f64::from(u16::from_le_bytes([*low, *high])) / 60.0);
            }
        }
        true
    }

    /// Payload of an answer of this type and length, if it is complete. Bytes before it belong to a scan that was under
    /// way.
    fn payload(&self, kind: u8, len: usize) -> Option<&[u8]> {
        let begin = self.rx.len().checked_sub(DESCRIPTOR + len)?;
        let (head, payload) = self.rx[begin..].split_at(DESCRIPTOR);
        let descriptor = <&[u8; DESCRIPTOR]>::try_from(head).ok().and_then(Descriptor::decode);
        (descriptor == Some(Descriptor { len: len as u32, many: false, kind })).then_some(payload)
    }

    /// True if the answer of a YDLIDAR is complete.
    pub(super) fn take_value(&mut self, ask: Ask) -> bool {
        use ydlidar::wire::answer::{HEALTH, VALUE};
        let (kind, len) = match ask {
            Ask::Info => (VALUE, 20),
            Ask::Health => (HEALTH, 3),
            _ => (VALUE, 4),
        };
        let Some(payload) = self.payload(kind, len) else { return false };
        match ask {
            Ask::Info => {
                let Some(info) = Info::decode(payload) else { return false };
                let (major, minor) = info.firmware;
                self.identity = Identity {
                    model: text(format_args!("YDLIDAR model {}", info.model)),
                    firmware: text(format_args!("{major}.{minor}")),
                    hardware: text(format_args!("{}", info.hardware)),
                    serial: ydlidar::serial(&info),
                    ydlidar: Some(info.model),
                    ..self.identity.clone()
                };
                (self.is_found, self.has_speed) = (true, info.model == ydlidar::Model::G4.number());
            }
            Ask::Health => {
                let Some(health) = health(payload) else { return false };
                self.identity.health = Some(health);
            }
            _ => {
                let Ok(speed) = <[u8; 4]>::try_from(payload) else { return false };
                self.identity.rate_hz = Some(f64::from(u32::from_le_bytes(speed)) / 100.0);
            }
        }
        true
    }

    /// True if the answer of a SICK is complete, or a refusal.
    pub(super) fn take_telegram(&mut self, ask: Ask, dialect: Dialect) -> bool {
        let telegram = loop {
            match frame(dialect, &self.rx) {
                Frame::More => return false,
                // One byte at a time arrives: what is behind the first may begin a frame.
                Frame::Wrong => _ = self.rx.remove(0),
                Frame::Whole(begin, end) => break begin..end,
            }
        };
        let rx = core::mem::take(&mut self.rx);
        let read = |name| Reader::new(dialect, &rx[telegram.clone()], name);
        if read("sFA").is_some() {
            // Who refuses to say what it is answers, but is not identified.
            return self.is_found;
        }
        self.said(ask, read).is_some()
    }

    /// The answer of a SICK to a question; none if it is another one's, or not valid.
    fn said<'a>(&mut self, ask: Ask, read: impl Fn(&'static str) -> Option<Reader<'a>>) -> Option<()> {
        let identity = &mut self.identity;
        match ask {
            Ask::Identity => {
                let mut values = read("sRA DeviceIdent")?;
                (identity.model, identity.firmware) = (kept(values.text()?), kept(values.text()?));
                self.is_found = true;
            }
            Ask::Serial => identity.serial = kept(read("sRA SerialNumber")?.text()?),
            Ask::DeviceState => {
                let state = read("sRA SCdevicestate")?.u8()?;
                identity.state = Some(state);
                let code = state.into();
                identity.health = worse(
                    identity.health,
                    match state {
                        1 => Health::Good,
                        0 => Health::Warning { code },
                        _ => Health::Error { code },
                    },
                );
            }
            Ask::Contamination => {
                let level = read("sRA LCMstate")?.u8()?;
                identity.contamination = Some(level);
                let code = level.into();
                identity.health = worse(
                    identity.health,
                    match level {
                        0 => Health::Good,
                        1 => Health::Warning { code },
                        _ => Health::Error { code },
                    },
                );
            }
            _ => identity.rate_hz = Some(f64::from(read("sRA LMPscancfg")?.u32()?) / 100.0),
        }
        Some(())
    }

    /// True if the answer of a Hokuyo is complete.
    pub(super) fn take_line(&mut self, ask: Ask) -> bool {
        let request: &[u8] = match ask {
            Ask::Version => b"VV",
            Ask::Parameters => b"PP",
            _ => b"II",
        };
        // An answer ends with an empty line; those of a scan under way are others.
        if self.rx.ends_with(&[LF, LF]) {
            let rx = core::mem::take(&mut self.rx);
            let mut lines = rx.split(|byte| *byte == LF).skip_while(|line| *line != request).skip(1);
            if lines.next().and_then(checked) != Some(b"00") {
                return false;
            }
            let mut parameters = Parameters::default();
            // A line with a wrong checksum is left out.
            for line in lines.filter(|line| line.len() <= LINE_MAX).filter_map(checked) {
                self.info(line);
                parameters.take(line);
            }
            if ask == Ask::Version {
                // Without a single valid line there is no answer.
                self.is_found = !self.identity.firmware.is_empty() || !self.identity.serial.is_empty();
                return self.is_found;
            }
            if ask == Ask::Parameters && parameters.is_valid() {
                self.identity.rate_hz = Some(f64::from(parameters.rpm) / 60.0);
            }
            return true;
        }
        false
    }

    fn info(&mut self, line: &[u8]) {
        let value = |name: &[u8]| line.strip_prefix(name).map(|value| value.strip_suffix(b";").unwrap_or(value));
        let identity = &mut self.identity;
        let places: [(&[u8], &mut Text); 6] = [
            (b"MODL:", &mut identity.model),
            (b"FIRM:", &mut identity.firmware),
            (b"PROD:", &mut identity.hardware),
            (b"SERI:", &mut identity.serial),
            (b"STAT:", &mut identity.words),
            (b"LASR:", &mut identity.laser),
        ];
        for (name, place) in places {
            if let Some(value) = value(name) {
                *place = kept(value);
            }
        }
        if let Some(state) = value(b"STAT:") {
            identity.health = Some(if works(state) { Health::Good } else { Health::Error { code: 0 } });
        }
    }
}

/// True if a text of `STAT` means that the sensor works: "Sensor works well.", or of later sensors a code below 100, as
/// "Stable 000 no error.".
fn works(state: &[u8]) -> bool {
    let state = state.trim_ascii();
    let is_code = |word: &&[u8]| word.len() == 3 && word.iter().all(u8::is_ascii_digit);
    let code = state.split(|byte| *byte == b' ').find(is_code);
    state.starts_with(b"Sensor works well") || code.is_some_and(|code| code[0] == b'0')
}

/// Health of an RPLIDAR or YDLIDAR.
fn health(payload: &[u8]) -> Option<Health> {
    let [status, low, high] = *payload else { return None };
    let code = u16::from_le_bytes([low, high]).into();
    Some(match status {
        0 => Health::Good,
        1 => Health::Warning { code },
        _ => Health::Error { code },
    })
}

fn identified(info: &Info, before: &Identity) -> Identity {
    let (major, minor) = info.firmware;
    let known = rplidar::Model::ALL.into_iter().find(|model| model.major() == info.model >> 4);
    let serial = info.serial.iter().fold(0_u128, |all, byte| all << 8 | u128::from(*byte));
    Identity {
        model: text(format_args!("RPLIDAR model 0x{:02X}", info.model)),
        firmware: text(format_args!("{major}.{minor:02}")),
        hardware: text(format_args!("{}", info.hardware)),
        serial: text(format_args!("{serial:032X}")),
        rplidar: known,
        ..before.clone()
    }
}

enum Frame {
    More,
    Wrong,
    /// Begin and end of the telegram.
    Whole(usize, usize),
}

/// Frame of CoLa at the begin of the buffer.
fn frame(dialect: Dialect, rx: &[u8]) -> Frame {
    match (dialect, rx) {
        (_, []) => Frame::More,
        (Dialect::Text, [STX, rest @ ..]) => match rest.last() {
            Some(&ETX) => Frame::Whole(1, rx.len() - 1),
            Some(&STX) => Frame::Wrong,
            _ => Frame::More,
        },
        (Dialect::Text, _) => Frame::Wrong,
        (Dialect::Binary, _) => {
            if !rx.iter().take(4).all(|byte| *byte == STX) {
                return Frame::Wrong;
            }
            let Some(length) = rx.get(4..HEADER_B).and_then(|length| length.try_into().ok()) else {
                return Frame::More;
            };
            let length = u32::from_be_bytes(length) as usize;
            if length == 0 || length > TELEGRAM_MAX - HEADER_B - 1 {
                return Frame::Wrong;
            }
            let end = HEADER_B + length;
            match rx.get(end) {
                None => Frame::More,
                Some(sum) if *sum == checksum(&rx[HEADER_B..end]) => Frame::Whole(HEADER_B, end),
                Some(_) => Frame::Wrong,
            }
        }
    }
}
