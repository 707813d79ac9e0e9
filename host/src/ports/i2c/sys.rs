//! System calls of i2c-dev (linux/i2c-dev.h, i2c.h) and of the GPIO character device, version 2 (linux/gpio.h).
#![allow(unsafe_code)]

use base::Duration;
use base::gpio::Bias;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::libc;
use std::io;
use std::mem;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};

/// Plain transfers, `I2C_FUNC_I2C`.
pub const FUNC_I2C: libc::c_ulong = 0x0000_0001;
/// SMBus command that reads the byte of a register, which is required here.
pub const FUNC_READ_BYTE_DATA: libc::c_ulong = 0x0008_0000;
/// Reading blocks whose first byte is their length, `I2C_M_RECV_LEN`.
pub const FUNC_READ_BLOCK: libc::c_ulong = 0x0100_0000;

const I2C_SLAVE: libc::Ioctl = 0x0703;
const I2C_FUNCS: libc::Ioctl = 0x0705;
const I2C_RDWR: libc::Ioctl = 0x0707;
const I2C_SMBUS: libc::Ioctl = 0x0720;
const I2C_M_RD: u16 = 0x0001;
const I2C_M_RECV_LEN: u16 = 0x0400;

/// `struct i2c_msg`.
#[repr(C)]
struct Message {
    address: u16,
    flags: u16,
    length: u16,
    bytes: *mut u8,
}

/// `struct i2c_rdwr_ioctl_data`.
#[repr(C)]
struct Messages {
    messages: *mut Message,
    count: u32,
}

/// `struct i2c_smbus_ioctl_data`.
#[repr(C)]
struct Smbus {
    read: u8,
    command: u8,
    size: u32,
    data: *mut [u8; SMBUS_DATA],
}

/// Size of `union i2c_smbus_data`: a byte, a word in native byte order, or length and block.
pub const SMBUS_DATA: usize = 34;

/// Capabilities of the adapter.
pub fn functions(adapter: BorrowedFd<'_>) -> io::Result<libc::c_ulong> {
    let mut functions: libc::c_ulong = 0;
    // SAFETY: the kernel fills a live unsigned long.
    check(unsafe { libc::ioctl(adapter.as_raw_fd(), I2C_FUNCS, &raw mut functions) })?;
    Ok(functions)
}

/// Writes, then reads, in one transfer; without bytes to write it begins with the read. `block`: the first byte read is
/// the length of a block, which is surrounded by `block` bytes including itself; `read` has room for 32 more.
pub fn transfer(
    adapter: BorrowedFd<'_>,
    address: u8,
    write: Option<&mut [u8]>,
    read: Option<&mut [u8]>,
    block: Option<u8>,
) -> io::Result<()> {
    let message = |flags, bytes: &mut [u8]| Message {
        address: u16::from(address),
        flags,
        length: bytes.len() as u16,
        bytes: bytes.as_mut_ptr(),
    };
    let read = read.map(|read| match (block, read.first_mut()) {
        (Some(around), Some(first)) => {
            *first = around;
            message(I2C_M_RD | I2C_M_RECV_LEN, read)
        }
        _ => message(I2C_M_RD, read),
    });
    let mut messages: Vec<Message> = write.map(|write| message(0, write)).into_iter().chain(read).collect();
    let data = Messages { messages: messages.as_mut_ptr(), count: messages.len() as u32 };
    // SAFETY: the kernel reads `count` live messages; each has the address and the length of a slice that is borrowed
    // mutably until this returns, and with RECV_LEN the kernel checks that there is room for the longest block.
    check(unsafe { libc::ioctl(adapter.as_raw_fd(), I2C_RDWR, &raw const data) })
}

