//! Stereo WAV files: 16 or 24 bits or 32-bit float, to a file or streamed to standard output.
//!
//! The header is written first with both lengths "unknown" and corrected by [`WavWriter::finish`], so that
//! memory stays flat, a pipe needs no seeking, and a file cut off by a power failure still plays in most players.

use anyhow::{Result, bail};
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Seek, SeekFrom, Write};
use std::path::Path;

/// What one sample is in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 16-bit integer, −32 768 ..= 32 767.
    Int16,
    /// 24-bit integer, −8 388 608 ..= 8 388 607.
    Int24,
    /// 32-bit float, full scale ±1.0, free to go beyond.
    Float32,
}

impl Format {
    const fn bytes(self) -> usize {
        match self {
            Format::Int16 => 2,
            Format::Int24 => 3,
            Format::Float32 => 4,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Format::Int16 => "16-bit",
            Format::Int24 => "24-bit",
            Format::Float32 => "32-bit float",
        }
    }

    /// Full scale of the integers [`WavWriter::write_int`] takes.
    const fn full_scale(self) -> i32 {
        match self {
            Format::Int16 => 1 << 15,
            Format::Int24 | Format::Float32 => 1 << 23,
        }
    }
}

const CHANNELS: usize = 2;
const BUFFER_BYTES: usize = 1 << 16;

/// The highest sample rate accepted, in Hz; the header's bytes per second must fit 32 bits.
const MAX_RATE: u32 = 1_000_000;

/// The longest data chunk, in bytes: both lengths in the header are 32 bits wide, the outer one counts up to
/// 60 bytes of header, and all ones means "unknown".
const MAX_DATA_BYTES: u64 = u32::MAX as u64 - 1 - 60;

/// Why a sound could not be written. One complete sentence, and no `source`: printed with or without its
/// chain it reads the same.
#[derive(Debug)]
struct WriteError {
    message: String,
    kind: io::ErrorKind,
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for WriteError {}

/// The error for the file `name` that could not be written, with what to do about it.
pub(crate) fn write_error(name: impl fmt::Display, error: &io::Error) -> anyhow::Error {
    use io::ErrorKind::{
        BrokenPipe, IsADirectory, NotADirectory, NotFound, PermissionDenied, StorageFull,
    };
    let kind = error.kind();
    let hint = match kind {
        NotFound | NotADirectory => " (does the folder exist?)",
        PermissionDenied => " (choose a folder you may write to)",
        IsADirectory => " (give the name of a file in it)",
        StorageFull => " (free some space, or write to another disk)",
        BrokenPipe => " (the program that was reading the sound has stopped)",
        _ => "",
    };
    // The number of the error says nothing to a person.
    let reason = error.to_string();
    let reason = reason.split(" (os error").next().unwrap_or_default();
    anyhow::Error::new(WriteError {
        message: format!("cannot write {name}: {reason}{hint}"),
        kind,
    })
}

/// Whether `error` says that the reader at the other end of a pipe has gone: a reason to stop, not to complain.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let kind = cause
            .downcast_ref::<WriteError>()
            .map(|error| error.kind)
            .or_else(|| cause.downcast_ref::<io::Error>().map(io::Error::kind));
        kind == Some(io::ErrorKind::BrokenPipe)
    })
}

/// Writes one stereo sound, frame by frame, in flat memory.
///
/// A writer that is dropped without [`finish`](Self::finish) still leaves a valid file of what was written,
/// but nobody hears of an error.
pub struct WavWriter {
    name: String,
    format: Format,
    out: BufWriter<Box<dyn Write + Send>>,
    /// A second handle for correcting the header; a stream has none.
    file: Option<File>,
    header_bytes: u64,
    frames: u64,
    limit: u64,
    closed: bool,
}

