//! I2C transfers, SMBus commands, a bit-banged master, and drivers of chips.
#![no_std]
#![forbid(unsafe_code)]
