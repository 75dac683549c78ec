//! Levels and the spectrum.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::super::model::Model;
use super::super::sound::{BANDS, HIGHEST, LOWEST};
use super::histogram::cell;
use super::{Theme, title};

/// What the lowest point of a meter reads, dB.
const FLOOR: f32 = -90.0;

/// Levels, and above them a spectrum as wide as the pane.
pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    let name = if model.here { "sound" } else { "twin here" };
    title(frame, theme, area, name, false);
    let levels = Rect::new(area.x, area.y + area.height - 2, area.width, 2);
    for (ear, name) in ["L", "R"].iter().enumerate() {
        level(frame, model, theme, levels, ear, name);
    }
    let inner = Rect::new(area.x, area.y + 1, area.width, area.height - 3);
    spectrum(frame, model, theme, inner);
}

fn level(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect, ear: usize, name: &str) {
    let (level, peak) = (model.sound.level[ear], model.sound.peak[ear]);
    let width = area.width.saturating_sub(6);
    let part = |level: f32| ((1.0 - level / FLOOR).clamp(0.0, 1.0) * f32::from(width)) as u16;
    let mut bar = String::new();
    for column in 0..width {
        bar.push(if column < part(level) {
            '█'
        } else if column + 1 == part(peak) {
            '|'
        } else {
            '·'
        });
    }
    let reads = if peak <= FLOOR {
        "-∞".to_owned()
    } else {
        format!("{peak:.0}")
    };
    let style = if peak > -0.5 {
        theme.warning
    } else {
        theme.bar
    };
    let line = Line::from(vec![
        Span::styled(name.to_owned(), theme.dim),
        Span::styled(bar, style),
        Span::raw(format!("{reads:>4}")),
    ]);
    let row = Rect::new(area.x, area.y + ear as u16, area.width, 1);
    frame.render_widget(Paragraph::new(line), row);
}

/// The spectrum alone, as wide as the histogram.
pub(super) fn spectrum_pane(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    let name = if model.here {
        "spectrum, 20 Hz to 20 kHz".to_owned()
    } else {
        "spectrum of a twin here with the same settings, 20 Hz to 20 kHz".to_owned()
    };
    title(frame, theme, area, &name, false);
    let inner = Rect::new(area.x, area.y + 1, area.width, area.height - 2);
    spectrum(frame, model, theme, inner);
    // Where the decades are.
    let mut scale = vec![' '; usize::from(area.width)];
    for (hertz, text) in [
        (50.0, "50"),
        (100.0, "100"),
        (200.0, "200"),
        (500.0, "500"),
        (1000.0, "1k"),
        (2000.0, "2k"),
        (5000.0, "5k"),
        (10_000.0, "10k"),
    ] {
        let part = (hertz / LOWEST).ln() / (HIGHEST / LOWEST).ln();
        let at = (part * f32::from(area.width)) as usize;
        for (place, letter) in text.chars().enumerate() {
            if let Some(cell) = scale.get_mut(at + place) {
                *cell = letter;
            }
        }
    }
    let row = Rect::new(area.x, area.y + area.height - 1, area.width, 1);
    let scale: String = scale.into_iter().collect();
    frame.render_widget(Paragraph::new(scale).style(theme.dim), row);
}

fn spectrum(frame: &mut Frame<'_>, model: &Model, theme: &Theme, area: Rect) {
    let bands = &model.sound.bands;
    let columns = usize::from(area.width);
    for column in 0..columns {
        let first = column * BANDS / columns;
        let last = ((column + 1) * BANDS / columns).clamp(first + 1, BANDS);
        let levels = bands.get(first..last).unwrap_or_default();
        let level = levels.iter().copied().fold(FLOOR, f32::max);
        // No bubble's partial comes near full scale.
        let height = ((level - FLOOR) / (-FLOOR - 10.0)).clamp(0.0, 1.0);
        for row in 0..area.height {
            let text = cell(height, area.height - 1 - row, area.height);
            let cell = frame
                .buffer_mut()
                .cell_mut((area.x + column as u16, area.y + row));
            if let Some(cell) = cell {
                cell.set_symbol(text).set_style(theme.bar);
            }
        }
    }
}
