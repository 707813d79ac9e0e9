//! CRC-16 with the polynomial 0x1021 and the first value 0, most significant bit first (catalogue: XMODEM). RoboClaw
//! and VESC use it.

/// The checksum of `bytes`, continued from `register`; 0 at first.
#[must_use]
pub fn crc16(register: u16, bytes: &[u8]) -> u16 {
    bytes.iter().fold(register, |register, byte| {
        let index = usize::from((register >> 8) as u8 ^ byte);
        (register << 8) ^ TABLE[index]
    })
}

static TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut index = 0;
    while index < 256 {
        let mut register = (index as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            register = (register << 1) ^ if register & 0x8000 == 0 { 0 } else { 0x1021 };
            bit += 1;
        }
        table[index] = register;
        index += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_value_of_the_catalogue_is_met() {
        assert_eq!(crc16(0, b"123456789"), 0x31C3);
        assert_eq!(crc16(crc16(0, b"1234"), b"56789"), 0x31C3);
        assert_eq!(crc16(0, &[]), 0);
    }
}
