//! Draws from a stated seed.

use dynid_random::Random;

pub struct Draw(Random);

impl Draw {
    /// Those of an input: of this seed, of whatever `name` says, of this number.
    pub fn of(seed: u64, name: &str, number: u64) -> Self {
        // FNV-1a, whose bits are the same everywhere.
        let bytes = seed.to_le_bytes().into_iter().chain(name.bytes()).chain(number.to_le_bytes());
        let hash =
            bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        Self(Random::new(hash))
    }

    /// Below `count`; 0 of none.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.0.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    pub fn one_in(&mut self, count: usize) -> bool {
        self.below(count) == 0
    }

    pub fn of_these<'a, T>(&mut self, these: &'a [T]) -> &'a T {
        &these[self.below(these.len())]
    }

    pub fn copy_of<T: Copy>(&mut self, these: &[T]) -> T {
        *self.of_these(these)
    }

    pub fn normal(&mut self) -> f64 {
        self.0.normal()
    }

    pub fn byte(&mut self) -> u8 {
        self.below(256) as u8
    }

    /// Mostly small, at times up to `most`.
    pub fn size(&mut self, most: usize) -> usize {
        let power = self.0.unit().powi(3);
        1 + (power * most.saturating_sub(1) as f64) as usize
    }
}
