//! Every birth with its physical figures, as the core reports it: for the events file and the reference rendering.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path as FilePath, PathBuf};

use anyhow::Result;
use freshet::bubble::Bubble;
use freshet::observer::{Birth, Crowd, Observer, Path};
use freshet::resonator::Tuning;

use crate::wav::write_error;

/// One sound that the core began.
#[derive(Clone, Copy, Debug)]
pub struct Sound {
    /// When, s.
    pub time: f64,
    /// Radius, m.
    pub radius: f64,
    /// Rise factor ξ.
    pub rise_factor: f64,
    /// Amplitude in the two ears at that time, Pa.
    pub amplitude: [f64; 2],
    /// Phase in the two ears at that time, rad; 0 but for crowds.
    pub phase: [f64; 2],
    /// What became of it.
    pub path: SoundPath,
    /// Radius class, from 1; none for single events.
    pub class: Option<u8>,
    /// How many births it stands for.
    pub births: u64,
}

/// What became of a birth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SoundPath {
    /// An impulse into its class.
    Class,
    /// One sample's impulses of a class with more than one birth a sample.
    Crowd,
    /// A voice.
    Voice,
    /// Not sounded: no voice was free.
    Dropped,
    /// Not sounded: too high for the sample rate.
    TooHigh,
}

impl SoundPath {
    /// The word in the events file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Class => "class",
            Self::Crowd => "crowd",
            Self::Voice => "voice",
            Self::Dropped => "dropped",
            Self::TooHigh => "too_high",
        }
    }
}

impl Sound {
    /// From a birth at `rate` Hz.
    pub fn of_birth(birth: &Birth, rate: f64) -> Self {
        let fraction = f64::from(birth.fraction) / f64::from(1 << 27);
        let radius = f64::from(birth.radius);
        let gain = birth.gain.map(f64::from);
        let amplitude = if birth.path == Path::Class {
            // Reckoned at the frame before the birth, by a decay that had not begun.
            let decay = (-Bubble::new(radius).beta * fraction / rate).exp();
            gain.map(|gain| gain / f64::from(1 << 27) * decay)
        } else {
            gain.map(|gain| gain / f64::from(1 << 28))
        };
        Self {
            time: (birth.frame as f64 + fraction) / rate,
            radius,
            rise_factor: f64::from(birth.rise_factor),
            amplitude,
            phase: [0.0; 2],
            path: match birth.path {
                Path::Class => SoundPath::Class,
                Path::Voice => SoundPath::Voice,
                Path::Dropped => SoundPath::Dropped,
                Path::TooHigh => SoundPath::TooHigh,
            },
            class: birth.class.checked_add(1),
            births: 1,
        }
    }

    /// From a crowd's sample at `rate` Hz: the words as amplitude and phase.
    pub fn of_crowd(crowd: &Crowd, rate: f64) -> Self {
        let second = Tuning::new(crowd.radius, rate).second_word();
        let polar = |words: [i64; 2]| {
            if words == [0; 2] {
                return (0.0, 0.0);
            }
            let [sine, other] = words.map(|word| word as f64 / (1u64 << 58) as f64);
            let cosine = (other - second[0] * sine) / second[1];
            (sine.hypot(cosine), sine.atan2(cosine))
        };
        let (left, right) = (polar(crowd.words.left), polar(crowd.words.right));
        Self {
            time: crowd.frame as f64 / rate,
            radius: f64::from(crowd.radius),
            rise_factor: 0.0,
            amplitude: [left.0, right.0],
            phase: [left.1, right.1],
            path: match crowd.path {
                Path::Class | Path::Voice => SoundPath::Crowd,
                Path::Dropped => SoundPath::Dropped,
                Path::TooHigh => SoundPath::TooHigh,
            },
            class: Some(crowd.class + 1),
            births: crowd.births,
        }
    }

    /// Amplitude of both ears together: that of a bubble in the middle.
    pub fn mean_amplitude(&self) -> f64 {
        let [left, right] = self.amplitude;
        let mean = ((left * left + right * right) / 2.0).sqrt();
        if left < 0.0 { -mean } else { mean }
    }
}

/// Keeps every sound in memory.
#[derive(Clone, Debug)]
pub struct Births {
    rate: f64,
    /// In the order of the core: block by block, class by class.
    pub sounds: Vec<Sound>,
}

impl Births {
    /// None yet, at `rate` Hz.
    pub fn new(rate: u32) -> Self {
        Self {
            rate: f64::from(rate),
            sounds: Vec::new(),
        }
    }
}

impl Observer for Births {
    fn birth(&mut self, birth: &Birth) {
        self.sounds.push(Sound::of_birth(birth, self.rate));
    }
    fn crowd(&mut self, crowd: &Crowd) {
        self.sounds.push(Sound::of_crowd(crowd, self.rate));
    }
}

/// Writes every sound to a CSV whose first columns are those of a bubble-event file.
pub struct EventLog {
    rate: f64,
    path: PathBuf,
    writer: csv::Writer<BufWriter<File>>,
    /// Sounds of the current stretch, to be written in order of time.
    waiting: Vec<Sound>,
    error: Option<io::Error>,
}

impl EventLog {
    /// Begins the file at `path`.
    pub fn create(path: &FilePath, rate: u32) -> Result<Self> {
        let file = File::create(path).map_err(|error| write_error(path.display(), &error))?;
        let mut writer = csv::Writer::from_writer(BufWriter::new(file));
        writer.write_record([
            "time",
            "radius_m",
            "amplitude",
            "rise_factor",
            "class",
            "left",
            "right",
            "phase_left",
            "phase_right",
            "path",
            "births",
        ])?;
        Ok(Self {
            rate: f64::from(rate),
            path: path.to_owned(),
            writer,
            waiting: Vec::new(),
            error: None,
        })
    }

    /// Writes what is known to come before `seconds`.
    pub fn flush_before(&mut self, seconds: f64) -> Result<()> {
        self.waiting.sort_by(|a, b| a.time.total_cmp(&b.time));
        let ready = self.waiting.partition_point(|sound| sound.time < seconds);
        for sound in self.waiting.drain(..ready) {
            let number = |x: f64| format!("{x:.9e}");
            let written = self.writer.write_record([
                format!("{:.12}", sound.time),
                number(sound.radius),
                number(sound.mean_amplitude()),
                format!("{}", sound.rise_factor),
                sound.class.map_or(String::new(), |class| class.to_string()),
                number(sound.amplitude[0]),
                number(sound.amplitude[1]),
                format!("{:.9}", sound.phase[0]),
                format!("{:.9}", sound.phase[1]),
                sound.path.name().to_owned(),
                sound.births.to_string(),
            ]);
            if let Err(error) = written {
                self.error.get_or_insert(error.into());
            }
        }
        match self.error.take() {
            Some(error) => Err(write_error(self.path.display(), &error)),
            None => Ok(()),
        }
    }

    /// Writes the rest.
    pub fn finish(mut self) -> Result<()> {
        self.flush_before(f64::INFINITY)?;
        self.writer
            .flush()
            .map_err(|error| write_error(self.path.display(), &error))
    }
}

impl Observer for EventLog {
    fn birth(&mut self, birth: &Birth) {
        self.waiting.push(Sound::of_birth(birth, self.rate));
    }
    fn crowd(&mut self, crowd: &Crowd) {
        self.waiting.push(Sound::of_crowd(crowd, self.rate));
    }
}
