//! `emulated-board play ELF -o out.wav`: what a DAC on the board's pins would play.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::{Parser, Subcommand, ValueEnum};
use emulated_board::{AudioFormat, Board, Chip, Elf, Setup};
use hound::{SampleFormat, WavSpec, WavWriter};

/// The board freshet runs on, emulated.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Boot a firmware and write what its I2S sends to a WAV file.
    Play(Play),
}

#[derive(clap::Args)]
struct Play {
    /// The firmware, an ELF file as it is flashed.
    elf: PathBuf,
    /// The WAV file to write.
    #[arg(short, long, value_name = "WAV")]
    output: PathBuf,
    /// How long to run.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// The microcontroller.
    #[arg(long, value_enum, default_value = "f407")]
    chip: ChipName,
    /// Press the user button at this time, for 100 ms; may be given again.
    #[arg(long, value_name = "S")]
    press_at: Vec<f64>,
    /// Type this file on the serial line, from the first second on.
    #[arg(long, value_name = "FILE")]
    serial_in: Option<PathBuf>,
    /// Core cycles an instruction takes on average.
    #[arg(long, value_name = "CYCLES", default_value_t = 2.0)]
    cycles_per_instruction: f64,
    /// Have the crystal not start.
    #[arg(long)]
    no_crystal: bool,
    /// Write the raw bytes logged over RTT to this file, for defmt-print.
    #[arg(long, value_name = "FILE")]
    rtt: Option<PathBuf>,
    /// Name the registers the firmware reached that the emulator has no model for.
    #[arg(long)]
    gaps: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum ChipName {
    F407,
    F411,
    H743,
}

impl From<ChipName> for Chip {
    fn from(name: ChipName) -> Self {
        match name {
            ChipName::F407 => Self::F407,
            ChipName::F411 => Self::F411,
            ChipName::H743 => Self::H743,
        }
    }
}

/// Something done to the board at a time.
enum Deed {
    Button(bool),
    Type(Vec<u8>),
}

const PRESS: Duration = Duration::from_millis(100);
const TYPING: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    let Command::Play(play) = Arguments::parse().command;
    match play.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

impl Play {
    fn run(&self) -> Result<()> {
        let end = seconds(self.seconds)?;
        let elf = Elf::load(&self.elf)?;
        let setup = Setup {
            crystal: !self.no_crystal,
            cycles_per_instruction: self.cycles_per_instruction,
            ..Setup::default()
        };
        let mut deeds = self.deeds()?;
        // Before the run, which takes a while.
        let output = File::create(&self.output)
            .with_context(|| format!("writing {}", self.output.display()))?;
        let mut board = Board::new(self.chip.into(), &elf, setup)?;
        let mut log = Vec::new();
        let begun = Instant::now();
        while board.now() < end {
            let now = board.now();
            while let Some((_, deed)) = deeds.pop_front_if(|(at, _)| *at <= now) {
                match deed {
                    Deed::Button(pressed) => board.button(pressed)?,
                    Deed::Type(bytes) => board.serial_send(&bytes)?,
                }
            }
            let next = deeds.front().map_or(end, |(at, _)| *at).min(end);
            // Often enough for the log's buffer not to fill up.
            board.run((next - now).min(Duration::from_millis(10)))?;
            log.extend(board.rtt_take()?);
        }
        let elapsed = begun.elapsed();
        let audio = board.take_audio();
        if let Some(path) = &self.rtt {
            fs::write(path, &log).with_context(|| format!("writing {}", path.display()))?;
        }
        self.report(&mut board, audio.len(), elapsed)?;
        let Some(stream) = board.streams().last().copied() else {
            bail!("the firmware sent no audio in {} s", self.seconds);
        };
        write_wav(output, &audio, stream.format, stream.sample_rate)
            .with_context(|| format!("writing {}", self.output.display()))
    }

    /// What is to be done to the board, in order of time.
    fn deeds(&self) -> Result<VecDeque<(Duration, Deed)>> {
        let mut deeds = Vec::new();
        for at in &self.press_at {
            let at = seconds(*at)?;
            deeds.push((at, Deed::Button(true)));
            deeds.push((at + PRESS, Deed::Button(false)));
        }
        if let Some(path) = &self.serial_in {
            let bytes = fs::read(path).with_context(|| format!("reading {}", path.display()))?;
            deeds.push((TYPING, Deed::Type(bytes)));
        }
        deeds.sort_by_key(|(at, _)| *at);
        Ok(deeds.into())
    }

    fn report(&self, board: &mut Board, frames: usize, elapsed: Duration) -> Result<()> {
        if let Some(format) = board.audio_format() {
            println!("audio        {format}");
        }
        println!("sample rate  {} Hz", board.sample_rate()?);
        println!("frames       {frames}");
        if let Some(at) = board.first_sound() {
            println!("first sound  {} s", at.as_secs_f64());
        }
        println!("underruns    {}", board.i2s_underruns());
        match board.codec().powered_up() {
            Ok(at) => println!("codec        up at {} s", at.as_secs_f64()),
            Err(fault) => println!("codec        {fault}"),
        }
        for reset in board.resets()? {
            println!("reset        {} s, {}", reset.at.as_secs_f64(), reset.cause);
        }
        for change in board.led_changes() {
            let state = if change.on { "on" } else { "off" };
            println!(
                "led {}        {} s, {state}",
                change.led,
                change.at.as_secs_f64()
            );
        }
        let sent = board.serial_take();
        println!("serial       {:?}", String::from_utf8_lossy(&sent));
        if self.gaps {
            for (register, written) in board.unmodelled()? {
                let how = if written { "written" } else { "read" };
                println!("gap          {register}, {how}");
            }
        }
        let (time, real) = (board.now().as_secs_f64(), elapsed.as_secs_f64());
        println!(
            "speed        {:.1} times real time, {:.0} million instructions a second of it",
            time / real,
            board.instructions() as f64 / time / 1e6
        );
        Ok(())
    }
}

fn seconds(seconds: f64) -> Result<Duration> {
    Duration::try_from_secs_f64(seconds).with_context(|| format!("{seconds} s is no time to run"))
}

fn write_wav(file: File, audio: &[[i32; 2]], format: AudioFormat, rate: f64) -> Result<()> {
    let spec = WavSpec {
        channels: 2,
        sample_rate: rate.round() as u32,
        bits_per_sample: format.data_bits as u16,
        sample_format: SampleFormat::Int,
    };
    let mut writer = WavWriter::new(BufWriter::new(file), spec)?;
    for sample in audio.iter().flatten() {
        writer.write_sample(*sample)?;
    }
    writer.finalize()?;
    Ok(())
}
