//! Synthetic clouds and streams.

use super::coupling::Place;

/// Seeded numbers, the same on every machine (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Evenly between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A point inside the unit ball.
    pub fn in_ball(&mut self) -> [f64; 3] {
        loop {
            let point = [(); 3].map(|()| self.between(-1.0, 1.0));
            if point.iter().map(|x| x * x).sum::<f64>() <= 1.0 {
                return point;
            }
        }
    }
}

/// `count` bubbles in a ball of radius `size`, radii log-uniform from `low` to `high` (all in m), apart where they can be.
pub fn ball(count: usize, size: f64, low: f64, high: f64, seed: u64) -> Vec<Place> {
    let mut random = Random::new(seed);
    let mut places: Vec<Place> = Vec::with_capacity(count);
    for _ in 0..count {
        let radius = low * (high / low).powf(random.unit());
        let mut place = Place {
            at: [0.0; 3],
            radius,
            depth: 0.0,
        };
        for _ in 0..2000 {
            let at = random.in_ball().map(|x| x * size);
            place = Place {
                at,
                radius,
                depth: 2.0 * size - at[1],
            };
            let apart = |other: &Place| {
                let square: f64 = (0..3).map(|i| (other.at[i] - at[i]).powi(2)).sum();
                square.sqrt() > other.radius + radius
            };
            if places.iter().all(apart) {
                break;
            }
        }
        places.push(place);
    }
    places
}
