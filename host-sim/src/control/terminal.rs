//! The terminal, as it has to be for this, and as it was before.

use std::io::{self, IsTerminal, Stdout, stdin, stdout};
use std::sync::Once;
use std::thread;

use anyhow::{Context, Result, bail};
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::Show;
use ratatui::crossterm::event::{DisableMouseCapture, EnableMouseCapture};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};

/// The screen; dropped, the terminal is as it was.
pub struct Screen {
    /// To draw on.
    pub terminal: Terminal<CrosstermBackend<Stdout>>,
}

/// Whether there is a terminal at all.
pub fn check() -> Result<()> {
    if !stdin().is_terminal() || !stdout().is_terminal() {
        bail!(
            "freshet control needs a terminal (for scripts there are `freshet set` and `freshet send`)"
        );
    }
    Ok(())
}

impl Screen {
    /// Takes the terminal.
    pub fn open() -> Result<Self> {
        check()?;
        restore_on_panic();
        enable_raw_mode().context("the terminal cannot be set up")?;
        // From here on it has to be restored.
        let entered = execute!(stdout(), EnterAlternateScreen, EnableMouseCapture);
        let terminal = entered.and_then(|()| Terminal::new(CrosstermBackend::new(stdout())));
        match terminal {
            Ok(terminal) => Ok(Self { terminal }),
            Err(error) => {
                restore();
                Err(error).context("the terminal cannot be set up")
            }
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        restore();
    }
}

/// As it was before. Where the terminal is gone, there is nothing to restore.
fn restore() {
    let _: io::Result<()> = execute!(stdout(), DisableMouseCapture, LeaveAlternateScreen, Show);
    let _ = disable_raw_mode();
}

/// A panic is to be read, and the shell after it to be usable.
fn restore_on_panic() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let (before, this) = (std::panic::take_hook(), thread::current().id());
        std::panic::set_hook(Box::new(move |info| {
            // The screen is not told of what another thread had.
            if thread::current().id() == this {
                restore();
                before(info);
            }
        }));
    });
}
