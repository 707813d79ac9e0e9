//! SDO abort codes (CiA 301 v4.02, Table 20). Manufacturers have codes of their own: `drives` names those of its
//! drives.

use core::fmt;

/// SDO abort code as on the wire. Codes without a name are kept.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Abort(pub u32);

macro_rules! aborts {
    ($($name:ident = $code:literal, $text:literal;)*) => {
        impl Abort {
            $(#[doc = concat!("Abort code: ", $text, ".")] pub const $name: Self = Self($code);)*

            /// All codes with a name, in ascending order.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// Meaning of the code; `unknown abort code` for one without a name.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self.0 { $($code => $text,)* _ => "unknown abort code" }
            }
        }
    };
}

aborts! {
    TOGGLE = 0x0503_0000, "toggle bit not alternated";
    TIMEOUT = 0x0504_0000, "SDO protocol timed out";
    UNKNOWN_COMMAND = 0x0504_0001, "unknown command specifier";
    BLOCK_SIZE = 0x0504_0002, "invalid block size";
    SEQUENCE = 0x0504_0003, "invalid sequence number";
    CRC = 0x0504_0004, "CRC error";
    OUT_OF_MEMORY = 0x0504_0005, "out of memory";
    UNSUPPORTED_ACCESS = 0x0601_0000, "unsupported access to an object";
    WRITE_ONLY = 0x0601_0001, "attempt to read a write-only object";
    READ_ONLY = 0x0601_0002, "attempt to write a read-only object";
    NO_OBJECT = 0x0602_0000, "object does not exist";
    NOT_MAPPABLE = 0x0604_0041, "object cannot be mapped to the PDO";
    PDO_LENGTH = 0x0604_0042, "mapping would exceed the PDO length";
    INCOMPATIBLE = 0x0604_0043, "parameter incompatibility";
    INTERNAL = 0x0604_0047, "internal incompatibility in the device";
    HARDWARE = 0x0606_0000, "access failed due to a hardware error";
    LENGTH = 0x0607_0010, "data type or length does not match";
    TOO_LONG = 0x0607_0012, "length too high";
    TOO_SHORT = 0x0607_0013, "length too low";
    NO_SUB_INDEX = 0x0609_0011, "sub-index does not exist";
    RANGE = 0x0609_0030, "value range exceeded";
    TOO_HIGH = 0x0609_0031, "value too high";
    TOO_LOW = 0x0609_0032, "value too low";
    MAX_BELOW_MIN = 0x0609_0036, "maximum less than minimum";
    NO_RESOURCE = 0x060A_0023, "resource not available";
    GENERAL = 0x0800_0000, "general error";
    CANNOT_STORE = 0x0800_0020, "data cannot be transferred or stored";
    LOCAL_CONTROL = 0x0800_0021, "data cannot be transferred because of local control";
    DEVICE_STATE = 0x0800_0022, "data cannot be transferred in the present device state";
    NO_DICTIONARY = 0x0800_0023, "no object dictionary";
    NO_DATA = 0x0800_0024, "no data available";
}

impl fmt::Display for Abort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (0x{:08X})", self.name(), self.0)
    }
}

impl fmt::Debug for Abort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn an_abort_says_name_and_code() {
        assert_eq!(Abort::NO_OBJECT.to_string(), "object does not exist (0x06020000)");
        assert_eq!(Abort(0x1234).to_string(), "unknown abort code (0x00001234)");
        assert!(Abort::ALL.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
