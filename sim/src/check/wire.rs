//! Drives as they are on the wire: where their commands and reports are.

/// Place in the frames of an identifier: bytes before a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The identifier.
    pub id: u16,
    /// Bytes before the value.
    pub at: usize,
}

/// A drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Node id.
    pub node: u8,
    /// The controlword in its RPDO.
    pub command: Place,
    /// Bytes before the target in that RPDO, 32 bits.
    pub target: usize,
    /// The statusword in each TPDO that has it.
    pub reports: Vec<Place>,
}

/// A driven wheel, or the driven axle.
#[derive(Clone, Debug, PartialEq)]
pub struct Wheel {
    /// Name of its axis: `propulsion`, `left`.
    pub name: String,
    /// Its drive.
    pub drive: Drive,
    /// Low byte of the controlword by which it stops.
    pub stop_word: u8,
    /// Target at 1 m/s.
    pub units_per_mps: f64,
}

impl Drive {
    /// Low byte of the controlword, and the target, of the data of its RPDO; `None`: too short.
    #[must_use]
    pub fn commanded(&self, data: &[u8]) -> Option<(u8, i32)> {
        let target = data.get(self.target..)?.first_chunk()?;
        Some((*data.get(self.command.at)?, i32::from_le_bytes(*target)))
    }

    /// Data of its RPDO with this low byte of the controlword and this target; the rest is 0.
    #[must_use]
    pub fn command(&self, controlword: u8, target: i32) -> Vec<u8> {
        let mut data = vec![0; (self.target + 4).max(self.command.at + 2)];
        data[self.command.at] = controlword;
        data[self.target..self.target + 4].copy_from_slice(&target.to_le_bytes());
        data
    }

    /// Statusword in a frame; `None`: it has none.
    #[must_use]
    pub fn reported(&self, id: u16, data: &[u8]) -> Option<u16> {
        let place = self.reports.iter().find(|place| place.id == id)?;
        Some(u16::from_le_bytes(*data.get(place.at..)?.first_chunk()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_where_the_mapping_has_them() {
        // Target first; the statusword behind a position.
        let drive = Drive {
            node: 1,
            command: Place { id: 0x201, at: 4 },
            target: 0,
            reports: vec![Place { id: 0x181, at: 0 }, Place { id: 0x281, at: 4 }],
        };
        let data = drive.command(0x0F, -1000);
        assert_eq!(data, [0x18, 0xFC, 0xFF, 0xFF, 0x0F, 0]);
        assert_eq!((drive.commanded(&data), drive.commanded(&data[..4])), (Some((0x0F, -1000)), None));
        assert_eq!(drive.reported(0x281, &[1, 2, 3, 4, 0x37, 0x92]), Some(0x9237));
        assert_eq!((drive.reported(0x281, &[1, 2, 3, 4, 0x37]), drive.reported(0x381, &data)), (None, None));
    }
}
