//! `freshet play`: a scene on the sound card, until Ctrl-C. Behind the feature `play`.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{FromSample, SampleFormat, SizedSample, Stream, StreamConfig};
use freshet::Frame;
use freshet::mix::Output;

use crate::board::Board;
use crate::source::Source;

/// Plays `scene` with the parameters `set` until `stop`.
pub fn play(scene: &str, seed: u64, set: &[String], stop: &Arc<AtomicBool>) -> Result<()> {
    let mut source = Source::find(scene)?;
    if source.events.is_some() {
        bail!("{scene}: play takes a scene; render a file of events to a WAV instead");
    }
    source.scene.set_all(set)?;
    let card = Card::find()?;
    let mut player = Board::Desk.player(&source.scene.scene, card.rate(), seed, Output::Bits24);
    let playing = card.play(move |out| player.render(out))?;
    // Nobody reading it is no fault.
    let _ = writeln!(std::io::stderr(), "{}: Ctrl-C ends it", source.scene.title);
    while !stop.load(Ordering::Relaxed) {
        playing.check()?;
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// The sound card.
pub struct Card {
    device: cpal::Device,
    format: SampleFormat,
    config: StreamConfig,
}

/// A sound card that plays, as long as this is kept.
pub struct Playing {
    _stream: Stream,
    failed: Arc<AtomicBool>,
}

impl Card {
    /// The one that the system uses.
    pub fn find() -> Result<Self> {
        let device = cpal::default_host()
            .default_output_device()
            .context("no sound card was found; `freshet render` needs none")?;
        let card = device
            .default_output_config()
            .context("the sound card does not say what it plays")?;
        Ok(Self {
            device,
            format: card.sample_format(),
            config: StreamConfig::from(card),
        })
    }

    /// Its sample rate, Hz.
    pub fn rate(&self) -> u32 {
        self.config.sample_rate
    }

    /// Plays what `fill` puts out, 24 bits.
    pub fn play(self, fill: impl FnMut(&mut [Frame]) + Send + 'static) -> Result<Playing> {
        let failed = Arc::new(AtomicBool::new(false));
        let stream = match self.format {
            SampleFormat::F32 => self.open::<f32>(fill, &failed),
            SampleFormat::I16 => self.open::<i16>(fill, &failed),
            SampleFormat::I32 => self.open::<i32>(fill, &failed),
            other => bail!("the sound card wants {other} samples; expected f32, i16 or i32"),
        }?;
        stream.play().context("the sound card does not start")?;
        Ok(Playing {
            _stream: stream,
            failed,
        })
    }

    fn open<T: SizedSample + FromSample<f32>>(
        &self,
        mut fill: impl FnMut(&mut [Frame]) + Send + 'static,
        failed: &Arc<AtomicBool>,
    ) -> Result<Stream> {
        let channels = usize::from(self.config.channels).max(1);
        let failed = Arc::clone(failed);
        let write = move |out: &mut [T], _: &cpal::OutputCallbackInfo| {
            for samples in out.chunks_mut(channels) {
                let mut frame = [Frame::ZERO];
                fill(&mut frame);
                let ears = [frame[0].left, frame[0].right].map(|x| x as f32 / 8_388_608.0);
                for (channel, sample) in samples.iter_mut().enumerate() {
                    // Mono cards hear the middle; further channels stay silent.
                    let value = match (channels, channel) {
                        (1, _) => (ears[0] + ears[1]) / 2.0,
                        (_, 0 | 1) => ears[channel],
                        _ => 0.0,
                    };
                    *sample = T::from_sample(value);
                }
            }
        };
        let error = move |error: cpal::Error| {
            if !matches!(
                error.kind(),
                cpal::ErrorKind::Xrun
                    | cpal::ErrorKind::RealtimeDenied
                    | cpal::ErrorKind::DeviceChanged
            ) {
                failed.store(true, Ordering::Relaxed);
            }
        };
        self.device
            .build_output_stream(self.config, write, error, None)
            .context("the sound card cannot be opened")
    }
}

impl Playing {
    /// Fails where the card has gone away.
    pub fn check(&self) -> Result<()> {
        if self.failed.load(Ordering::Relaxed) {
            bail!("the sound card is gone");
        }
        Ok(())
    }
}
