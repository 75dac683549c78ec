//! Keys and the mouse become actions.

use freshet::param::{self, WEIGHT};
use ratatui::crossterm::event::{
    KeyCode, KeyEvent, KeyEventKind, KeyModifiers, MouseButton, MouseEvent, MouseEventKind,
};
use ratatui::layout::{Position, Rect};

use super::action::Action;
use super::classes;
use super::layout::{Layout, Row, rows};
use super::model::{Focus, Model, Overlay};
use super::slider::Step;

/// What a key stands for.
pub fn key(model: &Model, key: KeyEvent) -> Option<Action> {
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    if control && matches!(key.code, KeyCode::Char('c')) {
        return Some(Action::Quit);
    }
    match model.overlay {
        Overlay::Prompt(..) => return typed(key, control),
        Overlay::Presets(_) => return among_presets(key),
        Overlay::Help => {
            return Some(match key.code {
                KeyCode::Char('q') => Action::Quit,
                _ => Action::Help,
            });
        }
        Overlay::None => {}
    }
    let step = if key.modifiers.contains(KeyModifiers::SHIFT) {
        Step::Coarse
    } else if control || key.modifiers.contains(KeyModifiers::ALT) {
        Step::Fine
    } else {
        Step::Usual
    };
    let upright = model.focus == Focus::Classes;
    Some(match key.code {
        KeyCode::Char('r') if control => Action::Redo,
        KeyCode::Char('z') if control => Action::Undo,
        // The histogram's bars go up and down, the sliders left and right.
        KeyCode::Up if upright => Action::Turn(step, 1),
        KeyCode::Down if upright => Action::Turn(step, -1),
        KeyCode::Right if upright => Action::Move(reach(step)),
        KeyCode::Left if upright => Action::Move(-reach(step)),
        KeyCode::Char('k' | 'K') if upright => Action::Turn(step, 1),
        KeyCode::Char('j' | 'J') if upright => Action::Turn(step, -1),
        KeyCode::Char('l' | 'L') if upright => Action::Move(reach(step)),
        KeyCode::Char('h' | 'H') if upright => Action::Move(-reach(step)),
        KeyCode::Up | KeyCode::Char('k' | 'K') => Action::Move(-reach(step)),
        KeyCode::Down | KeyCode::Char('j' | 'J') => Action::Move(reach(step)),
        KeyCode::Right | KeyCode::Char('l' | 'L') => Action::Turn(step, 1),
        KeyCode::Left | KeyCode::Char('h' | 'H') => Action::Turn(step, -1),
        KeyCode::Home => Action::Move(-1000),
        KeyCode::End => Action::Move(1000),
        KeyCode::PageUp => Action::Move(-8),
        KeyCode::PageDown => Action::Move(8),
        // For terminals that tell no arrows with shift or control.
        KeyCode::Char('+' | '=') => Action::Turn(Step::Usual, 1),
        KeyCode::Char('-' | '_') => Action::Turn(Step::Usual, -1),
        KeyCode::Char('}') => Action::Turn(Step::Coarse, 1),
        KeyCode::Char('{') => Action::Turn(Step::Coarse, -1),
        KeyCode::Char(']') => Action::Turn(Step::Fine, 1),
        KeyCode::Char('[') => Action::Turn(Step::Fine, -1),
        KeyCode::Char(digit @ '0'..='9') => {
            let digit = digit as u8 - b'0';
            Action::Intensity((f32::from(digit) / 9.0 * 100.0).round() / 100.0)
        }
        KeyCode::Enter | KeyCode::Char(':') => Action::Enter,
        KeyCode::Tab => Action::Next(1),
        KeyCode::BackTab => Action::Next(-1),
        KeyCode::Char(' ' | 'm') => Action::Mute,
        KeyCode::Char('t') => Action::Trigger,
        KeyCode::Char('d') => Action::Default,
        KeyCode::Char('D') | KeyCode::Backspace | KeyCode::Delete => Action::AsScene,
        KeyCode::Char('u') => Action::Undo,
        KeyCode::Char('U') => Action::Redo,
        KeyCode::Char('s') => Action::Save,
        KeyCode::Char('p') => Action::Presets,
        KeyCode::Char('v') => Action::View,
        KeyCode::Char('?') | KeyCode::F(1) => Action::Help,
        KeyCode::Char('q') => Action::Quit,
        _ => return None,
    })
}

fn reach(step: Step) -> i32 {
    if step == Step::Coarse { 5 } else { 1 }
}

fn typed(key: KeyEvent, control: bool) -> Option<Action> {
    Some(match key.code {
        KeyCode::Esc => Action::Cancel,
        KeyCode::Enter => Action::Accept,
        KeyCode::Backspace => Action::Backspace,
        KeyCode::Char(c) if !control => Action::Type(c),
        _ => return None,
    })
}