impl WavWriter {
    /// Starts a sound of `frames` frames (the length expected; fewer may follow) at `rate` Hz.
    ///
    /// The path `-` streams to standard output. That, and anything else that is not a regular file (a named
    /// pipe, a device), gets a header of unknown length and may be longer than 4 GiB.
    ///
    /// # Errors
    /// A rate of 0 or above 1 MHz; a file that would exceed 4 GiB (nothing is touched then); a path that
    /// cannot be written; standard output that is a terminal.
    pub fn create(path: &Path, format: Format, rate: u32, frames: u64) -> Result<Self> {
        let streams = path.as_os_str() == "-";
        let name = if streams {
            "standard output".to_owned()
        } else {
            path.display().to_string()
        };
        if path.as_os_str().is_empty() {
            bail!(
                "cannot write the sound: the path is empty (give the name of a WAV file, or `-`)"
            );
        }
        if !(1..=MAX_RATE).contains(&rate) {
            bail!(
                "cannot write {name}: expected a sample rate from 1 to {MAX_RATE} Hz, got {rate}"
            );
        }
        let regular = !streams
            && std::fs::metadata(path).map_or(true, |meta| meta.is_file() || meta.is_dir());
        let limit = if regular {
            MAX_DATA_BYTES / (CHANNELS * format.bytes()) as u64
        } else {
            u64::MAX
        };
        if frames > limit {
            // Tenths of a second, the length asked for rounded up, the longest one rounded down.
            let asked = (u128::from(frames) * 10).div_ceil(u128::from(rate));
            let longest = limit * 10 / u64::from(rate);
            bail!(
                "cannot write {name}: {}.{} s of {} stereo at {rate} Hz do not fit a WAV file, which ends at \
                 4 GiB; the longest possible is {}.{} s (shorten it, take a smaller format, or stream to `-`)",
                asked / 10,
                asked % 10,
                format.name(),
                longest / 10,
                longest % 10,
            );
        }

        let (file, out): (Option<File>, Box<dyn Write + Send>) = if streams {
            let stdout = io::stdout();
            if stdout.is_terminal() {
                bail!(
                    "cannot write the sound to a terminal (send it to a program with `|` or to a file with `>`)"
                );
            }
            (None, Box::new(stdout))
        } else {
            let open = || -> io::Result<_> {
                let file = File::create(path)?;
                let second = if regular {
                    Some(file.try_clone()?)
                } else {
                    None
                };
                Ok((second, file))
            };
            let (second, file) = open().map_err(|error| write_error(&name, &error))?;
            (second, Box::new(file))
        };

        let spec = hound::WavSpec {
            channels: CHANNELS as u16,
            sample_rate: rate,
            bits_per_sample: 8 * format.bytes() as u16,
            sample_format: match format {
                Format::Float32 => hound::SampleFormat::Float,
                Format::Int16 | Format::Int24 => hound::SampleFormat::Int,
            },
        };
        let header = spec.into_header_for_infinite_file();
        let mut writer = WavWriter {
            name,
            format,
            out: BufWriter::with_capacity(BUFFER_BYTES, out),
            file,
            header_bytes: header.len() as u64,
            frames: 0,
            limit,
            closed: false,
        };
        writer.write(&header)?;
        Ok(writer)
    }

    /// Writes one frame of integers in the format's own scale (±2¹⁵ for [`Format::Int16`], ±2²³ otherwise);
    /// what does not fit an integer file is clipped.
    ///
    /// # Errors
    /// A full disk, a broken pipe ([`is_broken_pipe`]), a file that has reached 4 GiB.
    pub fn write_int(&mut self, left: i32, right: i32) -> Result<()> {
        let full = self.format.full_scale();
        match self.format {
            Format::Int16 | Format::Int24 => self.put(
                left.clamp(-full, full - 1).to_le_bytes(),
                right.clamp(-full, full - 1).to_le_bytes(),
            ),
            Format::Float32 => {
                let scaled = |value: i32| (value as f32 / full as f32).to_le_bytes();
                self.put(scaled(left), scaled(right))
            }
        }
    }

    /// Writes one frame of floats, full scale ±1.0. An integer file gets the nearest integer without dither,
    /// clipped, and 0 for what is not a number.
    ///
    /// # Errors
    /// As [`write_int`](Self::write_int).
    pub fn write_float(&mut self, left: f32, right: f32) -> Result<()> {
        match self.format {
            Format::Int16 | Format::Int24 => {
                let full = self.format.full_scale() as f32;
                // A float cast to an integer saturates, and takes NaN to 0.
                self.write_int((left * full).round() as i32, (right * full).round() as i32)
            }
            Format::Float32 => self.put(left.to_le_bytes(), right.to_le_bytes()),
        }
    }

    /// Writes out what is buffered and corrects the header to the frames written, however few they are.
    ///
    /// # Errors
    /// A full disk or a broken pipe, as late as here.
    pub fn finish(mut self) -> Result<()> {
        self.close()
    }

