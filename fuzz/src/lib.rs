//! Fuzz targets: parsers and engines with arbitrary input. Each target is a function of bytes that panics where the
//! code breaks a promise; libFuzzer calls it (`libfuzzer/`), and a test replays the kept inputs (`corpus/`).

#![forbid(unsafe_code)]
#![allow(clippy::unwrap_used, reason = "a target fails by panicking")]

use arbitrary::{Arbitrary, Unstructured};

mod lidars;

/// A target: its name, which is also its folder's in `corpus`, and the function.
pub type Target = (&'static str, fn(&[u8]));

macro_rules! targets {
    ($($name:ident,)*) => {
        $(mod $name; pub use self::$name::$name;)*

        /// Every target, by name.
        pub const TARGETS: &[Target] = &[$((stringify!($name), $name),)*];
    };
}

targets! {
    auxiliary,
    bridge,
    can_udp,
    canopen_eds,
    canopen_engines,
    canopen_io,
    canopen_node,
    canopen_sdo,
    config,
    estimator,
    exchange_engines,
    foxglove,
    gamepad,
    i2c_engines,
    imu_engines,
    inputs,
    lcm_codec,
    lcm_datagram,
    lcm_dynamic,
    lcm_eventlog,
    lcm_tcpq,
    lcm_types,
    lidar_hokuyo,
    lidar_ld,
    lidar_rplidar,
    lidar_sick,
    lidar_ydlidar,
    logs,
    messages,
    modbus_engines,
    modules,
    motorctl_engines,
    plan,
    ros,
    ros2,
    rs485_engines,
    rs485_line,
    rtps,
    web_command,
}

/// A value made from the bytes of an input. Bytes that are missing count as zeros.
fn input<'a, T: Arbitrary<'a>>(data: &'a [u8]) -> Option<T> {
    T::arbitrary_take_rest(Unstructured::new(data)).ok()
}
