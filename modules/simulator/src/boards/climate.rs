//! How warm it is inside the robot: the box with its electronics, the drives, the battery. A lump each, warmed by what
//! is turned into heat there, cooled by what air passes.

/// Around the robot, °C.
const AMBIENT_C: f64 = 22.0;

/// A lump: heat capacity J/K, conductance W/K with the fans at rest, and what full fans add.
struct Lump(f64, f64, f64);

const BOX: Lump = Lump(500.0, 0.6, 2.4);
const DRIVES: Lump = Lump(900.0, 1.0, 1.5);
const BATTERY: Lump = Lump(30_000.0, 0.8, 0.0);
/// W in the box.
const ELECTRONICS_W: f64 = 18.0;
/// W in the drives at rest, and for each m/s.
const DRIVES_W: (f64, f64) = (4.0, 60.0);
const BATTERY_W: (f64, f64) = (1.0, 6.0);

/// Temperatures, °C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Climate {
    pub box_c: f64,
    pub drives_c: f64,
    pub battery_c: f64,
}

impl Default for Climate {
    /// A robot that has been on and standing for a while.
    fn default() -> Self {
        Self { box_c: 36.0, drives_c: 25.0, battery_c: 23.0 }
    }
}

impl Climate {
    /// Advances by a second, at this speed, m/s, with this fraction of the fans' air.
    pub fn second(&mut self, speed_mps: f64, flow: f64) {
        let moves = speed_mps.abs();
        warm(&mut self.box_c, &BOX, ELECTRONICS_W, flow);
        warm(&mut self.drives_c, &DRIVES, DRIVES_W.0 + DRIVES_W.1 * moves, flow);
        warm(&mut self.battery_c, &BATTERY, BATTERY_W.0 + BATTERY_W.1 * moves, flow);
    }
}

fn warm(celsius: &mut f64, Lump(capacity, rest, more): &Lump, watts: f64, flow: f64) {
    *celsius += (watts - (*celsius - AMBIENT_C) * (rest + more * flow)) / capacity;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn driving_warms_the_drives_and_air_cools_the_box() {
        let after = |seconds, speed, flow| {
            let mut climate = Climate::default();
            (0..seconds).for_each(|_| climate.second(speed, flow));
            climate
        };
        let (calm, hot) = (after(7200, 0.0, 0.2), after(7200, 0.0, 0.0));
        assert!((38.0..40.0).contains(&calm.box_c) && (51.0..53.0).contains(&hot.box_c), "{calm:?} {hot:?}");
        let driven = after(7200, 0.8, 0.2);
        assert!(driven.drives_c > 55.0 && driven.battery_c > calm.battery_c && driven.box_c == calm.box_c);
    }
}