/// Executes one SMBus command; `size` is one of `I2C_SMBUS_*`.
pub fn smbus(
    adapter: BorrowedFd<'_>,
    address: u8,
    read: bool,
    command: u8,
    size: u32,
    data: &mut [u8; SMBUS_DATA],
) -> io::Result<()> {
    // SAFETY: plain numbers.
    check(unsafe { libc::ioctl(adapter.as_raw_fd(), I2C_SLAVE, libc::c_ulong::from(address)) })?;
    let smbus = Smbus { read: u8::from(read), command, size, data };
    // SAFETY: the kernel reads a live structure, and reads or fills its data, which has the size of the kernel's union.
    check(unsafe { libc::ioctl(adapter.as_raw_fd(), I2C_SMBUS, &raw const smbus) })
}

const LINES_MAX: usize = 64;
const ATTRIBUTES_MAX: usize = 10;
const NAME_SIZE: usize = 32;
const FLAG_USED: u64 = 1 << 0;
const FLAG_ACTIVE_LOW: u64 = 1 << 1;
const FLAG_INPUT: u64 = 1 << 2;
const FLAG_OUTPUT: u64 = 1 << 3;
const FLAG_EDGES: u64 = 1 << 4 | 1 << 5;
const FLAG_OPEN_DRAIN: u64 = 1 << 6;
const FLAG_PULL_UP: u64 = 1 << 8;
const FLAG_PULL_DOWN: u64 = 1 << 9;
const FLAG_BIAS_DISABLED: u64 = 1 << 10;
const ATTRIBUTE_VALUES: u32 = 2;
const ATTRIBUTE_DEBOUNCE: u32 = 3;
/// Size of `struct gpio_v2_line_event`.
pub const EVENT_SIZE: usize = 48;
/// Their `id`.
const EDGE_RISING: u32 = 1;
const EDGE_FALLING: u32 = 2;

/// `struct gpio_v2_line_config_attribute`.
#[repr(C)]
struct Attribute {
    id: u32,
    padding: u32,
    value: u64,
    mask: u64,
}

/// `struct gpio_v2_line_config`.
#[repr(C)]
struct Config {
    flags: u64,
    attributes_count: u32,
    padding: [u32; 5],
    attributes: [Attribute; ATTRIBUTES_MAX],
}

/// `struct gpio_v2_line_request`.
#[repr(C)]
struct Request {
    offsets: [u32; LINES_MAX],
    consumer: [u8; NAME_SIZE],
    config: Config,
    count: u32,
    event_buffer_size: u32,
    padding_2: [u32; 5],
    fd: i32,
}

/// `struct gpio_v2_line_values`.
#[repr(C)]
struct Values {
    bits: u64,
    mask: u64,
}

/// `struct gpio_v2_line_info`.
#[repr(C)]
struct Info {
    name: [u8; NAME_SIZE],
    consumer: [u8; NAME_SIZE],
    offset: u32,
    attributes_count: u32,
    flags: u64,
    attributes: [[u64; 2]; ATTRIBUTES_MAX],
    padding: [u32; 4],
}

const GET_INFO: libc::Ioctl = nix::request_code_readwrite!(0xB4, 0x05, size_of::<Info>()) as libc::Ioctl;
const GET_LINE: libc::Ioctl = nix::request_code_readwrite!(0xB4, 0x07, size_of::<Request>()) as libc::Ioctl;
const SET_CONFIG: libc::Ioctl = nix::request_code_readwrite!(0xB4, 0x0D, size_of::<Config>()) as libc::Ioctl;
const GET_VALUES: libc::Ioctl = nix::request_code_readwrite!(0xB4, 0x0E, size_of::<Values>()) as libc::Ioctl;
const SET_VALUES: libc::Ioctl = nix::request_code_readwrite!(0xB4, 0x0F, size_of::<Values>()) as libc::Ioctl;

/// State of a line.
pub struct LineInfo {
    /// Name on the chip; may be empty.
    pub name: String,
    /// Who holds it; empty: nobody.
    pub consumer: String,
    /// It is an output now.
    output: bool,
}

