//! Where everything is on the screen.

use freshet::param::{TABLE, WEIGHT};
use ratatui::layout::Rect;

/// Smallest screen on which all can be reached.
pub const SMALLEST: (u16, u16) = (64, 18);
/// Columns of the list of scenes.
const SCENES: u16 = 17;
/// Columns left and right of a slider's bar: mark, name, gap; value, mark.
const NAME: u16 = 17;
const VALUE: u16 = 15;

/// The panes. Each begins with a row for its title.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Who is there, and what plays.
    pub header: Rect,
    /// How it is.
    pub telemetry: Rect,
    /// The scenes.
    pub scenes: Rect,
    /// The sliders.
    pub sliders: Rect,
    /// The histogram, or a spectrum as wide.
    pub classes: Rect,
    /// Columns of a bar.
    pub bar: u16,
    /// Levels and the small spectrum.
    pub sound: Rect,
    /// What the parameter under the cursor does.
    pub about: Rect,
    /// The keys, or a question.
    pub foot: Rect,
}

/// A row among the sliders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// The name of a group.
    Heading(&'static str),
    /// A slider, by its index in the table.
    Slider(usize),
}

/// The rows of the sliders that scroll: all but the intensity's, which always stands above them.
pub fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    let mut group = "";
    for (index, param) in TABLE.iter().enumerate().take(WEIGHT) {
        let Some((of, _)) = param.path.split_once('.') else {
            continue;
        };
        if of != group {
            group = of;
            rows.push(Row::Heading(group));
        }
        rows.push(Row::Slider(index));
    }
    rows
}

impl Layout {
    /// On a screen of that size; none where it is too small.
    pub fn new(area: Rect) -> Option<Self> {
        if area.width < SMALLEST.0 || area.height < SMALLEST.1 {
            return None;
        }
        let row = |y: u16| Rect::new(area.x, area.y + y, area.width, 1);
        let middle = area.height - 4;
        let low = (middle * 2 / 5).min(8).max(middle * 3 / 10).min(18);
        let high = middle - low;
        let bar = if area.width >= 160 { 2 } else { 1 };
        let classes = (64 * bar + 1).min(area.width.saturating_sub(12).max(48));
        let below = area.y + 2 + high;
        Some(Self {
            header: row(0),
            telemetry: row(1),
            scenes: Rect::new(area.x, area.y + 2, SCENES, high),
            sliders: Rect::new(
                area.x + SCENES + 1,
                area.y + 2,
                area.width - SCENES - 1,
                high,
            ),
            classes: Rect::new(area.x, below, classes, low),
            bar,
            sound: Rect::new(area.x + classes + 1, below, area.width - classes - 1, low),
            about: row(area.height - 2),
            foot: row(area.height - 1),
        })
    }

    /// The bar of a slider in row `y`.
    pub fn track(&self, y: u16) -> Rect {
        let width = self.sliders.width.saturating_sub(NAME + VALUE);
        Rect::new(self.sliders.x + NAME, y, width, 1)
    }

    /// Rows for sliders that scroll.
    pub fn slider_rows(&self) -> usize {
        usize::from(self.sliders.height - 2)
    }

    /// Rows for scenes.
    pub fn scene_rows(&self) -> usize {
        usize::from(self.scenes.height - 1)
    }

    /// Where the bars stand.
    pub fn bars(&self) -> Rect {
        let Rect {
            x,
            y,
            width,
            height,
        } = self.classes;
        Rect::new(x + 1, y + 1, width - 1, height - 1)
    }

    /// The part of a slider's way at a column.
    pub fn part(&self, column: u16) -> f32 {
        let track = self.track(0);
        let last = f32::from(track.width.saturating_sub(1)).max(1.0);
        (f32::from(column.saturating_sub(track.x)) / last).clamp(0.0, 1.0)
    }

    /// The class and the height at a place among the bars.
    pub fn bar_at(&self, column: u16, row: u16, classes: usize) -> (usize, f32) {
        let bars = self.bars();
        let class = usize::from(column.saturating_sub(bars.x) / self.bar);
        // The lowest row is nothing, the highest all.
        let from_below = (bars.y + bars.height - 1).saturating_sub(row);
        let height = f32::from(from_below) / f32::from(bars.height - 1);
        (class.min(classes - 1), height.clamp(0.0, 1.0))
    }
}

/// The first row to show, such that `cursor` is seen and no more than needed moves.
pub fn scrolled(first: usize, cursor: usize, shown: usize, rows: usize) -> usize {
    // A row around it, where there is one.
    let low = cursor.saturating_sub(1);
    let high = (cursor + 2).min(rows).saturating_sub(shown);
    let first = if shown > 2 {
        first.min(low).max(high)
    } else {
        cursor
    };
    first.min(rows.saturating_sub(shown))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_screen_has_room_for_all_panes() {
        for width in 0..300 {
            for height in 0..100 {
                let area = Rect::new(0, 0, width, height);
                let Some(layout) = Layout::new(area) else {
                    assert!(width < SMALLEST.0 || height < SMALLEST.1);
                    continue;
                };
                for pane in [layout.scenes, layout.sliders, layout.classes, layout.sound] {
                    assert!(
                        area.intersection(pane) == pane,
                        "{width}x{height} {layout:?}"
                    );
                    assert!(pane.height >= 3 && pane.width >= 11, "{layout:?}");
                }
                assert!(layout.track(5).width >= 10, "{layout:?}");
            }
        }
    }

    #[test]
    fn the_cursor_is_always_seen() {
        for shown in 1..40 {
            let mut first = 0;
            for cursor in (0..34).chain((0..34).rev()) {
                first = scrolled(first, cursor, shown, 34);
                assert!(
                    first <= cursor && cursor < first + shown,
                    "{shown} {cursor} {first}"
                );
            }
            assert_eq!(first, 0);
        }
    }
}
