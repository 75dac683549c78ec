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

use crate::board::{Board, Player};
use crate::source::Source;

/// Plays `scene` with the parameters `set` until `stop`.
pub fn play(scene: &str, seed: u64, set: &[String], stop: &Arc<AtomicBool>) -> Result<()> {
    let mut source = Source::find(scene)?;
    if source.events.is_some() {
        bail!("{scene}: play takes a scene; render a file of events to a WAV instead");
    }
    source.scene.set_all(set)?;
    let device = cpal::default_host()
        .default_output_device()
        .context("no sound card was found; `freshet render` needs none")?;
    let card = device
        .default_output_config()
        .context("the sound card does not say what it plays")?;
    let (format, config) = (card.sample_format(), StreamConfig::from(card));
    let player = Board::Desk.player(
        &source.scene.scene,
        config.sample_rate,
        seed,
        Output::Bits24,
    );
    let failed = Arc::new(AtomicBool::new(false));
    let stream = match format {
        SampleFormat::F32 => open::<f32>(&device, config, player, &failed),
        SampleFormat::I16 => open::<i16>(&device, config, player, &failed),
        SampleFormat::I32 => open::<i32>(&device, config, player, &failed),
        other => bail!("the sound card wants {other} samples; expected f32, i16 or i32"),
    }?;
    stream.play().context("the sound card does not start")?;
    // Nobody reading it is no fault.
    let _ = writeln!(std::io::stderr(), "{}: Ctrl-C ends it", source.scene.title);
    while !stop.load(Ordering::Relaxed) {
        if failed.load(Ordering::Relaxed) {
            bail!("the sound card is gone");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

fn open<T: SizedSample + FromSample<f32>>(
    device: &cpal::Device,
    config: StreamConfig,
    mut player: Box<dyn Player>,
    failed: &Arc<AtomicBool>,
) -> Result<Stream> {
    let channels = usize::from(config.channels).max(1);
    let failed = Arc::clone(failed);
    let write = move |out: &mut [T], _: &cpal::OutputCallbackInfo| {
        for samples in out.chunks_mut(channels) {
            let mut frame = [Frame::ZERO];
            player.render(&mut frame);
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
    device
        .build_output_stream(config, write, error, None)
        .context("the sound card cannot be opened")
}
