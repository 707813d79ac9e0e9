//! CRC-16 of Modbus RTU: polynomial 0x8005 reflected, first value 0xFFFF (catalogue: MODBUS). Its low byte is sent
//! first (Modbus over Serial Line V1.02, 2.5.1.2 and appendix B).

/// The checksum of `bytes`.
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |register, byte| (register >> 8) ^ TABLE[usize::from(register as u8 ^ byte)])
}

static TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut index = 0;
    while index < 256 {
        let mut register = index as u16;
        let mut bit = 0;
        while bit < 8 {
            register = (register >> 1) ^ if register & 1 == 0 { 0 } else { 0xA001 };
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
    fn the_check_values_are_met() {
        assert_eq!(crc16(b"123456789"), 0x4B37, "of the catalogue");
        assert_eq!(crc16(&[0x02, 0x07]), 0x1241, "of the specification, appendix B");
        assert_eq!(crc16(&[]), 0xFFFF);
    }
}
