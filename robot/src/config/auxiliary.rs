//! `[i2c.<bus>]` and `[w1]`: fan controllers and thermometers.

use base::w1::Rom;
use settings::Table;
use std::path::PathBuf;

/// `[i2c.<bus>]`.
#[derive(Clone, Debug, PartialEq)]
pub struct I2cBus {
    /// `aux`.
    pub name: String,
    /// Where it is found.
    pub place: I2cPlace,
    /// 1000..=1 000 000 Hz; default 100 000. What a kernel's adapter runs at is its own affair.
    pub hz: u32,
    /// Whether every transfer is sent as `LL_DATA_RAW_<BUS>`; default false.
    pub raw: bool,
    /// What is on it.
    pub chips: Vec<I2cChip>,
}

/// Where an I2C bus is found: key `bus`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum I2cPlace {
    /// An adapter of the kernel's: `/dev/i2c-1`.
    Dev(PathBuf),
    /// Two lines of a GPIO chip: `gpio:/dev/gpiochip0:SDA:SCL`, the lines by their numbers.
    Gpio {
        /// The chip's device file.
        chip: PathBuf,
        /// The data line.
        sda: u32,
        /// The clock line.
        scl: u32,
    },
    /// The simulator's socket: `unix:PATH`; a relative path lies in the run folder.
    Socket(PathBuf),
}

/// `[[i2c.<bus>.chips]]`: a MAX6615, driver `max6615`.
#[derive(Clone, Debug, PartialEq)]
pub struct I2cChip {
    /// What messages and reports call it: `fan1`.
    pub name: String,
    /// Seven bits, 0x08..=0x77.
    pub address: u8,
    /// Its two temperatures, by their channels; none: not used.
    pub temperatures: [Option<I2cTemperature>; 2],
    /// Its two fans, by their outputs; none: not there.
    pub fans: [Option<I2cFan>; 2],
    /// Channel 2 is the chip itself and no second thermistor; default true.
    pub internal: bool,
    /// An automatic fan runs with its least duty while it is cool, too; default true.
    pub always: bool,
    /// The fans have an input for 35 kHz; else their supply is switched at 33 Hz; default false.
    pub pwm_35_khz: bool,
}

/// `temperatures = [{ … }]` of a chip.
#[derive(Clone, Debug, PartialEq)]
pub struct I2cTemperature {
    /// `box`.
    pub name: String,
    /// Above it there is an over-temperature, 1..=150 °C.
    pub limit_c: u8,
    /// From here on fans that follow it run, 0..=150 °C; default 35.
    pub start_c: u8,
}

/// `fans = [{ … }]` of a chip.
#[derive(Clone, Debug, PartialEq)]
pub struct I2cFan {
    /// `fan_left`.
    pub name: String,
    /// The temperatures that it follows, by their channels; none: it has a fixed duty.
    pub follows: [bool; 2],
    /// From the start temperature on, or always where it follows none, 0..=1; default 0.2.
    pub duty: f64,
    /// At most, 0..=1; default 1.
    pub duty_max: f64,
    /// More for each degree above the start temperature, 0..=0.0625; default 0.04.
    pub duty_per_c: f64,
    /// Slower than this it has failed, 230..=57 600 rpm; 0: it is not watched; default 400.
    pub rpm_min: f64,
}

/// `[w1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct W1 {
    /// Where the kernel has its thermometers; default `/sys/bus/w1/devices`. A relative path lies in the run folder.
    pub folder: PathBuf,
    /// Those that have names.
    pub sensors: Vec<W1Sensor>,
}

/// `sensors = [{ … }]` of `[w1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct W1Sensor {
    /// What the kernel calls it: `28-0316a2795bff`.
    pub id: Rom,
    /// What messages and reports call it.
    pub name: String,
    /// Above it there is an over-temperature, -50..=125 °C; default none.
    pub limit_c: Option<f64>,
}

impl I2cPlace {
    /// As `robot.toml` and the command line have it; none when it is no place of a bus.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        if let Some(path) = text.strip_prefix("unix:") {
            return (!path.is_empty()).then(|| Self::Socket(path.into()));
        }
        let Some(gpio) = text.strip_prefix("gpio:") else {
            return text.starts_with('/').then(|| Self::Dev(text.into()));
        };
        let mut parts = gpio.rsplitn(3, ':');
        let (scl, sda, chip) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?);
        (chip.starts_with('/') && sda != scl).then(|| Self::Gpio { chip: chip.into(), sda, scl })
    }
}

