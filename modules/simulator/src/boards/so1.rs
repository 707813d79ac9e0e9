//! BR-SO1: the counters of the two front wheels.

use crate::scene::Scene;
use rs485::boards::so1::{GET_TICKS, RESET_TICKS, Ticks, build_ticks};
use rs485::slave::Asked;
use rs485::{Data, frame::Status};

/// A few millimetres before sixteen bits wrap.
const NEAR_WRAP: i64 = 32_700;

/// The board.
#[derive(Debug, Default)]
pub struct So1 {
    /// The body's counts at the last reset.
    zero: (i64, i64),
    /// Counts of a stuck encoder.
    stuck: Option<(i64, i64)>,
}

impl So1 {
    /// A board that is switched on now.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self { zero: scene.body().ticks(), stuck: None }
    }

    /// Stops the encoders, or releases them without the missed counts.
    pub fn stick(&mut self, stuck: bool, scene: &Scene) {
        let now = scene.body().ticks();
        match (stuck, self.stuck.take()) {
            (true, before) => self.stuck = before.or(Some(now)),
            (false, Some(at)) => {
                self.zero = (self.zero.0 + now.0 - at.0, self.zero.1 + now.1 - at.1);
            }
            (false, None) => {}
        }
    }

    /// Puts the counters just before their wrap: forward it comes in a moment.
    pub fn wrap(&mut self, scene: &Scene) {
        let (left, right) = scene.body().ticks();
        self.zero = (left - NEAR_WRAP, right - NEAR_WRAP);
    }

    /// Answers a request.
    pub fn answer(&mut self, asked: &Asked, scene: &Scene) -> (Status, Data) {
        let counts = self.stuck.unwrap_or(scene.body().ticks());
        match asked.instruction {
            code if code == GET_TICKS.code => {
                // Sixteen bits of them, wrapping.
                let (left, right) = (counts.0 - self.zero.0, counts.1 - self.zero.1);
                let ticks: Ticks = [left as i16, right as i16].into_iter().collect();
                (Status::Ok, build_ticks(&ticks).into_iter().collect())
            }
            code if code == RESET_TICKS.code => {
                self.zero = counts;
                (Status::Ok, Data::new())
            }
            _ => (Status::UnknownInstruction, Data::new()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::World;
    use base::Instant;

    fn ask(board: &mut So1, code: u8, scene: &Scene) -> Vec<u8> {
        let asked = Asked { instruction: code, data: Data::new(), answered: true };
        board.answer(&asked, scene).1.to_vec()
    }

    fn ticks(board: &mut So1, scene: &Scene) -> [i16; 2] {
        let bytes = ask(board, 0x01, scene);
        [i16::from_le_bytes([bytes[0], bytes[1]]), i16::from_le_bytes([bytes[2], bytes[3]])]
    }

    fn drive(scene: &mut Scene, metres: f64) {
        let end = scene.body().travelled() + metres;
        scene.demand.wheels[0] = Some(1.0);
        while scene.body().travelled() < end {
            scene.step();
        }
    }

    #[test]
    fn counts_are_relative_to_the_reset_and_wrap() {
        let mut scene = Scene::new(Instant::ZERO, World::default(), Parameters::default(), Sonar::default(), 1);
        let mut board = So1::new(&scene);
        drive(&mut scene, 1.0);
        let per_metre = 4096.0 / 0.628_318_530_717_958_6;
        let expected = (scene.body().travelled() * per_metre) as i16;
        assert_eq!(ticks(&mut board, &scene), [expected; 2]);
        drive(&mut scene, 5.0);
        let wrapped = (scene.body().travelled() * per_metre) as i64;
        assert!(wrapped > 32_767 && ticks(&mut board, &scene) == [wrapped as i16; 2]);
        assert_eq!(ask(&mut board, 0x02, &scene), []);
        assert_eq!(ticks(&mut board, &scene), [0, 0]);
    }

    #[test]
    fn a_counter_just_before_its_wrap_wraps_soon() {
        let mut scene = Scene::new(Instant::ZERO, World::default(), Parameters::default(), Sonar::default(), 1);
        let mut board = So1::new(&scene);
        board.wrap(&scene);
        assert_eq!(ticks(&mut board, &scene), [32_700; 2]);
        drive(&mut scene, 0.1);
        assert!(ticks(&mut board, &scene)[0] < -32_000);
    }

    #[test]
    fn a_stuck_encoder_stands_and_then_goes_on_from_there() {
        let mut scene = Scene::new(Instant::ZERO, World::default(), Parameters::default(), Sonar::default(), 1);
        let mut board = So1::new(&scene);
        drive(&mut scene, 1.0);
        let before = ticks(&mut board, &scene);
        board.stick(true, &scene);
        drive(&mut scene, 1.0);
        assert_eq!(ticks(&mut board, &scene), before);
        board.stick(false, &scene);
        assert_eq!(ticks(&mut board, &scene), before);
        drive(&mut scene, 0.5);
        assert!(ticks(&mut board, &scene)[0] > before[0] + 3000);
    }
}
