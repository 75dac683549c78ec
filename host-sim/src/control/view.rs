//! The screen of a model. Nothing is told by colour alone.

mod histogram;
mod meters;
mod overlay;
mod sliders;
mod theme;

pub use theme::Theme;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use freshet::param::{self, TABLE};

use super::classes;
use super::layout::{Layout, SMALLEST};
use super::model::{Focus, Model, Overlay};
use super::slider::{number, shown_with_unit};

/// Draws all of it.
pub fn draw(frame: &mut Frame<'_>, model: &Model, theme: &Theme) {
    let area = frame.area();
    let Some(layout) = Layout::new(area) else {
        let (width, height) = SMALLEST;
        let text = format!(
            "freshet control needs {width}x{height}; this terminal has {}x{}. q quits.",
            area.width, area.height
        );
        let text = Paragraph::new(text).wrap(ratatui::widgets::Wrap { trim: true });
        return frame.render_widget(text, area);
    };
    header(frame, model, theme, layout.header);
    telemetry(frame, model, theme, layout.telemetry);
    sliders::scenes(frame, model, theme, &layout);
    sliders::draw(frame, model, theme, &layout);
    if model.wide_spectrum {
        meters::spectrum_pane(frame, model, theme, layout.classes);
    } else {
        histogram::draw(frame, model, theme, &layout);
    }
    meters::draw(frame, model, theme, layout.sound);
    about(frame, model, theme, layout.about);
    overlay::foot(frame, model, theme, layout.foot);
    match model.overlay {
        Overlay::Help => overlay::help(frame, theme, area),
        Overlay::Presets(slot) => overlay::presets(frame, model, theme, area, slot),
        Overlay::None | Overlay::Prompt(..) => {}
    }
}

fn header(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    let changed = if model.is_changed() { "*" } else { "" };
    let scene = format!(" {}{changed} ", model.settings.scene);
    let on = if model.here { "'s twin," } else { " on" };
    // The end of a long path tells most.
    let port: Vec<char> = model.port.chars().collect();
    let room = usize::from(area.width).saturating_sub(56).max(12);
    let port = if port.len() > room {
        let end: String = port[port.len() - room..].iter().collect();
        format!("…{end}")
    } else {
        port.into_iter().collect()
    };
    let place = format!(" {}{on} {port}", model.hello.board);
    let state = match (&model.lost, model.muted) {
        (Some(_), _) => " [gone] ",
        (None, true) => " [muted] ",
        (None, false) => " ",
    };
    let left = Line::from(vec![
        Span::styled(" freshet", theme.title),
        Span::styled(scene, theme.strong),
        Span::styled(state, theme.warning),
        Span::styled(place, theme.dim),
    ]);
    frame.render_widget(Paragraph::new(left), area);
    right(frame, Line::styled("? help  q quit ", theme.dim), area);
}

/// A line at the right edge.
fn right(frame: &mut Frame<'_>, line: Line<'_>, area: Rect) {
    let width = (line.width() as u16).min(area.width);
    let area = Rect::new(area.x + area.width - width, area.y, width, 1);
    frame.render_widget(Paragraph::new(line), area);
}

fn telemetry(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    if let Some(why) = &model.lost {
        let text = format!(" trying again: {why}");
        return frame.render_widget(Paragraph::new(text).style(theme.warning), area);
    }
    let Some(report) = &model.report else {
        return frame.render_widget(
            Paragraph::new(" waiting for a report").style(theme.dim),
            area,
        );
    };
    let status = report.status();
    let mut parts = vec![
        format!("{} voices", status.voices),
        format!("{} births/s", number(model.births.round())),
    ];
    if status.load > 0.0 {
        let (load, peak) = (100.0 * status.load, 100.0 * status.peak);
        parts.insert(0, format!("load {load:.0}% (peak {peak:.0}%)"));
    }
    if let Some(celsius) = status.temperature {
        parts.push(format!("{celsius:.0} °C"));
    }
    let up = status.uptime;
    parts.push(format!(
        "up {}:{:02}:{:02}",
        up / 3600,
        up / 60 % 60,
        up % 60
    ));
    let mut faults = Vec::new();
    for (count, what) in [
        (status.underruns, "underruns"),
        (status.missed, "missed"),
        (status.unvoiced, "unvoiced"),
        (status.stolen, "stolen"),
        (status.clipped, "clipped"),
        (status.limited, "limited"),
    ] {
        if count > 0 {
            faults.push(format!("{count} {what}"));
        }
    }
    let mut spans = vec![Span::styled(
        format!(" {}", parts.join(" · ")),
        Style::new(),
    )];
    if !faults.is_empty() {
        spans.push(Span::styled(
            format!(" · {}", faults.join(" · ")),
            theme.dim,
        ));
    }
    if status.trouble {
        spans.insert(0, Span::styled(" TROUBLE", theme.warning));
    }
    frame.render_widget(Paragraph::new(Line::from(spans)), area);
}

/// What the cursor is on.
fn about(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    let text = match model.focus {
        Focus::Scenes => match model.scenes.get(model.scene_cursor) {
            Some(scene) => match &scene.file {
                Some(file) => format!("{}: {}", scene.name, file.sounds),
                None => scene.name.clone(),
            },
            None => String::new(),
        },
        Focus::Classes => {
            let values = &model.settings.values;
            format!(
                "class {}: radius {} mm, {} Hz, weight {}",
                model.class + 1,
                number(classes::radius(values, model.class)),
                number(classes::pitch(values, model.class).round()),
                number(classes::weight(values, model.class)),
            )
        }
        Focus::Parameters => {
            let param = &TABLE[model.parameter];
            let ends = format!(
                "{} to {}",
                number(param.min),
                shown_with_unit(param, param.max)
            );
            let range = match param.kind {
                param::Kind::Choice(names) => names.join(", "),
                _ => ends,
            };
            let default = super::slider::shown(param, param.default);
            format!(
                "{}: {range}, default {default}: {}",
                param.path, param.about
            )
        }
    };
    frame.render_widget(Paragraph::new(format!(" {text}")).style(theme.dim), area);
}

/// The first row of a pane; the one with the cursor says so.
fn title(frame: &mut Frame<'_>, theme: &Theme, area: Rect, text: &str, has_cursor: bool) {
    let mark = if has_cursor { "▶" } else { "─" };
    let mut line = format!("{mark} {text} ");
    let width = line.chars().count();
    line.extend(std::iter::repeat_n(
        '─',
        usize::from(area.width).saturating_sub(width),
    ));
    let style = if has_cursor { theme.focus } else { theme.rule };
    let row = Rect::new(area.x, area.y, area.width, 1);
    frame.render_widget(Paragraph::new(line).style(style), row);
}