    /// The low bytes of both samples, interleaved.
    fn put(&mut self, left: [u8; 4], right: [u8; 4]) -> Result<()> {
        if self.frames >= self.limit {
            bail!(
                "cannot write {}: a WAV file ends at 4 GiB, and this one is full after {} frames",
                self.name,
                self.frames
            );
        }
        let bytes = self.format.bytes();
        let mut frame = [0; 8];
        frame[..bytes].copy_from_slice(&left[..bytes]);
        frame[bytes..2 * bytes].copy_from_slice(&right[..bytes]);
        self.write(&frame[..2 * bytes])?;
        self.frames += 1;
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.out
            .write_all(bytes)
            .map_err(|error| write_error(&self.name, &error))
    }

    fn close(&mut self) -> Result<()> {
        if self.closed {
            return Ok(());
        }
        self.closed = true;
        let flushed = self.out.flush();
        let corrected = self.correct_header(flushed.is_ok());
        flushed
            .and(corrected)
            .map_err(|error| write_error(&self.name, &error))
    }

    /// Puts the true lengths in the header of a file. When the disk is full, they are those of what reached it.
    fn correct_header(&mut self, complete: bool) -> io::Result<()> {
        let Some(file) = &mut self.file else {
            return Ok(());
        };
        let frame_bytes = (CHANNELS * self.format.bytes()) as u64;
        let mut data = self.frames * frame_bytes;
        if !complete {
            let on_disk = file.metadata()?.len();
            if on_disk < self.header_bytes {
                return Ok(());
            }
            data = data.min((on_disk - self.header_bytes) / frame_bytes * frame_bytes);
        }
        // Both fit 32 bits: `put` stops at `limit`.
        let riff = (self.header_bytes - 8 + data) as u32;
        file.seek(SeekFrom::Start(4))?;
        file.write_all(&riff.to_le_bytes())?;
        file.seek(SeekFrom::Start(self.header_bytes - 4))?;
        file.write_all(&(data as u32).to_le_bytes())
    }
}

