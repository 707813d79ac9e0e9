//! What the data of requests and answers says, for people and as JSON: every instruction of every board.

use rs485::boards::psc1::{self, CHANNELS, Unasked};
use rs485::boards::{Board, DO_RESET, GET_VERSION, Implausible, Version, sbs1, sd1, so1};
use serde_json::{Value, json};

/// What some data says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Says {
    /// In words; empty for no data.
    pub text: String,
    /// An object; null for no data.
    pub json: Value,
}

impl Says {
    fn new(text: impl Into<String>, json: Value) -> Self {
        Self { text: text.into(), json }
    }
}

/// The name of an instruction: as the board's table has it, else its number.
pub fn instruction(board: Option<&Board>, code: u8) -> String {
    let common = [GET_VERSION, DO_RESET].into_iter().find(|common| common.code == code);
    let known = board.and_then(|board| board.instruction(code)).or(common.as_ref()).map(|known| known.name);
    known.map_or_else(|| format!("{code:#04x}"), Into::into)
}

/// What a request's data says.
pub fn request(board: Option<&Board>, code: u8, data: &[u8]) -> Says {
    match board.map(|board| board.name) {
        _ if data.is_empty() => Says::default(),
        Some("sbs1") if code == sbs1::SET_BEACON_IDS.code => {
            Says::new(format!("beacons {}", joined(data, |id| id.to_string())), json!({"beacons": data}))
        }
        Some("psc1") if code == psc1::SET_PWR_STATUS.code => match psc1::parse_set(data) {
            Ok((mask, states)) => {
                let switched = |on| channels(mask & if on { states } else { !states });
                let part = |on, word| {
                    if switched(on).is_empty() { None } else { Some(format!("{}{word}", switched(on).join("+"))) }
                };
                let text: Vec<String> = [part(true, " on"), part(false, " off")].into_iter().flatten().collect();
                Says::new(text.join(", "), json!({"on": switched(true), "off": switched(false)}))
            }
            Err(_) => bytes(data),
        },
        _ => bytes(data),
    }
}

/// What the data of a good answer says, or why it cannot be believed.
pub fn answer(board: Option<&Board>, code: u8, data: &[u8]) -> Result<Says, Implausible> {
    if code == GET_VERSION.code {
        let version = Version::parse(data).ok_or(Implausible::Layout { len: data.len() })?;
        return Ok(Says::new(format!("version {version}"), json!({"version": version.to_string()})));
    }
    match board.map(|board| board.name) {
        Some("sd1") => of_sd1(code, data),
        Some("so1") => of_so1(code, data),
        Some("sbs1") => of_sbs1(code, data),
        Some("psc1") => of_psc1(code, data),
        _ => Ok(bytes(data)),
    }
}

fn of_sd1(code: u8, data: &[u8]) -> Result<Says, Implausible> {
    // Distances in the messages' unit; where there is nothing, a dash.
    let srfs = |srfs: &sd1::Srfs| {
        let metres = |mm: u16| if mm == sd1::NO_ECHO { "-".into() } else { format!("{:.2}", f64::from(mm) / 1000.0) };
        (format!("sonars {} m", joined(srfs, metres)), json!(srfs.to_vec()))
    };
    let irs = |irs: &sd1::Irs| {
        let millimetres = |mm: u8| if mm == sd1::OUT_OF_RANGE { "-".into() } else { mm.to_string() };
        (format!("floor {} mm", joined(irs, millimetres)), json!(irs.to_vec()))
    };
    if code == sd1::GET_SRF_DATA.code {
        let (text, json) = srfs(&sd1::parse_srfs(data)?);
        Ok(Says::new(text, json!({"sonars_mm": json})))
    } else if code == sd1::GET_IR_DATA.code {
        let (text, json) = irs(&sd1::parse_irs(data)?);
        Ok(Says::new(text, json!({"floor_mm": json})))
    } else if code == sd1::GET_BOTH_DATA.code {
        let both = sd1::Both::parse(data)?;
        let ((srf_text, srfs), (ir_text, irs)) = (srfs(&both.srfs), irs(&both.irs));
        Ok(Says::new(format!("{srf_text}, {ir_text}"), json!({"sonars_mm": srfs, "floor_mm": irs})))
    } else if code == sd1::GET_PAUSE_SRC.code {
        let name = match sd1::PauseSource::parse(data)? {
            sd1::PauseSource::None => "none",
            sd1::PauseSource::IrLeft => "left",
            sd1::PauseSource::IrRight => "right",
        };
        Ok(Says::new(format!("PAUSE by {name}"), json!({"pause_by": name})))
    } else {
        Ok(bytes(data))
    }
}

