//! The one source of chance: seeded, the same on every machine.

/// What each number adds to the state.
const STEP: u64 = 0x9E37_79B9_7F4A_7C15;
/// Numbers that [`Random::normal`] adds.
const UNIFORMS_PER_NORMAL: u64 = 4;

/// SplitMix64 (Steele, Lea, Flood 2014): 64 bits of state, one multiplication chain a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// A sequence; equal seeds give equal sequences.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A sequence of its own for each `stream`, so that asking more here changes nothing there.
    #[must_use]
    pub fn stream(seed: u64, stream: u64) -> Self {
        let mut outer = Self(seed ^ stream.wrapping_mul(0xD1B5_4A32_D192_ED03));
        Self(outer.bits())
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Leaves out as many numbers as this many calls of [`Self::normal`] would take.
    pub fn skip_normals(&mut self, count: usize) {
        self.0 = self.0.wrapping_add(STEP.wrapping_mul(UNIFORMS_PER_NORMAL * count as u64));
    }

    /// A number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number of mean 0 and deviation 1, bell-shaped, never beyond ±3.5 (four uniform ones added: no logarithm).
    pub fn normal(&mut self) -> f64 {
        let sum = self.uniform() + self.uniform() + self.uniform() + self.uniform();
        (sum - 2.0) * 1.732_050_807_568_877_2
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.uniform() < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_published_sequence() {
        // First numbers of SplitMix64 from seed 1234567 (rosettacode.org, Pseudo-random numbers/Splitmix64).
        let mut random = Random::new(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn what_is_left_out_changes_nothing_after_it() {
        let mut all = Random::stream(7, 3);
        for count in [0, 1, 5, 719] {
            let mut left_out = all;
            (0..count).for_each(|_| {
                all.normal();
            });
            left_out.skip_normals(count);
            assert_eq!(left_out, all);
        }
    }

    #[test]
    fn the_bell_has_mean_0_and_deviation_1() {
        let mut random = Random::stream(7, 3);
        let n = 100_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let x = random.normal();
            sum += x;
            squares += x * x;
        }
        let n = f64::from(n);
        assert!((sum / n).abs() < 0.02 && (squares / n - 1.0).abs() < 0.02);
    }
}
