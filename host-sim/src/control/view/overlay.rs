//! The bottom line, the help and the presets.

use freshet::param::TABLE;
use freshet::protocol::{SLOTS, Slot};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::{Block, Clear, Paragraph};

use super::super::model::{Ask, Focus, Model, Overlay};
use super::super::slider::shown_with_unit;
use super::Theme;
use crate::scene_file::expectation;

/// A question, the last word, or the keys.
pub(super) fn foot(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    if let Overlay::Prompt(ask, text) = &model.overlay {
        let asked = question(model, ask);
        let line = format!(" {asked} {text}");
        // The end of a long answer is seen.
        let width = usize::from(area.width).saturating_sub(1);
        let skip = line.chars().count().saturating_sub(width);
        let seen: String = line.chars().skip(skip).collect();
        let x = area.x + seen.chars().count().min(width) as u16;
        frame.render_widget(Paragraph::new(seen).style(theme.strong), area);
        frame.set_cursor_position((x, area.y));
        return;
    }
    if let Some(message) = &model.message {
        let style = if message.is_warning {
            theme.warning
        } else {
            theme.strong
        };
        let mark = if message.is_warning { "!" } else { "" };
        let text = format!(" {mark}{}", message.text);
        return frame.render_widget(Paragraph::new(text).style(style), area);
    }
    let keys = match model.focus {
        Focus::Scenes => "↑↓ choose  enter play  ←→ intensity  tab sliders  0-9 intensity  m mute",
        Focus::Parameters => {
            "↑↓ choose  ←→ turn (shift ×10, ctrl ÷10)  enter value  u undo  s save"
        }
        Focus::Classes => {
            "←→ choose  ↑↓ raise (shift, ctrl)  mouse draws  d default  u undo  s save"
        }
    };
    frame.render_widget(Paragraph::new(format!(" {keys}")).style(theme.dim), area);
}

fn question(model: &Model, ask: &Ask) -> String {
    match ask {
        Ask::Value(index) => {
            let param = &TABLE[*index];
            let now = shown_with_unit(param, model.settings.values[*index]);
            format!("{} is {now}; {}:", param.path, expectation(param))
        }
        Ask::File => "save as:".to_owned(),
        Ask::Overwrite(path) => {
            format!("{} is there already; write over it? (y/n)", path.display())
        }
        Ask::Name(slot) => format!("name of preset {slot} (may be empty):"),
        Ask::Replace(slot, _) => format!("preset {slot} is there already; write over it? (y/n)"),
        Ask::Erase(slot) => format!("forget preset {slot}? (y/n)"),
    }
}

const HELP: &[&str] = &[
    "tab, shift-tab   next pane: scenes, parameters, classes",
    "arrows, hjkl     choose and turn    shift: coarse    ctrl, alt: fine",
    "+ -   { }   [ ]  turn: usual, coarse, fine",
    "0 .. 9           intensity, from nothing to all",
    "enter            play the scene; type a value (unit may follow)",
    "d     D          back to the default; back to the scene's value",
    "u     U, ctrl-r  undo; redo",
    "m, space    t    mute; sound a bubble",
    "p                presets: enter recalls, w keeps, x forgets",
    "s                save as a scene file for freshet render",
    "v                spectrum in place of the classes",
    "q, ctrl-c        quit; the board plays on",
    "mouse            click a scene; drag sliders; draw the classes;",
    "                 wheel turns; right button: back to the scene's value",
    "",
    "* not as the scene has it   ~ moved by the intensity   ┼ default",
];

pub(super) fn help(frame: &mut Frame<'_>, theme: &Theme, area: Rect) {
    let lines = HELP.iter().map(|line| Line::raw(format!(" {line}")));
    window(frame, theme, area, " keys ", lines.collect(), 70);
}

pub(super) fn presets(
    frame: &mut Frame<'_>,
    model: &Model,
    theme: &Theme,
    area: Rect,
    cursor: Slot,
) {
    let line = |slot: Slot| {
        let kept = model.presets.iter().find(|preset| preset.slot == slot);
        let text = match kept {
            Some(preset) if preset.name.is_empty() => format!("over {}", preset.scene),
            Some(preset) => format!("{} (over {})", preset.name, preset.scene),
            None => "-".to_owned(),
        };
        let number = if slot == 0 {
            "stored".to_owned()
        } else {
            slot.to_string()
        };
        let pointer = if slot == cursor { "▸" } else { " " };
        let style = if slot == cursor {
            theme.cursor
        } else {
            Style::new()
        };
        Line::styled(format!("{pointer}{number:>6}  {text:44}"), style)
    };
    let room = usize::from(area.height).saturating_sub(4);
    let first = usize::from(cursor + 1).saturating_sub(room);
    let lines = (0..=SLOTS).skip(first).take(room).map(line);
    let name = " presets: enter recalls, w keeps, x forgets, esc ";
    window(frame, theme, area, name, lines.collect(), 56);
}

fn window(
    frame: &mut Frame<'_>,
    theme: &Theme,
    area: Rect,
    name: &str,
    lines: Vec<Line<'_>>,
    width: u16,
) {
    let width = width.min(area.width);
    let height = (lines.len() as u16 + 2).min(area.height);
    let window = Rect::new(
        area.x + (area.width - width) / 2,
        area.y + (area.height - height) / 2,
        width,
        height,
    );
    frame.render_widget(Clear, window);
    let block = Block::bordered()
        .title(name.to_owned())
        .border_style(theme.focus);
    frame.render_widget(Paragraph::new(lines).block(block), window);
}
