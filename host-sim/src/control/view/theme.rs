//! How things look.

use ratatui::style::{Color, Modifier, Style};

/// Styles by what they mean.
#[derive(Clone, Copy, Debug)]
pub struct Theme {
    /// The program's name.
    pub title: Style,
    /// What stands out.
    pub strong: Style,
    /// What stands back.
    pub dim: Style,
    /// A pane's title.
    pub rule: Style,
    /// The title of the pane with the cursor.
    pub focus: Style,
    /// What the cursor is on.
    pub cursor: Style,
    /// A slider's way up to its value, and the bars.
    pub bar: Style,
    /// What is not as the scene has it.
    pub turned: Style,
    /// What went wrong.
    pub warning: Style,
}

impl Theme {
    /// With colours, or without.
    pub fn new(colour: bool) -> Self {
        let plain = Style::new();
        let bold = plain.add_modifier(Modifier::BOLD);
        let of = |style: Style, colour_of: Color| if colour { style.fg(colour_of) } else { style };
        Self {
            title: of(bold, Color::Cyan),
            strong: bold,
            // Faint only with colours: some terminals show faint as nothing.
            dim: of(plain, Color::DarkGray),
            rule: of(plain, Color::DarkGray),
            focus: of(bold, Color::Cyan),
            cursor: plain.add_modifier(Modifier::REVERSED),
            bar: of(plain, Color::Cyan),
            turned: of(bold, Color::Yellow),
            warning: of(bold, Color::Red),
        }
    }

    /// As the environment wants it: <https://no-color.org>.
    pub fn of_environment() -> Self {
        let set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        Self::new(!set("NO_COLOR") && !dumb)
    }
}
