//! Start-up and reading of the registers.

use super::register::*;
use super::*;
use crate::event::{Fault, Identity, LostReason, Sample};
use crate::shared::{Progress, Shared};
use base::Instant;
use base::i2c::{Address, Bytes, Error, Outcome, Read, Transfer};

/// Samples between two readings of the states.
const STATES_EVERY: u8 = 10;
/// Bytes from the acceleration to the end of the orientation.
const MOTION_LEN: u8 = QUA_DATA + 8 - ACC_DATA;
/// Bytes from the temperature to the operation mode.
const STATES_LEN: u8 = OPR_MODE + 1 - TEMP;
/// Registers that are written at the start-up, and the time after each.
const SETUP: [(u8, u8, Duration); 5] = [
    (PAGE_ID, 0, Duration::ZERO),
    (OPR_MODE, MODE_CONFIG, MODE_CHANGE),
    (UNIT_SEL, UNITS, Duration::ZERO),
    (PWR_MODE, 0, Duration::ZERO),
    (OPR_MODE, MODE_IMU, MODE_CHANGE),
];

/// What a transfer is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Identity,
    /// Write of this row of [`SETUP`].
    Setup(u8),
    Motion,
    States,
}

/// Protocol.
#[derive(Debug)]
pub(crate) struct Registers {
    address: Address,
    /// The next request, and when it is due.
    next: Option<(Request, Instant)>,
    /// The transfer under way, and when it was requested. One that was requested before a restart is `stale`.
    asked: Option<(Request, Instant)>,
    stale: bool,
    /// Samples since the states were read, and when the next one is due.
    samples: u8,
    due: Instant,
    temperature_c: f64,
}

impl Registers {
    pub fn new(address: Address) -> Self {
        Self { address, next: None, asked: None, stale: false, samples: 0, due: Instant::ZERO, temperature_c: f64::NAN }
    }

    pub fn start(&mut self, now: Instant) {
        self.stale = self.asked.is_some();
        self.next = Some((Request::Setup(0), now));
        (self.samples, self.due, self.temperature_c) = (0, now, f64::NAN);
    }

    /// The transfer under way has no outcome.
    pub fn forget(&mut self) {
        (self.asked, self.stale) = (None, false);
    }

    pub fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        let Some((request, _)) = self.next.filter(|(_, due)| self.asked.is_none() && *due <= now) else { return };
        self.next = None;
        self.asked = Some((request, now));
        shared.ask(self.transfer(request));
    }

    /// While a transfer is under way nothing is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.next.filter(|_| self.asked.is_none()).map(|(_, due)| due)
    }

    fn transfer(&self, request: Request) -> Transfer {
        let mut write = Bytes::new();
        let (bytes, read): (&[u8], _) = match request {
            Request::Identity => (&[CHIP_ID], Read::Exactly(PAGE_ID - CHIP_ID)),
            Request::Setup(row) => {
                let (register, value, _) = SETUP[usize::from(row)];
                (&[register, value], Read::None)
            }
            Request::Motion => (&[ACC_DATA], Read::Exactly(MOTION_LEN)),
            Request::States => (&[TEMP], Read::Exactly(STATES_LEN)),
        };
        write.extend(bytes.iter().copied());
        Transfer { address: self.address, write, read }
    }

    /// Takes the outcome of the transfer under way; that of one before a restart only ends it.
    pub fn handle_outcome(&mut self, now: Instant, outcome: &Outcome, awake: bool, shared: &mut Shared) -> Progress {
        let Some((request, since)) = self.asked.take() else { return Progress::Pending };
        if core::mem::take(&mut self.stale) || !awake {
            return Progress::Pending;
        }
        match outcome {
            Ok(read) => self.take(now, request, since, read, shared),
            Err(error) => {
                if *error == Error::NoAddress {
                    shared.miss();
                } else {
                    shared.reject();
                }
                self.again(now, request)
            }
        }
    }

    /// A measurement that failed is left out; a step of the start-up is tried again until its time limit.
    fn again(&mut self, now: Instant, request: Request) -> Progress {
        let request = if request == Request::States { Request::Motion } else { request };
        self.next = Some((request, now + PERIOD));
        Progress::Pending
    }

    fn take(&mut self, now: Instant, request: Request, since: Instant, read: &[u8], shared: &mut Shared) -> Progress {
        match request {
            Request::Setup(row) => {
                shared.accept();
                let next = match row {
                    0 => Request::Identity,
                    row if usize::from(row) + 1 < SETUP.len() => Request::Setup(row + 1),
                    _ => Request::States,
                };
                self.next = Some((next, now + SETUP[usize::from(row)].2));
            }
            Request::Identity => {
                let [chip, _, _, _, low, high, bootloader] = *read else { return self.short(now, request, shared) };
                shared.accept();
                if chip != CHIP {
                    return Progress::Lost(LostReason::Identity { chip });
                }
                shared.identify(Identity { firmware: [high, low], bootloader });
                self.next = Some((Request::Setup(1), now));
            }
            Request::Motion => {
                if read.len() != usize::from(MOTION_LEN) {
                    return self.short(now, request, shared);
                }
                shared.accept();
                self.sample(since, read, shared);
                self.samples += 1;
                self.due = since + PERIOD;
                self.next = match self.samples {
                    STATES_EVERY.. => Some((Request::States, now)),
                    _ => Some((Request::Motion, self.due)),
                };
            }
            Request::States => {
                let [temperature, calibration, _, _, _, status, error, units, _, mode] = *read else {
                    return self.short(now, request, shared);
                };
                shared.accept();
                if status == STATUS_ERROR {
                    return Progress::Lost(LostReason::Device { code: error });
                }
                // It restarted: what was written is lost.
                if mode & 0x0F != MODE_IMU || units != UNITS {
                    return Progress::Lost(LostReason::Incomplete);
                }
                self.temperature_c = f64::from(temperature.cast_signed());
                shared.fault(Fault::Uncalibrated, status == STATUS_FUSION && calibration >> 4 & 3 == 0);
                self.samples = 0;
                // Before the fusion runs all values are 0.
                self.next = match status {
                    STATUS_FUSION => Some((Request::Motion, self.due)),
                    _ => Some((Request::States, now + PERIOD)),
                };
            }
        }
        Progress::Pending
    }

    /// The adapter returned another number of bytes than requested.
    fn short(&mut self, now: Instant, request: Request, shared: &mut Shared) -> Progress {
        shared.reject();
        self.again(now, request)
    }

    fn sample(&mut self, at: Instant, read: &[u8], shared: &mut Shared) {
        let value = |register: u8, n: usize| {
            let at = usize::from(register - ACC_DATA) + 2 * n;
            f64::from(i16::from_le_bytes([read[at], read[at + 1]]))
        };
        let vector = |register, digit: f64| core::array::from_fn(|n| digit * value(register, n));
        let [w, x, y, z]: [f64; 4] = core::array::from_fn(|n| QUATERNION * value(QUA_DATA, n));
        shared.sample(Sample {
            at,
            status: crate::Status::Ok,
            acceleration_mps2: vector(ACC_DATA, ACCELERATION_MPS2),
            rotation_radps: vector(GYR_DATA, ROTATION_RADPS),
            orientation: crate::frame::Rotation::new([x, y, z, w]).map(crate::frame::Rotation::quaternion),
            temperature_c: self.temperature_c,
        });
    }
}
