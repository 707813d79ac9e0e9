//! CRC-16 of block transfers: x^16 + x^12 + x^5 + 1, start 0, most significant bit first (CiA 301, 9.2.2.2).

const TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut at = 0;
    while at < 256 {
        let (mut crc, mut bit) = ((at as u16) << 8, 0);
        while bit < 8 {
            crc = if crc & 0x8000 != 0 { crc << 1 ^ 0x1021 } else { crc << 1 };
            bit += 1;
        }
        table[at] = crc;
        at += 1;
    }
    table
};

/// The CRC of what had `crc` (0: nothing yet) and `data` behind it.
pub(super) fn update(crc: u16, data: &[u8]) -> u16 {
    data.iter().fold(crc, |crc, byte| crc << 8 ^ TABLE[usize::from((crc >> 8) as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::update;

    #[test]
    fn the_check_values_hold() {
        assert_eq!(update(0, b"123456789"), 0x31C3);
        assert_eq!(update(0, b"Position drive, simulated, with a long device name"), 0x6A15);
        assert_eq!(update(update(0, b"1234"), b"56789"), 0x31C3);
    }
}
