//! What MIDI messages mean: controllers move parameters, programs are scenes, notes are bubbles.

use freshet::bubble::{Bubble, RADIUS_MAX, RADIUS_MIN};
use freshet::param::{self, Curve, Param, TABLE};

use super::midi::{Kind, Message};
use super::wish::{Command, SceneChoice, Wish, to};

/// Controllers from this on are commands to the instrument (all notes off …), not values.
pub const CONTROLLERS: u8 = 120;
/// Controllers below this may have their finer half at so many above.
pub const FINE: u8 = 32;

/// A controller that moves a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    /// 1 to 16; none: any.
    pub channel: Option<u8>,
    /// 0 to 119.
    pub cc: u8,
    /// Index in the table.
    pub param: usize,
    /// Values at the controller's ends; the first may be the higher one.
    pub range: (f32, f32),
    /// How it goes from one to the other.
    pub curve: Curve,
    /// Whether the controller 32 above has its finer half.
    pub fine: bool,
}

impl Rule {
    /// A controller over the whole range.
    pub fn whole(channel: Option<u8>, cc: u8, param: usize) -> Self {
        let Param {
            min, max, curve, ..
        } = TABLE[param];
        Self {
            channel,
            cc,
            param,
            range: (min, max),
            curve,
            fine: false,
        }
    }

    /// The value at `x` of the way.
    fn at(&self, x: f32) -> f32 {
        let param = Param {
            curve: self.curve,
            ..TABLE[self.param]
        };
        param.between(self.range.0, self.range.1, x)
    }
}

/// What program changes do.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Programs {
    /// 1 to 16; none: any.
    pub channel: Option<u8>,
    /// The scene of each program from 0 on; none at all: the board's scenes in its order.
    pub scenes: Vec<String>,
}

/// What notes do.
#[derive(Clone, Debug, PartialEq)]
pub struct Notes {
    /// 1 to 16; none: any.
    pub channel: Option<u8>,
    /// Pressure at 1 m of the softest and the hardest touch, Pa; in equal ratios between.
    pub pressure: (f32, f32),
    /// How it rises; none: as the drops do.
    pub rise_factor: Option<f32>,
}

impl Default for Notes {
    fn default() -> Self {
        Self {
            channel: None,
            pressure: (0.01, 1.0),
            // It keeps the pitch that was played.
            rise_factor: Some(0.0),
        }
    }
}

/// What all messages do.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// Controllers; one may move several parameters.
    pub rules: Vec<Rule>,
    /// None: nothing.
    pub programs: Option<Programs>,
    /// None: nothing.
    pub notes: Option<Notes>,
}

impl Default for Mapping {
    /// The modulation wheel is the intensity, the volume the level; programs are scenes, notes are bubbles.
    fn default() -> Self {
        let level = Rule {
            range: (-60.0, 0.0),
            ..Rule::whole(None, 7, param::LEVEL)
        };
        Self {
            rules: vec![Rule::whole(None, 1, param::INTENSITY), level],
            programs: Some(Programs::default()),
            notes: Some(Notes::default()),
        }
    }
}

/// Where the controllers stand, for those that have a finer half.
#[derive(Clone, Debug, Default)]
pub struct Positions([[u8; FINE as usize]; 16]);

impl Mapping {
    /// What `message` means; or why it means nothing.
    pub fn wishes(&self, message: Message, positions: &mut Positions) -> Result<Vec<Wish>, String> {
        let Message { channel, kind } = message;
        let hears = |own: Option<u8>| own.is_none_or(|own| own == channel);
        match kind {
            Kind::Control(cc, value) => Ok(self.control(channel, cc, value, positions)),
            Kind::Program(number) => match &self.programs {
                Some(programs) if hears(programs.channel) => {
                    program(programs, number).map(|wish| vec![wish])
                }
                _ => Ok(Vec::new()),
            },
            Kind::NoteOn(note, velocity) => match &self.notes {
                Some(notes) if hears(notes.channel) => {
                    bubble(notes, note, velocity).map(|wish| vec![wish])
                }
                _ => Ok(Vec::new()),
            },
        }
    }

    fn control(&self, channel: u8, cc: u8, value: u8, positions: &mut Positions) -> Vec<Wish> {
        let here = &mut positions.0[usize::from(channel - 1) % 16];
        if let Some(coarse) = here.get_mut(usize::from(cc)) {
            *coarse = value;
        }
        let rules = self.rules.iter();
        let rules = rules.filter(|rule| rule.channel.is_none_or(|own| own == channel));
        rules
            .filter_map(|rule| {
                let x = if !rule.fine {
                    (rule.cc == cc).then(|| f32::from(value) / 127.0)?
                } else {
                    // The coarse half begins anew; the finer one, which comes after, adds to it.
                    let fine = match cc {
                        cc if cc == rule.cc => 0,
                        cc if cc == rule.cc + FINE => value,
                        _ => return None,
                    };
                    let coarse = *here.get(usize::from(rule.cc))?;
                    f32::from(u16::from(coarse) << 7 | u16::from(fine)) / 16_383.0
                };
                Some(to(rule.param, rule.at(x)))
            })
            .collect()
    }
}

