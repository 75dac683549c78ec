//! `freshet get`, `set`, `scene`, `status` and `send`: a board from a script, in the protocol's own lines.

use std::fmt::Write;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use freshet::param::TABLE;
use freshet::protocol::{Line, Reply, Request, parse};

use crate::client::{BAUD, Client, Lines, Serial};

/// Time a board may take to answer a line.
const ANSWER: Duration = Duration::from_secs(2);

/// Where the board is.
#[derive(Clone, Debug, Args)]
pub struct Port {
    /// Its serial port: a path, on Windows a name such as COM3
    pub port: String,
    /// Bits a second
    #[arg(long, default_value_t = BAUD)]
    pub baud: u32,
}

impl Port {
    /// A client of the board there.
    pub fn client(&self) -> Result<Client> {
        Ok(Client::open(&self.port, self.baud)?)
    }

    /// Its lines.
    pub fn lines(&self) -> Result<Lines> {
        Ok(Lines::over(Serial::open(&self.port, self.baud)?)?)
    }
}

/// Values of `paths`, of all parameters where none is named: a line `path = value unit` each.
pub fn get(port: &Port, paths: &[String]) -> Result<String> {
    let mut board = port.client()?;
    let pairs = if paths.is_empty() {
        board.values()?
    } else {
        let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
        let values = board.get(&paths)?;
        let id = |path: &&str| Some(TABLE.iter().find(|param| param.path == *path)?.id);
        paths.iter().filter_map(id).zip(values).collect()
    };
    let replies: Vec<Reply<'_>> = pairs.into_iter().map(Reply::Value).collect();
    Ok(lines(&replies, &Request::Get(Default::default())))
}

/// Moves parameters, each given as `PATH=VALUE`, in `ramp` seconds.
pub fn set(port: &Port, values: &[String], ramp: Option<f32>) -> Result<String> {
    for value in values {
        if !value.contains('=') || value.contains(char::is_whitespace) {
            bail!("`{value}`: expected PATH=VALUE");
        }
    }
    let mut line = format!("set {}", values.join(" "));
    if let Some(ramp) = ramp {
        write!(line, " ramp={ramp}")?;
    }
    act(port, &line)
}

/// The scenes there are, or plays the one of that name or number.
pub fn scene(port: &Port, name: Option<&str>) -> Result<String> {
    let Some(name) = name else {
        let scenes = port.client()?.scenes()?;
        let reply = scenes.iter().map(|scene| Reply::Scene {
            number: scene.number,
            name: &scene.name,
            plays: scene.plays,
        });
        return Ok(lines(&reply.collect::<Vec<_>>(), &Request::Scenes));
    };
    act(port, &format!("scene {name}"))
}

/// How things stand, as lines or as JSON.
pub fn status(port: &Port, json: bool) -> Result<String> {
    let report = port.client()?.status()?;
    let status = report.status();
    if json {
        return Ok(serde_json::to_string_pretty(&status)?);
    }
    Ok(status.to_string().trim_end().to_owned())
}

/// Says any line to the board; `each` has the lines of the answer. True where it was done.
pub fn send(port: &Port, line: &str, each: impl FnMut(&str)) -> Result<bool> {
    Ok(port.lines()?.ask(line, ANSWER, each)?)
}

/// Does what a line says, where all of it can be read.
fn act(port: &Port, line: &str) -> Result<String> {
    let mut refused = Vec::new();
    let request = parse(line, &mut |refusal| refused.push(refusal.to_string()));
    if !refused.is_empty() {
        bail!("{}", refused.join("; "));
    }
    let request = request.map_err(|refusal| anyhow::anyhow!("{refusal}"))?;
    let (_, at) = port.client()?.ask(&request, |(), _| {})?;
    Ok(lines(&[Reply::Done { at }], &request))
}

/// Replies as the lines that a person would have got.
fn lines(replies: &[Reply<'_>], request: &Request<'_>) -> String {
    let lines: String = replies
        .iter()
        .map(|reply| Line(reply, request).to_string())
        .collect();
    lines.trim_end().to_owned()
}
