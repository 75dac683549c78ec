//! The command `freshet`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use freshet_host::cloud::{cloud_command, modes_command};
use freshet_host::simulate::Told;
use freshet_host::talk::Port;
use freshet_host::transfer::command as transfer;
use freshet_host::{
    bake, bench, bridge, control, flash, list, record, render, replay, simulate, talk,
};

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
    /// Compute what a board keeps in flash: the sound texture of a fire
    Bake(bake::Request),
    /// The pitches of a cloud of bubbles that hear each other
    Modes(modes_command::Request),
    /// Make a synthetic cloud, or a stream of bubble tracks
    Cloud(cloud_command::Request),
    /// What an ear hears of a bubble in a vessel
    Transfer(transfer::Request),
    /// Check the mesh of a vessel, and draw it
    Vessel(transfer::VesselRequest),
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
    /// Play a board by OSC and MIDI
    Bridge(bridge::Request),
    /// Put the firmware on a board and start it
    Flash(flash::Request),
    /// Play a board, or this machine, on a live terminal screen
    Control(control::Request),
    /// Run a board's twin behind a port of its own; prints the port's path
    Simulate(simulate::Request),
    /// Read parameters of a board
    Get {
        #[command(flatten)]
        port: Port,
        /// Parameters [default: all]
        path: Vec<String>,
    },
    /// Move parameters of a board
    Set {
        #[command(flatten)]
        port: Port,
        /// Where to
        #[arg(required = true, value_name = "PATH=VALUE")]
        values: Vec<String>,
        /// In so many seconds [default: as each parameter does]
        #[arg(long, value_name = "S")]
        ramp: Option<f32>,
    },
    /// Show the scenes of a board, or play one
    Scene {
        #[command(flatten)]
        port: Port,
        /// Its name or number
        name: Option<String>,
    },
    /// Show how a board is
    Status {
        #[command(flatten)]
        port: Port,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Say any line of the protocol to a board (`freshet send PORT help`)
    Send {
        #[command(flatten)]
        port: Port,
        /// The line
        #[arg(required = true)]
        line: Vec<String>,
    },
    /// Restart a board, pass the lines of the standard input to it, and record the session
    Record(record::Request),
    /// Play a recorded session to a WAV, sample for sample
    Replay(replay::Request),
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
            finished(&report.output, &report.summary(), report.interrupted)
        }
        Command::Bake(request) => {
            let report = bake::bake(&request, &*on_ctrl_c()?)?;
            finished(&request.output, &report.summary, report.interrupted)
        }
        Command::Modes(request) => say(&modes_command::run(&request)?),
        Command::Cloud(request) => match cloud_command::run(&request)?.as_str() {
            "" => Ok(ExitCode::SUCCESS),
            line => say(line),
        },
        Command::Transfer(request) => say(&transfer::transfer(&request)?),
        Command::Vessel(request) => say(&transfer::vessel(&request)?),
        Command::List => say(&list::list()?),
        Command::Describe { path, scene } => {
            say(&list::describe(path.as_deref(), scene.as_deref())?)
        }
        Command::Play { scene, seed, set } => play(&scene, seed, &set),
        Command::Bridge(request) => match bridge::bridge(&request, &on_ctrl_c()?)? {
            Some(text) => say(&text),
            None => Ok(ExitCode::SUCCESS),
        },
        Command::Flash(request) => flash(&request),
        Command::Control(request) => {
            let stop = on_ctrl_c()?;
            control::control(&request, &stop)?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Simulate(request) => simulate(&request),
        Command::Get { port, path } => say(&talk::get(&port, &path)?),
        Command::Set { port, values, ramp } => say(&talk::set(&port, &values, ramp)?),
        Command::Scene { port, name } => say(&talk::scene(&port, name.as_deref())?),
        Command::Status { port, json } => say(&talk::status(&port, json)?),
        Command::Send { port, line } => send(&port, &line.join(" ")),
        Command::Record(request) => {
            // What nobody reads is in the file nevertheless.
            record::record(&request, &*on_ctrl_c()?, |line| drop(say(line)))?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Replay(request) => {
            let report = replay::replay(&request, &*on_ctrl_c()?)?;
            finished(&report.output, &report.summary(), report.interrupted)
        }
        Command::Bench(request) => say(&bench::bench(&request)?),
    }
}

/// Tells what came of a sound that went to `output`.
fn finished(output: &Path, summary: &str, interrupted: bool) -> Result<ExitCode> {
    if output == Path::new("-") {
        say_aside(summary);
    } else {
        say(summary)?;
    }
    // As a shell reports a program that Ctrl-C ended.
    Ok(if interrupted {
        ExitCode::from(130)
    } else {
        ExitCode::SUCCESS
    })
}

fn simulate(request: &simulate::Request) -> Result<ExitCode> {
    let board = request.board.name();
    simulate::simulate(request, &*on_ctrl_c()?, |told| {
        match told {
            Told::Port(path) => {
                say(path)?;
                std::io::stdout().flush()?;
                say_aside(&format!("the twin of {board} is there; Ctrl-C ends it"));
            }
            Told::Late => say_aside(
                "this machine is too slow for that in real time: the twin's clock falls behind",
            ),
        }
        Ok(())
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Answers go to the standard output, refusals aside.
fn send(port: &Port, line: &str) -> Result<ExitCode> {
    let done = talk::send(port, line, |line| {
        if line.starts_with("error ") {
            say_aside(line);
        } else {
            // Nobody need read it.
            let _ = say(line);
        }
    })?;
    Ok(if done {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(2)
    })
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