/// State of a line, which it does not change. `EINVAL`: the chip has fewer lines.
pub fn line_info(chip: BorrowedFd<'_>, line: u32) -> io::Result<LineInfo> {
    // SAFETY: all zeros is valid.
    let mut info: Info = unsafe { mem::zeroed() };
    info.offset = line;
    // SAFETY: the kernel reads and fills a live gpio_v2_line_info.
    check(unsafe { libc::ioctl(chip.as_raw_fd(), GET_INFO, &raw mut info) })?;
    let text = |bytes: [u8; NAME_SIZE]| {
        String::from_utf8_lossy(bytes.split(|byte| *byte == 0).next().unwrap_or_default()).into_owned()
    };
    let consumer = if info.flags & FLAG_USED != 0 { text(info.consumer) } else { String::new() };
    Ok(LineInfo { name: text(info.name), consumer, output: info.flags & FLAG_OUTPUT != 0 })
}

/// Requests lines of a GPIO chip as open-drain outputs, released; bit 0 of their values is the first line.
pub fn open_drain(chip: BorrowedFd<'_>, lines: [u32; 2]) -> io::Result<OwnedFd> {
    request(chip, &lines, b"advee i2c", config(FLAG_OUTPUT | FLAG_OPEN_DRAIN, Some([true; 2])))
}

/// Name under which the kernel lists a line requested by [`output`].
pub const STOP_CONSUMER: &str = "advee stop";

/// Requests a line as an output. One that is an output already keeps its level; another one becomes inactive.
pub fn output(chip: BorrowedFd<'_>, line: u32, active_low: bool) -> io::Result<OwnedFd> {
    let polarity = if active_low { FLAG_ACTIVE_LOW } else { 0 };
    // As it is: neither its direction nor its level changes.
    let fd = request(chip, &[line], STOP_CONSUMER.as_bytes(), config::<1>(polarity, None))?;
    // The kernel reads the direction from the chip when the line is requested.
    let driven = line_info(chip, line)?.output;
    let [active] = levels(fd.as_fd())?;
    let mut config = config(polarity | FLAG_OUTPUT, Some([driven && active]));
    // SAFETY: the kernel reads a live gpio_v2_line_config.
    check(unsafe { libc::ioctl(fd.as_raw_fd(), SET_CONFIG, &raw mut config) })?;
    Ok(fd)
}

