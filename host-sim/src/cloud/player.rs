//! Plays tracks: turns them into the events of an ensemble, span by span.

use std::collections::HashMap;

use anyhow::Result;

use super::ensemble::{Ensemble, Event};
use super::forcing::{Cause, Pulse};
use super::step::Sharpen;
use super::synthetic::Random;
use super::tracks::{Sample, Tracks, at_time};

/// A bubble that is alive.
struct Voice {
    key: usize,
    track: usize,
    samples: Vec<Sample>,
}

/// Tracks under way.
pub struct TrackPlayer {
    tracks: Tracks,
    ensemble: Ensemble,
    rate: f64,
    seed: u64,
    next: usize,
    next_key: usize,
    voices: Vec<Voice>,
    /// Where in `voices` the bubble of a track that has an heir is.
    by_track: HashMap<usize, usize>,
    events: Vec<Event>,
    /// Samples still to be thrown away.
    late: usize,
}

impl TrackPlayer {
    /// From time 0. `seed` draws the roundness ξ of mergers.
    pub fn new(tracks: Tracks, ensemble: Ensemble, rate: f64, seed: u64) -> Self {
        Self {
            tracks,
            ensemble,
            rate,
            seed,
            next: 0,
            next_key: 0,
            voices: Vec::new(),
            by_track: HashMap::new(),
            events: Vec::new(),
            late: Sharpen::REACH,
        }
    }

    /// The ensemble, to look at.
    pub fn ensemble(&self) -> &Ensemble {
        &self.ensemble
    }

    /// The tracks, to look at.
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// Whether everybody has come, gone and fallen silent.
    pub fn is_over(&self) -> bool {
        self.next == self.tracks.tracks.len() && self.voices.is_empty() && self.ensemble.is_over()
    }

    /// Adds the next samples to `out`, in Pa at 1 m: about a millisecond of them.
    ///
    /// # Errors
    /// A temporary file that cannot be read back; CB's kernel where it is not positive definite.
    pub fn play(&mut self, out: &mut Vec<f64>) -> Result<()> {
        let end = (self.ensemble.frame() + self.ensemble.span() as u64) as f64 / self.rate;
        self.events.clear();
        while let Some(track) = self.tracks.tracks.get(self.next) {
            // A pulse is heard from the sample before it on.
            if track.start >= end + 1.0 / self.rate {
                break;
            }
            self.begin(self.next, end)?;
            self.next += 1;
        }
        let surface = self.tracks.surface;
        let mut at = 0;
        while at < self.voices.len() {
            let voice = &self.voices[at];
            let track = &self.tracks.tracks[voice.track];
            let key = voice.key;
            let goes_on = track.next.is_some_and(|heir| heir as usize >= self.next);
            if !goes_on && (track.end < end || voice.samples.is_empty()) {
                self.events.push(Event::Death { key });
                self.by_track.remove(&voice.track);
                self.voices.swap_remove(at);
                if let Some(moved) = self.voices.get(at) {
                    self.by_track.insert(moved.track, at);
                }
                continue;
            }
            // One sample holds for ever, and nothing changes before the first or after the last.
            if voice.samples.len() > 1 {
                let time = end.clamp(track.start, track.end.max(track.start));
                let (place, tone) = at_time(&voice.samples, track.radius, surface, time);
                self.events.push(Event::Change { key, place, tone });
            }
            at += 1;
        }
        let before = out.len();
        self.ensemble.play(&self.events, out)?;
        if self.late > 0 {
            let gone = self.late.min(out.len() - before);
            out.drain(before..before + gone);
            self.late -= gone;
        }
        Ok(())
    }

    fn begin(&mut self, index: usize, end: f64) -> Result<()> {
        let samples = self.tracks.samples_of(index)?;
        let surface = self.tracks.surface;
        let track = &self.tracks.tracks[index];
        let (place, tone) = at_time(&samples, track.radius, surface, end.min(track.end));
        // The same for the same bubble, whatever else is in the file.
        let mut random = Random::new(self.seed ^ track.id.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let roundness = match track.cause {
            Cause::Merged(_) => random.between(0.4, 0.8),
            _ => 0.6,
        };
        let pulse = Pulse::new(track.cause, track.radius, roundness);
        let time = track.start;
        let parent = track.before.and_then(|parent| {
            let at = self.by_track.get(&(parent as usize))?;
            Some((parent as usize, *at))
        });
        let key = match parent {
            Some((parent, at)) => {
                let voice = &mut self.voices[at];
                voice.track = index;
                voice.samples = samples;
                let key = voice.key;
                self.by_track.remove(&parent);
                self.by_track.insert(index, at);
                self.events.push(Event::Change { key, place, tone });
                key
            }
            None => {
                let key = self.next_key;
                self.next_key += 1;
                self.by_track.insert(index, self.voices.len());
                self.voices.push(Voice {
                    key,
                    track: index,
                    samples,
                });
                self.events.push(Event::Birth { key, place, tone });
                key
            }
        };
        self.events.push(Event::Strike { key, time, pulse });
        Ok(())
    }
}
