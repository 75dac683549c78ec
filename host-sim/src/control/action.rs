//! What a person can do.

use super::model::Focus;
use super::slider::Step;

/// Something that a key or the mouse stands for.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Ends the program.
    Quit,
    /// The next pane, or the one before.
    Next(i32),
    /// That pane.
    Focus(Focus),
    /// The cursor moves in its pane.
    Move(i32),
    /// What the cursor is on goes up or down by so many steps.
    Turn(Step, i32),
    /// Turns one parameter, wherever the cursor is.
    TurnThat(usize, i32),
    /// The intensity, from 0 to 1.
    Intensity(f32),
    /// What the cursor is on, back to the table's value.
    Default,
    /// The same, back to the scene's value.
    AsScene,
    /// Plays the scene under the cursor; on a parameter: asks for a value.
    Enter,
    /// Plays a scene by its place in the list.
    Play(usize),
    /// A gesture begins or ends.
    Pause,
    /// Puts the cursor on a parameter.
    Select(usize),
    /// Puts a slider at a part of its way.
    Slide(usize, f32),
    /// Draws in the histogram, from one `(class, height)` to another.
    Draw((usize, f32), (usize, f32)),
    /// Takes the last gesture back.
    Undo,
    /// Takes that back.
    Redo,
    /// Asks for a file name.
    Save,
    /// Silence, and back.
    Mute,
    /// Sounds a bubble.
    Trigger,
    /// Shows the presets.
    Presets,
    /// Shows the help.
    Help,
    /// The bars of the classes, or the spectrum.
    View,
    /// What is asked is answered.
    Accept,
    /// What is asked is not answered.
    Cancel,
    /// A character of the answer.
    Type(char),
    /// The last one again.
    Backspace,
    /// In the list of presets: keep the settings here.
    Store,
    /// In the list of presets: forget what is here.
    Erase,
}
