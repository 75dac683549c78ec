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

/// A law of bubble radii.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Law {
    /// As many in each ratio
    Log,
    /// As many in each millimetre
    Flat,
    /// Breaking waves (Deane and Stokes): density r^−1.5 below 1 mm, r^−10/3 above
    Waves,
}

impl Law {
    /// A radius from `low` to `high` metres.
    pub fn draw(self, low: f64, high: f64, random: &mut Random) -> f64 {
        match self {
            Self::Log => low * (high / low).powf(random.unit()),
            Self::Flat => random.between(low, high),
            Self::Waves => {
                // Inverse of the distribution, piece by piece; densities meet at 1 mm.
                let piece = |a: f64, b: f64, power: f64| {
                    (a.powf(1.0 - power) - b.powf(1.0 - power)) / (power - 1.0)
                };
                const HINGE: f64 = 1e-3;
                let (fine, coarse): (f64, f64) = (1.5, 10.0 / 3.0);
                let join = HINGE.powf(coarse - fine);
                let below = if low < HINGE {
                    piece(low, high.min(HINGE), fine)
                } else {
                    0.0
                };
                let above = if high > HINGE {
                    join * piece(low.max(HINGE), high, coarse)
                } else {
                    0.0
                };
                let at = random.unit() * (below + above);
                let (from, power, rest) = if at < below {
                    (low, fine, at)
                } else {
                    (low.max(HINGE), coarse, (at - below) / join)
                };
                (from.powf(1.0 - power) - rest * (power - 1.0))
                    .powf(1.0 / (1.0 - power))
                    .clamp(low, high)
            }
        }
    }
}

/// What a stream is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stream {
    /// s.
    pub seconds: f64,
    /// Bubbles entrained a second.
    pub rate: f64,
    /// Radii, m.
    pub radius: [f64; 2],
    /// How they are spread.
    pub law: Law,
    /// Width, height and depth of the region of births, m; its upper face is the surface, y = 0.
    pub region: [f64; 3],
    /// How fast they rise, m/s.
    pub rise: f64,
    /// Mean life, s; nobody lives past the surface.
    pub life: f64,
    /// Part of the bubbles that end by splitting in two.
    pub split: f64,
    /// Part of the bubbles that end by merging with the one born before.
    pub merge: f64,
    /// Sample spacing of the file, s.
    pub step: f64,
    /// The same seed gives the same stream.
    pub seed: u64,
}

/// Writes a stream as bubble tracks ([`super::tracks`]), in flat memory; how many bubbles.
///
/// # Errors
/// What cannot be written.
pub fn write_stream(stream: &Stream, out: &mut impl std::io::Write) -> std::io::Result<u64> {
    let mut random = Random::new(stream.seed);
    writeln!(out, "# freshet cloud, seed {}", stream.seed)?;
    let mut id = 0;
    let mut time = 0.0;
    // A bubble that waits for the next one, to merge with it.
    let mut waiting: Option<Life> = None;
    loop {
        time += -(1.0 - random.unit()).ln() / stream.rate;
        if time >= stream.seconds {
            break;
        }
        let radius = stream
            .law
            .draw(stream.radius[0], stream.radius[1], &mut random);
        let [width, height, depth] = stream.region;
        let life = Life {
            id,
            radius,
            start: time,
            end: 0.0,
            at: [
                random.between(-width / 2.0, width / 2.0),
                random.between(-height, 0.0),
                random.between(-depth / 2.0, depth / 2.0),
            ],
        }
        .ending(stream, &mut random);
        id += 1;
        if let Some(first) = waiting.take() {
            // Both end together, in a bubble of their whole volume.
            let end = first.end.max(life.start + 2.0 * stream.step);
            let radius = (first.radius.powi(3) + life.radius.powi(3)).cbrt();
            let (a, b) = (Life { end, ..first }, Life { end, ..life });
            a.write(stream, "N", &[], 'M', &[id], out)?;
            b.write(stream, "N", &[], 'M', &[id], out)?;
            let (heir, other) = if a.radius >= b.radius { (a, b) } else { (b, a) };
            Life {
                id,
                radius,
                start: end,
                end: 0.0,
                at: heir.position(stream, end),
            }
            .ending(stream, &mut random)
            .write(stream, "M", &[heir.id, other.id], 'C', &[], out)?;
            id += 1;
            continue;
        }
        let fate = random.unit();
        if fate < stream.merge {
            waiting = Some(life);
        } else if fate < stream.merge + stream.split && life.end - life.start > 2.0 * stream.step {
            life.write(stream, "N", &[], 'S', &[id, id + 1], out)?;
            let share = random.between(0.1, 0.5);
            for part in [1.0 - share, share] {
                let mut at = life.position(stream, life.end);
                at[0] += random.between(-1.0, 1.0) * life.radius;
                at[2] += random.between(-1.0, 1.0) * life.radius;
                Life {
                    id,
                    radius: life.radius * f64::cbrt(part),
                    start: life.end,
                    end: 0.0,
                    at,
                }
                .ending(stream, &mut random)
                .write(stream, "S", &[life.id], 'C', &[], out)?;
                id += 1;
            }
        } else {
            life.write(stream, "N", &[], 'C', &[], out)?;
        }
    }
    if let Some(life) = waiting {
        life.write(stream, "N", &[], 'C', &[], out)?;
    }
    Ok(id)
}

/// One bubble of a stream.
#[derive(Clone, Copy)]
struct Life {
    id: u64,
    radius: f64,
    start: f64,
    end: f64,
    /// Where it starts.
    at: [f64; 3],
}

impl Life {
    fn ending(mut self, stream: &Stream, random: &mut Random) -> Self {
        let life = -(1.0 - random.unit()).ln() * stream.life;
        let to_surface = if stream.rise > 0.0 {
            -self.at[1].min(0.0) / stream.rise
        } else {
            f64::INFINITY
        };
        self.end = self.start + life.clamp(1e-3, to_surface.max(1e-3));
        self
    }

    fn position(&self, stream: &Stream, time: f64) -> [f64; 3] {
        let y = self.at[1] + stream.rise * (time - self.start);
        [self.at[0], y.min(0.0), self.at[2]]
    }

    fn write(
        &self,
        stream: &Stream,
        start: &str,
        parents: &[u64],
        end: char,
        children: &[u64],
        out: &mut impl std::io::Write,
    ) -> std::io::Result<()> {
        let list = |ids: &[u64]| ids.iter().map(|id| format!(" {id}")).collect::<String>();
        writeln!(out, "Bub {} {:.6e}", self.id, self.radius)?;
        writeln!(out, "  Start: {start} {:.7}{}", self.start, list(parents))?;
        let hertz = super::step::Tone::of_radius(self.radius).omega0 / std::f64::consts::TAU;
        let mut time = self.start;
        loop {
            let [x, y, z] = self.position(stream, time);
            let inside = freshet::bubble::P0 + 2.0 * freshet::bubble::SIGMA / self.radius;
            writeln!(
                out,
                "  {time:.7} {hertz:.3} {x:.6} {y:.6} {z:.6} {inside:.1} {:.6}",
                -y
            )?;
            time += stream.step;
            // Bubbles that stand still need no second sample.
            if time > self.end || stream.rise == 0.0 {
                break;
            }
        }
        writeln!(out, "  End: {end} {:.7}{}", self.end, list(children))
    }
}
