//! One voice: which of its blocks are calm, and all that may be in the others.

use core::ops::Range;

use crate::fixed::{high, mul_high, soft_attack};
use crate::frame::BLOCK;
use crate::kernel::voice::{ATTACK_END, Ears, PLAIN_MAX, Run, Tone, sing};
use crate::resonator::PITCH_LIMIT;

/// A rising bubble fades from this part of the sample rate, down to nothing at [`PITCH_LIMIT`].
pub const RISE_FADE: f64 = 0.42;

/// Envelopes end 102 dB below where they began, if not before.
pub const ENVELOPE_FLOOR: u32 = 1 << (31 - 17);
const EDGE_START: u32 = (RISE_FADE * 4_294_967_296.0) as u32;
const EDGE_END: u32 = (PITCH_LIMIT * 4_294_967_296.0) as u32;

/// Blocks in which a stolen voice fades out: 4 ms at 48 kHz.
const STEAL_BLOCKS: usize = 6;
const STEAL_FRAMES: usize = STEAL_BLOCKS * BLOCK;
/// From 1 to 0 with no corner: x²(3 − 2x), Q27.
static STEAL: [i32; STEAL_FRAMES] = {
    let mut steal = [0; STEAL_FRAMES];
    let mut i = 0;
    while i < STEAL_FRAMES {
        let (x, all) = ((STEAL_FRAMES - 1 - i) as u64, (STEAL_FRAMES - 1) as u64);
        let part = ((x * x * (3 * all - 2 * x)) << 27) / (all * all * all);
        steal[i] = if part < 1 << 27 {
            part as i32
        } else {
            EDGE_FULL
        };
        i += 1;
    }
    steal
};

/// All of what [`to_edge`] gives.
const EDGE_FULL: i32 = (1 << 27) - 1;

/// One sounding bubble.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Voice {
    pub(crate) tone: Tone,
    /// Growth of turns a sample, a sample, Q64.
    pub(super) slope: u64,
    /// Turns a sample at the cap, Q64.
    pub(super) limit: u64,
    /// Samples from the end of the calm blocks to the cap, Q32.32.
    pub(super) ramp: u64,
    /// Frames until the first sample.
    pub(super) delay: u32,
    /// 1 and the blocks since it was stolen; 0: it was not.
    pub(super) fade: u32,
}

fn upper(x: u64) -> u32 {
    (x >> 32) as u32
}

impl Voice {
    /// Not in use.
    pub const IDLE: Self = Self {
        tone: Tone::OVER,
        slope: 0,
        limit: 0,
        ramp: 0,
        delay: 0,
        fade: 0,
    };

    /// Whether it fades already.
    pub fn is_stolen(&self) -> bool {
        self.fade > 0
    }

    /// Whether it sounds, and does not fade yet.
    pub fn may_be_stolen(&self) -> bool {
        self.delay == 0 && self.fade == 0 && self.tone.level() < PLAIN_MAX
    }

    /// Fades out from the next block on, and rises no more.
    pub fn steal(&mut self) {
        let tone = &mut self.tone;
        tone.pitch -= tone.growth / 2;
        let pitch = upper(tone.pitch);
        if self.slope != 0 && pitch > EDGE_START {
            // As soft as it has become at the edge of the band.
            let part = to_edge(EDGE_END.saturating_sub(pitch)) << 4;
            tone.gain = tone.gain.map(|gain| mul_high(gain, part) << 1);
            tone.loudest = high(tone.loudest, part as u32) << 1;
        }
        (tone.growth, self.slope, self.ramp) = (0, 0, 0);
        self.tone.calm = 0;
        self.fade = 1;
    }

    /// Adds the next block of a stolen voice. True while there is more to come.
    #[inline(never)]
    pub fn fade(&mut self, out: &mut Ears) -> bool {
        let begin = (self.fade as usize - 1) * BLOCK;
        let Some(parts) = STEAL.get(begin..begin + BLOCK) else {
            return false;
        };
        let tone = &mut self.tone;
        let mut run = Run {
            phase: (tone.phase >> 27) as u32,
            step: upper(tone.pitch),
            slope: 0,
            gain: tone.gain,
            decay: tone.decay,
            envelope: tone.envelope as i32,
        };
        let mut parts = parts.iter();
        let mut part = || parts.next().copied().unwrap_or(0);
        if run.envelope < ATTACK_END {
            out.add(0..BLOCK, || {
                let shape = mul_high(run.envelope, part());
                run.next(shape)
            });
        } else {
            out.add(0..BLOCK, || {
                let shape = if run.envelope < ATTACK_END {
                    run.envelope >> 5
                } else {
                    soft_attack(run.envelope)
                };
                run.next(mul_high(shape << 4, part() << 4) >> 3)
            });
        }
        tone.envelope = tone.faded(BLOCK);
        tone.phase = tone.phase.wrapping_add(tone.pitch);
        self.fade += 1;
        self.fade as usize <= STEAL_BLOCKS && !self.tone.is_over()
    }

