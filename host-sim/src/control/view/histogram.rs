//! The radius classes as bars.

use freshet::param::{self, LAWS};
use ratatui::Frame;
use ratatui::style::Modifier;

use super::super::classes;
use super::super::layout::Layout;
use super::super::model::{Focus, Model};
use super::super::slider::number;
use super::{Theme, title};

/// Eighths of a cell.
pub(super) const EIGHTHS: [&str; 9] = [" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"];

/// The cell of a bar of that height, so many cells above the lowest one.
pub(super) fn cell(height: f32, from_below: u16, rows: u16) -> &'static str {
    let eighths = (height.clamp(0.0, 1.0) * f32::from(rows) * 8.0).round() as i32;
    EIGHTHS[(eighths - i32::from(from_below) * 8).clamp(0, 8) as usize]
}

pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, theme: &Theme, layout: &Layout) {
    let values = &model.settings.values;
    let count = classes::count(values);
    let custom = values[param::LAW] == classes::CUSTOM;
    let law = LAWS.get(values[param::LAW] as usize).unwrap_or(&"?");
    let name = format!(
        "{count} classes, {} to {} mm, law {law}{}",
        number(classes::radius(values, 0)),
        number(classes::radius(values, count - 1)),
        if custom { "" } else { ": draw to take over" },
    );
    let has_cursor = model.focus == Focus::Classes;
    title(frame, theme, layout.classes, &name, has_cursor);
    let bars = layout.bars();
    let shown = count.min(usize::from(bars.width / layout.bar));
    for class in 0..shown {
        let height = classes::height(classes::weight(values, class));
        let at = has_cursor && class == model.class;
        for row in 0..bars.height {
            let from_below = bars.height - 1 - row;
            let mut text = cell(height, from_below, bars.height);
            // What is nothing is seen too, and so is the cursor.
            if from_below == 0 && text == " " {
                text = if height > 0.0 { "▁" } else { "." };
            }
            if at && row == 0 && text == " " {
                text = "▾";
            }
            let mut style = if custom { theme.bar } else { theme.dim };
            if model.is_turned(param::WEIGHT + class) && custom {
                style = theme.turned;
            }
            if at {
                style = theme.strong;
                if text != "▾" {
                    style = style.add_modifier(Modifier::REVERSED);
                }
            }
            for column in 0..layout.bar {
                let x = bars.x + class as u16 * layout.bar + column;
                let cell = frame.buffer_mut().cell_mut((x, bars.y + row));
                if let Some(cell) = cell {
                    cell.set_symbol(text).set_style(style);
                }
            }
        }
    }
}