fn of_so1(code: u8, data: &[u8]) -> Result<Says, Implausible> {
    if code != so1::GET_TICKS.code {
        return Ok(bytes(data));
    }
    let ticks = so1::parse_ticks(data)?;
    Ok(Says::new(format!("ticks {}", joined(&ticks, |count| count.to_string())), json!({"ticks": ticks.to_vec()})))
}

fn of_sbs1(code: u8, data: &[u8]) -> Result<Says, Implausible> {
    if code == sbs1::GET_BEACON_DATA.code {
        let sightings = sbs1::parse_beacons(data)?;
        let text = |sighting: &sbs1::Sighting| {
            let sbs1::Sighting { id, bearing, strength, age_ms } = sighting;
            format!("{id} at {:.2} deg ({strength}, {age_ms} ms ago)", f64::from(*bearing) / 100.0)
        };
        let object = |sighting: &sbs1::Sighting| {
            let sbs1::Sighting { id, bearing, strength, age_ms } = sighting;
            json!({"id": id, "bearing_deg": f64::from(*bearing) / 100.0, "strength": strength, "age_ms": age_ms})
        };
        let all: Vec<String> = sightings.iter().map(text).collect();
        let text = if all.is_empty() { "no beacon".into() } else { format!("beacon {}", all.join(", ")) };
        Ok(Says::new(text, json!({"beacons": sightings.iter().map(object).collect::<Vec<_>>()})))
    } else if code == sbs1::GET_DEBUG_DATA.code {
        let sbs1::Debug { sweeps, rejected_pulses, supply_mv } = sbs1::parse_debug(data)?;
        let text =
            format!("{sweeps} sweeps, {rejected_pulses} pulses rejected, {:.2} V", f64::from(supply_mv) / 1000.0);
        let json = json!({"sweeps": sweeps, "rejected_pulses": rejected_pulses, "supply_mv": supply_mv});
        Ok(Says::new(text, json))
    } else {
        Ok(bytes(data))
    }
}

fn of_psc1(code: u8, data: &[u8]) -> Result<Says, Implausible> {
    if code == psc1::GET_PWR_STATUS.code || code == psc1::SET_PWR_STATUS.code {
        let on = channels(psc1::parse_status(data)?);
        let text = if on.is_empty() { "all off".into() } else { format!("{} on", on.join("+")) };
        Ok(Says::new(text, json!({"on": on})))
    } else if code == psc1::GET_CURRENTS.code {
        let psc1::Currents { milliamps, battery_mv } = psc1::parse_currents(data)?;
        let each = CHANNELS.iter().zip(milliamps).map(|(name, ma)| format!("{name} {:.2}", f64::from(ma) / 1000.0));
        let text =
            format!("battery {:.2} V; {} A", f64::from(battery_mv) / 1000.0, each.collect::<Vec<_>>().join(", "));
        let object: serde_json::Map<String, Value> =
            CHANNELS.iter().zip(milliamps).map(|(name, ma)| ((*name).into(), ma.into())).collect();
        Ok(Says::new(text, json!({"battery_mv": battery_mv, "milliamps": object})))
    } else if psc1::UNASKED.iter().any(|unasked| unasked.code == code) {
        match psc1::parse_unasked(code, data)? {
            Unasked::PauseChanged { engaged, source } => {
                let name = psc1::source_name(source).unwrap_or("nobody");
                let text = if engaged { format!("PAUSE by {name}") } else { format!("no PAUSE (last by {name})") };
                Ok(Says::new(text, json!({"engaged": engaged, "source": name})))
            }
            Unasked::PowerOffRequested { seconds } => {
                Ok(Says::new(format!("supply cut in {seconds} s"), json!({"seconds": seconds})))
            }
        }
    } else {
        Ok(bytes(data))
    }
}

