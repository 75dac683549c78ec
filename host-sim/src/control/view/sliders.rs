//! The scenes, and the sliders of all parameters but the weights.

use freshet::param::{self, TABLE};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::super::layout::{Layout, Row, rows};
use super::super::model::{Focus, Model};
use super::super::slider::{position, shown_with_unit};
use super::{Theme, title};

pub(super) fn scenes(frame: &mut Frame<'_>, model: &Model, theme: &Theme, layout: &Layout) {
    let area = layout.scenes;
    let has_cursor = model.focus == Focus::Scenes;
    title(frame, theme, area, "scenes", has_cursor);
    let shown = model.scenes.iter().enumerate().skip(model.scroll.1);
    for (row, (place, scene)) in shown.take(layout.scene_rows()).enumerate() {
        let plays = model.playing() == Some(place);
        let mark = match (plays, plays && model.is_changed()) {
            (true, true) => "♪*",
            (true, false) => "♪ ",
            _ => "  ",
        };
        let at = has_cursor && place == model.scene_cursor;
        let name = format!("{:1$}", scene.name, usize::from(area.width) - 4);
        let style = match (at, plays) {
            (true, _) => theme.cursor,
            (false, true) => theme.strong,
            (false, false) => ratatui::style::Style::new(),
        };
        let pointer = if at { "▸" } else { " " };
        let line = Line::from(vec![
            Span::raw(pointer),
            Span::styled(mark, theme.turned),
            Span::styled(name, style),
        ]);
        let row = Rect::new(area.x, area.y + 1 + row as u16, area.width, 1);
        frame.render_widget(Paragraph::new(line), row);
    }
}

pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, theme: &Theme, layout: &Layout) {
    let area = layout.sliders;
    let rows = rows();
    let (first, shown) = (model.scroll.0, layout.slider_rows());
    let last = (first + shown).min(rows.len());
    let more = match (first > 0, last < rows.len()) {
        (true, true) => " ↑↓",
        (true, false) => " ↑",
        (false, true) => " ↓",
        (false, false) => "",
    };
    let name = format!("parameters{more}");
    title(frame, theme, area, &name, model.focus == Focus::Parameters);
    slider(frame, model, theme, layout, param::INTENSITY, area.y + 1);
    for (at, row) in rows[first.min(last)..last].iter().enumerate() {
        let y = area.y + 2 + at as u16;
        match row {
            Row::Heading(group) => {
                let line = Line::styled(format!("  {group}"), theme.dim);
                frame.render_widget(Paragraph::new(line), Rect::new(area.x, y, area.width, 1));
            }
            Row::Slider(index) => slider(frame, model, theme, layout, *index, y),
        }
    }
}

fn slider(
    frame: &mut Frame<'_>,
    model: &Model,
    theme: &Theme,
    layout: &Layout,
    index: usize,
    y: u16,
) {
    let area = layout.sliders;
    let param = &TABLE[index];
    let value = model.settings.values[index];
    let at = model.focus == Focus::Parameters && model.parameter == index;
    let follows = model.curves().iter().any(|curve| curve.param == index);
    let name = param.path.rsplit('.').next().unwrap_or(param.path);
    let pointer = if at { "▸" } else { " " };
    let wave = if follows { "~" } else { " " };
    let track = layout.track(y);
    let width = usize::from(track.x - area.x) - 3;
    let style = if at {
        theme.cursor
    } else {
        ratatui::style::Style::new()
    };
    let name = Line::from(vec![
        Span::raw(pointer),
        Span::styled(format!("{name:width$}"), style),
        Span::styled(wave, theme.dim),
    ]);
    let before = Rect::new(area.x, y, track.x - area.x - 1, 1);
    frame.render_widget(Paragraph::new(name), before);

    let last = f32::from(track.width.saturating_sub(1));
    let place = |value: f32| (position(param, value) * last).round() as usize;
    let (knob, default) = (place(value), place(param.default));
    let cells = usize::from(track.width);
    let glyph = |cell: usize| match cell {
        _ if cell == knob => ("●", theme.strong),
        _ if cell == default => ("┼", theme.dim),
        _ if cell < knob => ("━", theme.bar),
        _ => ("─", theme.dim),
    };
    let spans = (0..cells).map(|cell| {
        let (text, style) = glyph(cell);
        Span::styled(text, style)
    });
    frame.render_widget(Paragraph::new(Line::from_iter(spans)), track);

    let turned = model.is_turned(index);
    let text = shown_with_unit(param, value);
    let x = track.x + track.width + 1;
    let after = Rect::new(x, y, (area.x + area.width).saturating_sub(x), 1);
    let line = Line::from(vec![
        Span::styled(if turned { "*" } else { " " }, theme.turned),
        Span::styled(text, if turned { theme.turned } else { theme.strong }),
    ]);
    frame.render_widget(Paragraph::new(line), after);
}
