//! The control task: below audio, it computes the next tick while this one plays, and listens to the button.

use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Timer;
use freshet::Synth;
use freshet::control::Control;
use freshet::mix::Output;
use freshet::profile::Profile;
use static_cell::ConstStaticCell;

use crate::audio::{self, Update};
use crate::board::{self, Capacity};
use crate::clock::SAMPLE_RATE;
use crate::flash::Scenes;
use crate::log;
use crate::supervisor::{self, Client};

/// What a person asks for.
enum Wish {
    NextScene,
}

// No stack would hold any of these on the way: they are made in their places.
static CONTROL: ConstStaticCell<Control> = ConstStaticCell::new(Control::OFF);
static SYNTH: ConstStaticCell<Synth<Capacity>> = ConstStaticCell::new(Synth::OFF);
static UPDATES: ConstStaticCell<[Update; 2]> = ConstStaticCell::new([Update::new(), Update::new()]);

static WISHES: Channel<CriticalSectionRawMutex, Wish, 8> = Channel::new();

/// Reads the scenes and starts the sound.
pub fn start(button: board::Button, spawner: Spawner) {
    let scenes = Scenes::open();
    supervisor::set_trouble(scenes.damaged());
    let seed = scenes.seed();
    let (control, synth) = (CONTROL.take(), SYNTH.take());
    start_control(control, &scenes, seed);
    start_synth(synth, control, seed);
    let [first, next] = UPDATES.take().each_mut();
    tick(control, next);
    board::spawner().spawn(unwrap(audio::run(synth, first)));
    spawner.spawn(unwrap(run(control, next, scenes)));
    spawner.spawn(unwrap(watch(button)));
}

// Functions of their own, so that what each needs on the way stands on the stack only there.

#[inline(never)]
fn start_control(control: &mut Control, scenes: &Scenes, seed: u64) {
    let (name, scene) = scenes.scene(scenes.first());
    log::info!("scene {}, seed {}", name, seed);
    control.start(&scene, SAMPLE_RATE, Capacity::LIMITS, seed);
}

#[inline(never)]
fn start_synth(synth: &mut Synth<Capacity>, control: &Control, seed: u64) {
    synth.start(seed, Output::Bits24, control, SAMPLE_RATE);
}

#[inline(never)]
fn load(control: &mut Control, scenes: &Scenes, number: u16) {
    let (name, scene) = scenes.scene(number);
    control.load(&scene);
    log::info!("scene {}", name);
}

/// Each task is started once, so there is a place for it.
fn unwrap<T>(token: Result<T, embassy_executor::SpawnError>) -> T {
    // PANIC: a task started twice is a fault of this program; the restart that follows says so.
    token.expect("each task is started once")
}

/// One tick after another.
#[embassy_executor::task]
async fn run(control: &'static mut Control, mut update: &'static mut Update, scenes: Scenes) {
    let mut playing = scenes.first();
    loop {
        update = audio::exchange(update).await;
        while let Ok(Wish::NextScene) = WISHES.try_receive() {
            playing = (playing + 1) % scenes.count();
            load(control, &scenes, playing);
        }
        tick(control, update);
        supervisor::check_in(Client::Control);
    }
}

/// Computes the next tick. A function of its own, so that it can be found and measured.
#[inline(never)]
fn tick(control: &mut Control, update: &mut Update) {
    control.tick(update);
}

/// Waits for the button.
#[embassy_executor::task]
async fn watch(button: board::Button) {
    let mut was_down = false;
    loop {
        // Two looks that agree, 10 ms apart, are no bounce.
        let down = button.is_down();
        Timer::after_millis(10).await;
        if down == button.is_down() && down != was_down {
            was_down = down;
            if down {
                let _ = WISHES.try_send(Wish::NextScene);
            }
        }
    }
}