fn among_presets(key: KeyEvent) -> Option<Action> {
    Some(match key.code {
        KeyCode::Esc | KeyCode::Char('p' | 'q') => Action::Cancel,
        KeyCode::Up | KeyCode::Char('k') => Action::Move(-1),
        KeyCode::Down | KeyCode::Char('j') => Action::Move(1),
        KeyCode::Enter => Action::Accept,
        KeyCode::Char('w' | 's') => Action::Store,
        KeyCode::Char('x') | KeyCode::Delete => Action::Erase,
        _ => return None,
    })
}

/// What the mouse holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Grip {
    /// Nothing.
    #[default]
    None,
    /// A slider, by its index in the table.
    Slider(usize),
    /// The pen over the histogram, and where it was last.
    Pen((usize, f32)),
}

/// What the mouse does, and what it holds from then on.
pub fn mouse(model: &Model, layout: &Layout, event: MouseEvent, grip: &mut Grip) -> Vec<Action> {
    let at = Position::new(event.column, event.row);
    if model.overlay != Overlay::None {
        return match event.kind {
            MouseEventKind::Down(_) if !matches!(model.overlay, Overlay::Prompt(..)) => {
                vec![Action::Cancel]
            }
            _ => Vec::new(),
        };
    }
    let count = classes::count(&model.settings.values);
    match event.kind {
        MouseEventKind::Down(MouseButton::Left) => {
            if let Some(place) = scene_at(model, layout, at) {
                return vec![Action::Focus(Focus::Scenes), Action::Play(place)];
            }
            if let Some(index) = slider_at(model, layout, at) {
                let mut actions = vec![Action::Pause, Action::Select(index)];
                if layout.track(at.y).contains(at) {
                    *grip = Grip::Slider(index);
                    actions.push(Action::Slide(index, layout.part(at.x)));
                }
                return actions;
            }
            if !model.wide_spectrum && layout.bars().contains(at) {
                let point = layout.bar_at(at.x, at.y, count);
                *grip = Grip::Pen(point);
                return vec![
                    Action::Pause,
                    Action::Focus(Focus::Classes),
                    Action::Draw(point, point),
                ];
            }
            Vec::new()
        }
        MouseEventKind::Down(MouseButton::Right) => match slider_at(model, layout, at) {
            Some(index) => vec![Action::Select(index), Action::AsScene],
            None => Vec::new(),
        },
        MouseEventKind::Drag(MouseButton::Left) => match *grip {
            Grip::None => Vec::new(),
            Grip::Slider(index) => vec![Action::Slide(index, layout.part(at.x))],
            Grip::Pen(last) => {
                let point = layout.bar_at(at.x, at.y, count);
                *grip = Grip::Pen(point);
                vec![Action::Draw(last, point)]
            }
        },
        MouseEventKind::Up(_) => {
            *grip = Grip::None;
            vec![Action::Pause]
        }
        MouseEventKind::ScrollUp => wheel(model, layout, at, 1),
        MouseEventKind::ScrollDown => wheel(model, layout, at, -1),
        _ => Vec::new(),
    }
}

fn wheel(model: &Model, layout: &Layout, at: Position, by: i32) -> Vec<Action> {
    if layout.scenes.contains(at) {
        return vec![Action::Focus(Focus::Scenes), Action::Move(-by)];
    }
    if let Some(index) = slider_at(model, layout, at) {
        // Over the names it scrolls, over the bars it turns.
        return if at.x < layout.track(at.y).x {
            vec![Action::Focus(Focus::Parameters), Action::Move(-by)]
        } else {
            vec![Action::TurnThat(index, by)]
        };
    }
    if !model.wide_spectrum && layout.bars().contains(at) {
        let count = classes::count(&model.settings.values);
        let class = layout.bar_at(at.x, at.y, count).0;
        return vec![Action::TurnThat(WEIGHT + class, by)];
    }
    Vec::new()
}

fn row_in(pane: Rect, at: Position) -> Option<usize> {
    let inside = pane.contains(at) && at.y > pane.y;
    inside.then(|| usize::from(at.y - pane.y - 1))
}

fn scene_at(model: &Model, layout: &Layout, at: Position) -> Option<usize> {
    let place = row_in(layout.scenes, at)? + model.scroll.1;
    (place < model.scenes.len()).then_some(place)
}

fn slider_at(model: &Model, layout: &Layout, at: Position) -> Option<usize> {
    let Some(row) = row_in(layout.sliders, at)?.checked_sub(1) else {
        return Some(param::INTENSITY);
    };
    match rows().get(row + model.scroll.0)? {
        Row::Slider(index) => Some(*index),
        Row::Heading(_) => None,
    }
}