impl Drop for WavWriter {
    fn drop(&mut self) {
        // There is nobody to tell; whoever wants to know calls `finish`.
        let _ = self.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    struct Scratch(PathBuf);

    impl Scratch {
        fn new(name: &str) -> Self {
            Scratch(std::env::temp_dir().join(format!("freshet-wav-{}-{name}", std::process::id())))
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    fn refusal(path: &Path, format: Format, rate: u32, frames: u64) -> String {
        match WavWriter::create(path, format, rate, frames) {
            Ok(_) => panic!("{} was accepted", path.display()),
            Err(error) => format!("{error:#}"),
        }
    }

    #[test]
    fn integers_come_back_as_they_were_written_in_both_depths() {
        for (format, name, bits, full) in [
            (Format::Int16, "16.wav", 16, 1 << 15),
            (Format::Int24, "24.wav", 24, 1 << 23),
        ] {
            let path = Scratch::new(name);
            let mut wav = WavWriter::create(&path.0, format, 44_100, 4).unwrap();
            wav.write_int(0, -1).unwrap();
            wav.write_int(full - 1, -full).unwrap();
            wav.write_int(i32::MAX, i32::MIN).unwrap();
            wav.write_float(0.5, f32::NAN).unwrap();
            wav.finish().unwrap();
            let reader = hound::WavReader::open(&path.0).unwrap();
            let spec = reader.spec();
            assert_eq!(
                (spec.channels, spec.sample_rate, spec.bits_per_sample),
                (2, 44_100, bits)
            );
            assert_eq!(spec.sample_format, hound::SampleFormat::Int);
            let samples: Vec<i32> = reader.into_samples().map(Result::unwrap).collect();
            assert_eq!(
                samples,
                [0, -1, full - 1, -full, full - 1, -full, full / 2, 0]
            );
        }
    }

    #[test]
    fn floats_come_back_bit_for_bit_even_beyond_full_scale() {
        let path = Scratch::new("float.wav");
        let mut wav = WavWriter::create(&path.0, Format::Float32, 48_000, 2).unwrap();
        wav.write_float(1.75, -1.0e-9).unwrap();
        wav.write_int(1 << 22, -(1 << 23)).unwrap();
        wav.finish().unwrap();
        let reader = hound::WavReader::open(&path.0).unwrap();
        assert_eq!(reader.spec().sample_format, hound::SampleFormat::Float);
        let samples: Vec<f32> = reader.into_samples().map(Result::unwrap).collect();
        assert_eq!(samples, [1.75, -1.0e-9, 0.5, -1.0]);
    }

    #[test]
    fn a_file_finished_or_dropped_early_is_a_valid_wav_of_what_was_written() {
        for finished in [true, false] {
            let path = Scratch::new(&format!("early-{finished}.wav"));
            let mut wav = WavWriter::create(&path.0, Format::Int24, 48_000, 1_000_000).unwrap();
            for i in 0..777 {
                wav.write_int(i, -i).unwrap();
            }
            if finished {
                wav.finish().unwrap();
            } else {
                drop(wav);
            }
            let reader = hound::WavReader::open(&path.0).unwrap();
            assert_eq!(reader.duration(), 777);
            assert_eq!(std::fs::metadata(&path.0).unwrap().len(), 68 + 777 * 6);
        }
    }

    #[test]
    fn an_empty_sound_is_a_valid_wav() {
        let path = Scratch::new("empty.wav");
        let wav = WavWriter::create(&path.0, Format::Int16, 48_000, 0).unwrap();
        wav.finish().unwrap();
        assert_eq!(hound::WavReader::open(&path.0).unwrap().duration(), 0);
    }

    #[test]
    fn what_does_not_fit_four_gigabytes_is_refused_before_the_file_is_touched() {
        let path = Scratch::new("long.wav");
        std::fs::write(&path.0, "precious").unwrap();
        let text = refusal(&path.0, Format::Int24, 48_000, 48_000 * 15_000);
        assert!(text.contains("15000.0 s of 24-bit stereo"), "{text}");
        assert!(text.contains("the longest possible is 14913.0 s"), "{text}");
        assert_eq!(std::fs::read(&path.0).unwrap(), b"precious");
        let text = refusal(&path.0, Format::Float32, 48_000, u64::MAX);
        assert!(text.contains("the longest possible is 11184.8 s"), "{text}");
    }

    #[test]
    fn an_unwritable_path_is_named_with_the_reason_and_what_to_do() {
        let folder = std::env::temp_dir();
        let text = refusal(
            &folder.join("no-such-folder/y.wav"),
            Format::Int16,
            48_000,
            1,
        );
        assert!(text.starts_with("cannot write "), "{text}");
        assert!(text.contains("y.wav: "), "{text}");
        assert!(text.ends_with("(does the folder exist?)"), "{text}");
        assert!(!text.contains("os error"), "{text}");
        let text = refusal(&folder, Format::Int16, 48_000, 1);
        assert!(text.contains("cannot write "), "{text}");
        let text = refusal(Path::new(""), Format::Int16, 48_000, 1);
        assert!(text.contains("the path is empty"), "{text}");
    }

    #[test]
    fn an_impossible_sample_rate_is_refused() {
        let path = Scratch::new("rate.wav");
        for rate in [0, 1_000_001, u32::MAX] {
            let text = refusal(&path.0, Format::Int16, rate, 1);
            assert!(text.contains("expected a sample rate from 1 to"), "{text}");
            assert!(!path.0.exists());
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_reported_while_writing_and_when_finishing() {
        let full = Path::new("/dev/full");
        let wav = WavWriter::create(full, Format::Int16, 48_000, 1).unwrap();
        let error = wav.finish().unwrap_err();
        assert!(
            error
                .to_string()
                .contains("cannot write /dev/full: No space left")
        );
        assert!(!is_broken_pipe(&error));
        let mut wav = WavWriter::create(full, Format::Int16, 48_000, 1).unwrap();
        let error = (0..1_000_000)
            .find_map(|i| wav.write_int(i, i).err())
            .unwrap();
        assert!(error.to_string().contains("No space left"), "{error}");
    }

    #[test]
    fn a_broken_pipe_is_told_from_other_errors_through_any_context() {
        let broken = io::Error::from(io::ErrorKind::BrokenPipe);
        let ours = write_error("standard output", &broken).context("while rendering");
        assert!(is_broken_pipe(&ours));
        assert!(is_broken_pipe(&anyhow::Error::new(broken)));
        assert!(!is_broken_pipe(&anyhow::anyhow!(
            "a broken pipe in words only"
        )));
    }
}