fn program(programs: &Programs, number: u8) -> Result<Wish, String> {
    let choice = if programs.scenes.is_empty() {
        SceneChoice::Number(number.into())
    } else {
        let name = programs.scenes.get(usize::from(number));
        let name = name.ok_or_else(|| {
            let count = programs.scenes.len();
            format!("program {number}: the mapping has scenes for {count} programs, from 0")
        })?;
        SceneChoice::Name(name.clone())
    };
    Ok(Wish::Command(Command::Scene(choice)))
}

fn bubble(notes: &Notes, note: u8, velocity: u8) -> Result<Wish, String> {
    let radius = radius(note).ok_or_else(|| {
        let lowest = Bubble::new(RADIUS_MAX).pitch();
        format!(
            "note {note} is {:.1} Hz; no bubble is lower than {lowest:.1} Hz",
            pitch(note)
        )
    })?;
    let x = f32::from(velocity.max(1) - 1) / 126.0;
    let (soft, hard) = notes.pressure;
    let pressure = soft * (hard / soft).powf(x);
    let pressure = pressure.clamp(soft.min(hard), soft.max(hard));
    let bubble = [Some(radius), Some(pressure), notes.rise_factor];
    Ok(Wish::Command(Command::Trigger(bubble)))
}

/// The pitch of a key, Hz: 69 is 440.
fn pitch(note: u8) -> f64 {
    440.0 * ((f64::from(note) - 69.0) / 12.0).exp2()
}

/// The radius, in mm, of the bubble that rings at the pitch of `note`; none where no bubble does.
pub fn radius(note: u8) -> Option<f32> {
    let wanted = pitch(note);
    let (mut small, mut large) = (RADIUS_MIN, RADIUS_MAX);
    let possible = Bubble::new(large).pitch()..=Bubble::new(small).pitch();
    if !possible.contains(&wanted) {
        return None;
    }
    // The larger, the lower.
    for _ in 0..60 {
        let middle = (small * large).sqrt();
        if Bubble::new(middle).pitch() > wanted {
            small = middle;
        } else {
            large = middle;
        }
    }
    Some((small * 1e3) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::wish::Move;
    use super::*;

    fn control(channel: u8, cc: u8, value: u8) -> Message {
        let kind = Kind::Control(cc, value);
        Message { channel, kind }
    }

    fn value(wish: &Wish) -> f32 {
        match wish {
            Wish::Move(Move { value, .. }) => *value,
            Wish::Command(_) => panic!("no move"),
        }
    }

    #[test]
    fn a_bubble_rings_at_the_notes_pitch() {
        for note in 0..128 {
            match radius(note) {
                Some(radius) => {
                    let rings = Bubble::new(f64::from(radius) * 1e-3).pitch();
                    assert!((rings / pitch(note) - 1.0).abs() < 1e-6, "note {note}");
                }
                None => assert!(note < 18, "note {note}"),
            }
        }
        // Minnaert: 3.26 m/s over the frequency.
        assert!((radius(69).unwrap() - 7.4).abs() < 0.1);
    }

    #[test]
    fn a_controller_goes_along_the_curve_from_end_to_end() {
        let mut positions = Positions::default();
        for (index, param) in TABLE.iter().enumerate() {
            let mapping = Mapping {
                rules: vec![Rule::whole(Some(2), 20, index)],
                ..Mapping::default()
            };
            let mut before = param.min;
            for x in 0..128 {
                let wishes = mapping.wishes(control(2, 20, x), &mut positions).unwrap();
                let value = value(&wishes[0]);
                assert!(
                    param.accepts(value) && value >= before,
                    "{} {value}",
                    param.path
                );
                before = value;
            }
            assert_eq!(before, param.max);
            let other = mapping.wishes(control(3, 20, 5), &mut positions).unwrap();
            assert_eq!(other, []);
        }
    }

    #[test]
    fn a_finer_half_adds_steps() {
        let fine = Rule {
            fine: true,
            ..Rule::whole(None, 16, param::INTENSITY)
        };
        let mapping = Mapping {
            rules: vec![fine],
            ..Mapping::default()
        };
        let mut positions = Positions::default();
        let mut at = |cc, x| {
            let wishes = mapping.wishes(control(1, cc, x), &mut positions).unwrap();
            value(&wishes[0])
        };
        assert_eq!(at(16, 64), 8192.0 / 16_383.0);
        assert_eq!(at(48, 1), 8193.0 / 16_383.0);
        at(16, 127);
        assert_eq!(at(48, 127), 1.0);
    }

    #[test]
    fn a_harder_touch_is_louder() {
        let notes = Notes::default();
        let pressure = |velocity| match bubble(&notes, 60, velocity) {
            Ok(Wish::Command(Command::Trigger([_, Some(pressure), Some(0.0)]))) => pressure,
            other => panic!("{other:?}"),
        };
        assert_eq!((pressure(1), pressure(127)), (0.01, 1.0));
        assert!((pressure(64) - 0.1).abs() < 1e-3);
        assert!(bubble(&notes, 5, 64).is_err());
    }
}
