//! The command `freshet`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use freshet_host::cloud::{cloud_command, modes_command};
use freshet_host::{bench, flash, list, render};

/// Water and fire from physics: render scenes, hear them, measure them.
#[derive(Debug, Parser)]
#[command(name = "freshet", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a scene, bubble events or bubble tracks to a WAV
    Render(Box<render::Request>),
    /// The pitches of a cloud of bubbles that hear each other
    Modes(modes_command::Request),
    /// Make a synthetic cloud, or a stream of bubble tracks
    Cloud(cloud_command::Request),
    /// List the scenes
    List,
    /// Show parameters: current value, default, range, unit
    Describe {
        /// A parameter, or a group such as `water` [default: all]
        path: Option<String>,
        /// Take the current values from this scene
        #[arg(long)]
        scene: Option<String>,
    },
    /// Play a scene on the sound card
    Play {
        /// A scene or a scene file
        scene: String,
        /// The same seed gives the same sound
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Set a parameter; may be given again
        #[arg(long = "set", value_name = "PATH=VALUE")]
        set: Vec<String>,
    },
    /// Put the firmware on a board and start it
    Flash(flash::Request),
    /// Measure the speed of this machine against real time
    Bench(bench::Request),
}

fn main() -> ExitCode {
    match run(Cli::parse()) {
        Ok(code) => code,
        Err(error) => {
            say_aside(&format!("error: {error:#}"));
            ExitCode::from(2)
        }
    }
}

fn run(cli: Cli) -> Result<ExitCode> {
    match cli.command {
        Command::Render(request) => {
            let report = render::render(&request, &on_ctrl_c()?)?;
            if report.output == Path::new("-") {
                say_aside(&report.summary());
            } else {
                say(&report.summary())?;
            }
            // As a shell reports a program that Ctrl-C ended.
            Ok(if report.interrupted {
                ExitCode::from(130)
            } else {
                ExitCode::SUCCESS
            })
        }
        Command::Modes(request) => say(&modes_command::run(&request)?),
        Command::Cloud(request) => match cloud_command::run(&request)?.as_str() {
            "" => Ok(ExitCode::SUCCESS),
            line => say(line),
        },
        Command::List => say(&list::list()?),
        Command::Describe { path, scene } => {
            say(&list::describe(path.as_deref(), scene.as_deref())?)
        }
        Command::Play { scene, seed, set } => play(&scene, seed, &set),
        Command::Flash(request) => flash(&request),
        Command::Bench(request) => say(&bench::bench(&request)?),
    }
}

/// A flag that Ctrl-C sets.
fn on_ctrl_c() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        // The second one does not wait for a reader that has gone to sleep.
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .context("cannot catch Ctrl-C")?;
    Ok(stop)
}

/// Prints to the standard output; nobody reading it is no fault.
fn say(text: &str) -> Result<ExitCode> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Prints to the standard error, whether or not anybody reads it.
fn say_aside(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

#[cfg(feature = "play")]
fn play(scene: &str, seed: u64, set: &[String]) -> Result<ExitCode> {
    freshet_host::play::play(scene, seed, set, &on_ctrl_c()?)?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(not(feature = "play"))]
fn play(_scene: &str, _seed: u64, _set: &[String]) -> Result<ExitCode> {
    anyhow::bail!(
        "this freshet was built without a sound card; build it with `cargo run --release -p freshet-host --features play -- play …` \
         (on Debian and Ubuntu that needs the package libasound2-dev), or use `freshet render`"
    )
}

#[cfg(feature = "flash")]
fn flash(request: &flash::Request) -> Result<ExitCode> {
    say(&freshet_host::probe::flash(request)?)
}

#[cfg(not(feature = "flash"))]
fn flash(request: &flash::Request) -> Result<ExitCode> {
    anyhow::bail!(
        "this freshet was built without debug probes; run `cargo run -p freshet-host --features flash -- flash --board {}`",
        request.board.board
    )
}