impl I2cBus {
    pub(super) fn read(name: String, mut table: Table<'_>) -> Self {
        let text = table.text("bus", None);
        let place = I2cPlace::parse(&text).unwrap_or_else(|| {
            if !text.is_empty() {
                table.refuse("bus", r#""/dev/i2c-1", "gpio:/dev/gpiochip0:SDA:SCL", or "unix:PATH""#);
            }
            I2cPlace::Dev(PathBuf::new())
        });
        let hz = table.integer("hz", Some(100_000), 1000..=1_000_000);
        let raw = table.boolean("raw", false);
        let mut chips: Vec<I2cChip> = Vec::new();
        for mut item in table.tables("chips") {
            let chip = I2cChip::read(&mut item);
            if chips.iter().any(|other| other.address == chip.address) {
                item.refuse("address", "one that no other chip of the bus has");
            }
            if chips.iter().any(|other| other.name == chip.name) {
                item.refuse("name", "one that no other chip of the bus has");
            }
            item.end();
            chips.push(chip);
        }
        table.end();
        Self { name, place, hz, raw, chips }
    }
}

impl I2cChip {
    fn read(table: &mut Table<'_>) -> Self {
        let address = table.integer("address", None, 0x08..=0x77);
        table.choice("driver", None, &[("max6615", ())]);
        let mut temperatures = [None, None];
        for mut item in table.tables("temperatures") {
            let channel = usize::from(item.integer::<u8>("channel", None, 1..=2));
            let temperature = I2cTemperature {
                name: item.text("name", None),
                limit_c: item.integer("limit_c", None, 1..=150),
                start_c: item.integer("start_c", Some(35), 0..=150),
            };
            if temperatures[channel - 1].replace(temperature).is_some() {
                item.refuse("channel", "one that no other temperature of the chip has");
            }
            item.end();
        }
        let mut fans = [None, None];
        for mut item in table.tables("fans") {
            let output = usize::from(item.integer::<u8>("output", None, 1..=2));
            let fan = I2cFan::read(&mut item, &temperatures);
            if fans[output - 1].replace(fan).is_some() {
                item.refuse("output", "one that no other fan of the chip has");
            }
            item.end();
        }
        Self {
            name: table.text("name", Some(&format!("max6615_{address:02x}"))),
            address,
            temperatures,
            fans,
            internal: table.boolean("internal", true),
            always: table.boolean("always", true),
            pwm_35_khz: table.boolean("pwm_35_khz", false),
        }
    }
}

impl I2cFan {
    fn read(table: &mut Table<'_>, temperatures: &[Option<I2cTemperature>; 2]) -> Self {
        let mut follows = [false; 2];
        for name in table.texts("follows") {
            let channel = temperatures.iter().position(|known| known.as_ref().is_some_and(|known| known.name == name));
            match channel {
                Some(channel) => follows[channel] = true,
                None => table.refuse("follows", "names of temperatures of this chip"),
            }
        }
        let rpm_min = table.number("rpm_min", Some(400.0), 0.0..=57_600.0);
        if rpm_min != 0.0 && rpm_min < 230.0 {
            table.refuse("rpm_min", "0, or a number from 230 to 57600");
        }
        Self {
            name: table.text("name", None),
            follows,
            duty: table.number("duty", Some(0.2), 0.0..=1.0),
            duty_max: table.number("duty_max", Some(1.0), 0.0..=1.0),
            duty_per_c: table.number("duty_per_c", Some(0.04), 0.0..=0.0625),
            rpm_min,
        }
    }
}

impl W1 {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let folder = PathBuf::from(table.text("folder", Some("/sys/bus/w1/devices")));
        let mut sensors: Vec<W1Sensor> = Vec::new();
        for mut item in table.tables("sensors") {
            let text = item.text("id", None);
            let (name, limit) = (item.text("name", Some(&text)), item.has("limit_c"));
            let limit_c = item.number("limit_c", Some(125.0), -50.0..=125.0);
            let limit_c = limit.then_some(limit_c);
            let Some(id) = Rom::parse(&text).filter(|id| id.is_thermometer()) else {
                item.refuse("id", "a thermometer as the kernel names it: \"28-0316a2795bff\"");
                item.end();
                continue;
            };
            let sensor = W1Sensor { id, name, limit_c };
            if sensors.iter().any(|other| other.id == sensor.id) {
                item.refuse("id", "one that no other of the sensors has");
            }
            if sensors.len() >= base::w1::MAX {
                item.refuse("id", format_args!("no more than {} sensors", base::w1::MAX));
            }
            item.end();
            sensors.push(sensor);
        }
        table.end();
        Self { folder, sensors }
    }
}