/// Requests a line as an input with events for both edges, which are read without blocking.
pub fn input(chip: BorrowedFd<'_>, line: u32, active_low: bool, bias: Bias, debounce: Duration) -> io::Result<OwnedFd> {
    let bias = match bias {
        Bias::AsIs => 0,
        Bias::Disabled => FLAG_BIAS_DISABLED,
        Bias::PullUp => FLAG_PULL_UP,
        Bias::PullDown => FLAG_PULL_DOWN,
    };
    let polarity = if active_low { FLAG_ACTIVE_LOW } else { 0 };
    let mut config = config::<1>(FLAG_INPUT | FLAG_EDGES | bias | polarity, None);
    if !debounce.is_zero() {
        config.attributes_count = 1;
        config.attributes[0] = Attribute { id: ATTRIBUTE_DEBOUNCE, padding: 0, value: microseconds(debounce), mask: 1 };
    }
    let fd = request(chip, &[line], b"advee io", config)?;
    fcntl(&fd, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
    Ok(fd)
}

/// The member `debounce_period_us` of the union in an attribute: its first four bytes.
fn microseconds(time: Duration) -> u64 {
    let [a, b, c, d] = u32::try_from(time.as_micros()).unwrap_or(u32::MAX).to_ne_bytes();
    u64::from_ne_bytes([a, b, c, d, 0, 0, 0, 0])
}

/// The level after the edge of a `struct gpio_v2_line_event`: a time of eight bytes, then the kind of edge.
pub fn edge(event: &[u8]) -> Option<bool> {
    let id = event.get(8..12).filter(|_| event.len() == EVENT_SIZE)?;
    match u32::from_ne_bytes(id.try_into().ok()?) {
        EDGE_RISING => Some(true),
        EDGE_FALLING => Some(false),
        _ => None,
    }
}

fn config<const N: usize>(flags: u64, levels: Option<[bool; N]>) -> Config {
    // SAFETY: all zeros is valid: without attributes.
    let mut config: Config = unsafe { mem::zeroed() };
    config.flags = flags;
    if let Some(levels) = levels {
        let Values { bits, mask } = Values::of(levels);
        config.attributes_count = 1;
        config.attributes[0] = Attribute { id: ATTRIBUTE_VALUES, padding: 0, value: bits, mask };
    }
    config
}

fn request(chip: BorrowedFd<'_>, lines: &[u32], consumer: &[u8], config: Config) -> io::Result<OwnedFd> {
    // SAFETY: all zeros is a valid request, of no lines.
    let mut request: Request = unsafe { mem::zeroed() };
    request.offsets[..lines.len()].copy_from_slice(lines);
    request.consumer[..consumer.len()].copy_from_slice(consumer);
    request.config = config;
    request.count = lines.len() as u32;
    // SAFETY: the kernel reads and fills a live gpio_v2_line_request.
    check(unsafe { libc::ioctl(chip.as_raw_fd(), GET_LINE, &raw mut request) })?;
    // SAFETY: the kernel has just opened it for us; it belongs to nobody else.
    Ok(unsafe { OwnedFd::from_raw_fd(request.fd) })
}

impl Values {
    fn of<const N: usize>(levels: [bool; N]) -> Self {
        let bits = levels.iter().rev().fold(0, |bits, level| bits << 1 | u64::from(*level));
        Self { bits, mask: (1 << N) - 1 }
    }
}

/// Levels of the requested lines.
pub fn levels<const N: usize>(lines: BorrowedFd<'_>) -> io::Result<[bool; N]> {
    let mut values = Values::of([false; N]);
    // SAFETY: the kernel reads and fills a live gpio_v2_line_values.
    check(unsafe { libc::ioctl(lines.as_raw_fd(), GET_VALUES, &raw mut values) })?;
    Ok(std::array::from_fn(|n| values.bits >> n & 1 != 0))
}

/// Sets the level of each requested line; of an open-drain output true releases it, and false pulls it down.
pub fn set_levels<const N: usize>(lines: BorrowedFd<'_>, levels: [bool; N]) -> io::Result<()> {
    let mut values = Values::of(levels);
    // SAFETY: the kernel reads a live gpio_v2_line_values.
    check(unsafe { libc::ioctl(lines.as_raw_fd(), SET_VALUES, &raw mut values) })
}

fn check(result: libc::c_int) -> io::Result<()> {
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_have_the_sizes_of_the_kernel_s() {
        assert_eq!((size_of::<Attribute>(), size_of::<Request>(), size_of::<Values>()), (24, 592, 16));
        assert_eq!((size_of::<Config>(), size_of::<Info>()), (272, 256));
    }

    #[test]
    fn an_event_tells_the_level_and_anything_else_is_refused() {
        let mut event = [0; EVENT_SIZE];
        for (id, level) in [(0, None), (1_u32, Some(true)), (2, Some(false)), (3, None)] {
            event[8..12].copy_from_slice(&id.to_ne_bytes());
            assert_eq!(edge(&event), level);
        }
        event[8..12].copy_from_slice(&1_u32.to_ne_bytes());
        assert_eq!((edge(&event[..47]), edge(&[])), (None, None));
        assert_eq!(microseconds(Duration::from_millis(5)).to_ne_bytes()[..4], 5000_u32.to_ne_bytes());
    }

    #[test]
    fn the_first_line_is_the_lowest_bit() {
        let Values { bits, mask } = Values::of([true, false, true]);
        assert_eq!((bits, mask), (0b101, 0b111));
    }
}