fn channels(mask: u8) -> Vec<&'static str> {
    CHANNELS.iter().enumerate().filter(|(channel, _)| mask >> channel & 1 == 1).map(|(_, name)| *name).collect()
}

/// Data that nobody knows.
pub fn bytes(data: &[u8]) -> Says {
    if data.is_empty() {
        return Says::default();
    }
    Says::new(joined(data, |byte| format!("{byte:02x}")), json!({"data": data}))
}

fn joined<T: Copy>(values: &[T], text: impl Fn(T) -> String) -> String {
    values.iter().map(|value| text(*value)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use rs485::boards::BOARDS;

    fn board(name: &str) -> Option<&'static Board> {
        BOARDS.iter().find(|board| board.name == name)
    }

    #[track_caller]
    fn says(name: &str, code: u8, data: &[u8], text: &str) {
        assert_eq!(answer(board(name), code, data).unwrap().text, text);
    }

    #[test]
    fn every_answer_reads_as_a_person_would_say_it() {
        says("sd1", 0x10, &[2, 0xE8, 0x03, 0, 0, 2, 120, 255], "sonars 1.00 - m, floor 120 - mm");
        says("sd1", 0x20, &[1], "PAUSE by left");
        says("sd1", 0x21, &[], "");
        says("so1", 0x01, &[0x01, 0x00, 0xFE, 0xFF], "ticks 1 -2");
        says("sbs1", 0x02, &[1, 7, 0x28, 0x23, 200, 0xFA, 0x00], "beacon 7 at 90.00 deg (200, 250 ms ago)");
        says("sbs1", 0x02, &[0], "no beacon");
        says("sbs1", 0x03, &[1, 0, 3, 0, 0x88, 0x13], "1 sweeps, 3 pulses rejected, 5.00 V");
        says("psc1", 0x01, &[0b1001], "host+motors on");
        says("psc1", 0x80, &[1, 0x20], "PAUSE by button");
        says("psc1", 0x80, &[0, 0], "no PAUSE (last by nobody)");
        says("psc1", 0x81, &[30], "supply cut in 30 s");
        says("?", 0xFE, &[1, 4], "version 1.4");
        says("?", 0x07, &[1, 0xAB], "01 ab");
    }

    #[test]
    fn requests_and_names_too() {
        assert_eq!(request(board("psc1"), 0x02, &[0b11_0000, 0b01_0000]).text, "monitor on, audio off");
        assert_eq!(request(board("sbs1"), 0x01, &[3, 7]).text, "beacons 3 7");
        assert_eq!(request(board("so1"), 0x01, &[]), Says::default());
        assert_eq!(instruction(board("so1"), 0x01), "get_ticks");
        assert_eq!(instruction(None, 0xFF), "reset");
        assert_eq!(instruction(board("so1"), 0x77), "0x77");
    }

    #[test]
    fn whatever_data_comes_is_said_or_refused() {
        for board in BOARDS.iter().map(Some).chain([None]) {
            for code in 0..=255 {
                for len in 0..=255_usize {
                    let _ = answer(board, code, &vec![len as u8; len]);
                    let _ = request(board, code, &vec![code; len]);
                }
            }
        }
    }
}