    /// Adds a block that is not calm. True while there is more to come.
    #[inline(never)]
    pub fn render(&mut self, out: &mut Ears) -> bool {
        if self.delay >= BLOCK as u32 {
            self.delay -= BLOCK as u32;
            return true;
        }
        let begin = core::mem::take(&mut self.delay) as usize;
        // From the middle of the block back to its begin.
        self.tone.pitch -= self.tone.growth / 2;
        self.tone.growth = 0;
        let ramping = upper(self.ramp).min((BLOCK - begin) as u32);
        let steady = begin + ramping as usize;
        if ramping > 0 {
            let edge = begin + ramping.min(self.frames_to_edge()) as usize;
            let ahead = self.slope / 2;
            self.run(out, begin..edge, ahead, self.slope);
            self.run(out, edge..steady, ahead, self.slope);
            self.ramp -= samples(ramping);
        }
        let mut flat = steady;
        if steady < BLOCK && self.ramp > 0 {
            // The sample in which the ramp ends: ∫ = limit − slope·f²/2.
            let (slope, f) = (upper(self.slope), self.ramp as u32);
            let missing = u64::from(high(high(slope, f), f)) << 31;
            self.tone.pitch = self.limit - u64::from(slope) * u64::from(f);
            self.ramp = 0;
            flat += 1;
            let ahead = self.limit - missing - self.tone.pitch;
            self.run(out, steady..flat, ahead, 0);
            self.tone.pitch = self.limit;
        }
        if self.slope != 0 && self.ramp == 0 && upper(self.tone.pitch) >= EDGE_END {
            // Past the fade at the edge of the band.
            return false;
        }
        self.run(out, flat..BLOCK, 0, 0);
        self.calm();
        !self.tone.is_over()
    }

    /// Counts the blocks to come that need nothing but the tone.
    fn calm(&mut self) {
        let pitch = upper(self.tone.pitch);
        if self.tone.level() >= PLAIN_MAX {
            return;
        }
        if self.ramp == 0 {
            if self.slope == 0 || pitch <= EDGE_START {
                self.tone.calm = u32::MAX;
            }
            return;
        }
        let frames = upper(self.ramp).min(self.frames_to_edge());
        let blocks = frames / BLOCK as u32;
        if blocks > 0 {
            self.tone.calm = blocks;
            self.ramp -= samples(blocks * BLOCK as u32);
            self.tone.growth = self.slope * BLOCK as u64;
            self.tone.pitch += self.tone.growth / 2;
        }
    }

    /// How long a rising pitch takes to the edge of the band, at least; more than a ramp may be if it does not get there.
    fn frames_to_edge(&self) -> u32 {
        if upper(self.limit) <= EDGE_START {
            return u32::MAX;
        }
        let room = EDGE_START.saturating_sub(upper(self.tone.pitch));
        room / (upper(self.slope) + 1)
    }

    /// Runs over the frames of `span`. The turns to the first one's next are so far `ahead` of the pitch at itself, and
    /// grow by `slope` from sample to sample, as the pitch does; all Q64.
    fn run(&mut self, out: &mut Ears, span: Range<usize>, ahead: u64, slope: u64) {
        let n = span.len() as u64;
        if n == 0 {
            return;
        }
        let step = self.tone.pitch + ahead;
        let run = Run {
            phase: (self.tone.phase >> 27) as u32,
            step: upper(step),
            slope: upper(slope),
            gain: self.tone.gain,
            decay: self.tone.decay,
            envelope: self.tone.envelope as i32,
        };
        let pitch = self.tone.pitch + slope * (n - 1);
        let edged = self.slope != 0 && upper(pitch) > EDGE_START;
        if self.tone.level() >= PLAIN_MAX {
            self.shaped(run, out, span, upper(ahead));
        } else if edged && run.envelope < ATTACK_END {
            edge(run, out, span, upper(ahead));
        } else if edged {
            self.shaped(run, out, span, upper(ahead));
        } else {
            sing(run, out, span);
        }
        self.tone.envelope = self.tone.faded(n as usize);
        let triangle = (slope >> 5) * (n * (n - 1) / 2);
        self.tone.phase = self.tone.phase.wrapping_add((step >> 5) * n + triangle);
        self.tone.pitch = pitch + slope;
    }

    /// The same under soft attack and the fade at the edge of the band, of any gain. The step, a mean over the sample to come, is `ahead` of the pitch at the sample itself.
    #[inline(never)]
    fn shaped(&self, mut run: Run, out: &mut Ears, span: Range<usize>, ahead: u32) {
        let rises = self.slope != 0;
        out.add(span, || {
            let mut shape = if run.envelope < ATTACK_END {
                run.envelope >> 5
            } else {
                soft_attack(run.envelope)
            };
            let pitch = run.step - ahead;
            if rises && pitch > EDGE_START {
                shape = mul_high(shape, to_edge(EDGE_END.saturating_sub(pitch)) << 4) << 1;
            }
            run.next(shape)
        });
    }
}

/// The same past the soft attack at the edge of the band, where most rising bubbles that get there come to late in their
/// life, and the fade is a straight line.
#[inline(never)]
fn edge(mut run: Run, out: &mut Ears, span: Range<usize>, ahead: u32) {
    let pitch = run.step - ahead;
    let (mut part, fall) = (to_edge(EDGE_END.saturating_sub(pitch)), to_edge(run.slope));
    out.add(span, || {
        let shape = mul_high(run.envelope, part.min(EDGE_FULL));
        part = (part - fall).max(0);
        run.next(shape)
    });
}

/// So many samples, Q32.32.
fn samples(count: u32) -> u64 {
    u64::from(count) << 32
}

/// So many turns a sample (Q32) as a part of the fade at the edge, Q27.
fn to_edge(turns: u32) -> i32 {
    // Q31.
    const PART: u32 = ((1 << 58) / (EDGE_END - EDGE_START) as u64) as u32;
    (high(turns, PART) << 1).min(i32::MAX as u32) as i32
}
