//! The control task: below audio, it computes the next tick while this one plays, and listens to the button.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Timer;
use freshet::Synth;
use freshet::control::Control;
use freshet::mix::Output;
use freshet::profile::Profile;
use static_cell::{ConstStaticCell, StaticCell};

use crate::audio::{self, Update};
use crate::board::{self, Capacity};
use crate::clock::SAMPLE_RATE;
use crate::flash::Scenes;
use crate::log;
use crate::supervisor::{self, Client};

/// The cloud's control path.
type Keeper = <Capacity as Profile>::Keeper;

/// What a person asks for.
enum Wish {
    NextScene,
}

/// Both updates stand in flash as they are at first: no stack would hold them on the way.
static UPDATES: ConstStaticCell<[Update; 2]> = ConstStaticCell::new([Update::new(), Update::new()]);

static WISHES: Channel<CriticalSectionRawMutex, Wish, 8> = Channel::new();

/// Reads the scenes and starts the sound.
pub fn start(button: board::Button, spawner: Spawner) {
    let scenes = Scenes::open();
    supervisor::set_trouble(scenes.damaged());
    let seed = scenes.seed();
    let control = first_control(&scenes, seed);
    let synth = first_synth(control, seed);
    let keeper = first_keeper(seed);
    let [first, next] = UPDATES.take().each_mut();
    tick(control, keeper, next);
    board::spawner().spawn(unwrap(audio::run(synth, first)));
    spawner.spawn(unwrap(run(control, keeper, next, scenes)));
    spawner.spawn(unwrap(watch(button)));
}

// Two functions, so that what both need on the way does not stand on the stack together.

#[inline(never)]
fn first_control(scenes: &Scenes, seed: u64) -> &'static mut Control {
    static CONTROL: StaticCell<Control> = StaticCell::new();
    let (name, scene) = scenes.scene(scenes.first());
    log::info!("scene {}, seed {}", name, seed);
    CONTROL.init_with(|| Control::new(&scene, SAMPLE_RATE, Capacity::MAX_RATE, seed))
}

#[inline(never)]
fn first_synth(control: &Control, seed: u64) -> &'static mut Synth<Capacity> {
    static SYNTH: StaticCell<Synth<Capacity>> = StaticCell::new();
    SYNTH.init_with(|| Synth::new(seed, Output::Bits24, control, SAMPLE_RATE))
}

#[inline(never)]
fn first_keeper(seed: u64) -> &'static mut Keeper {
    /// Where nothing has to be zero at first, beside what DMA reads: on an F4 the other memory is full.
    struct Place(UnsafeCell<MaybeUninit<Keeper>>);
    // SAFETY: only the first to come here gets at it.
    unsafe impl Sync for Place {}
    #[unsafe(link_section = ".dma")]
    static KEEPER: Place = Place(UnsafeCell::new(MaybeUninit::uninit()));
    static TAKEN: AtomicBool = AtomicBool::new(false);
    // PANIC: started twice is a fault of this program; the restart that follows says so.
    assert!(!TAKEN.swap(true, Ordering::AcqRel));
    // SAFETY: nobody else has it, as TAKEN says; the memory is there for good.
    unsafe { (*KEEPER.0.get()).write(Capacity::keeper(seed, SAMPLE_RATE)) }
}

/// Each task is started once, so there is a place for it.
fn unwrap<T>(token: Result<T, embassy_executor::SpawnError>) -> T {
    // PANIC: a task started twice is a fault of this program; the restart that follows says so.
    token.expect("each task is started once")
}

/// One tick after another.
#[embassy_executor::task]
async fn run(
    control: &'static mut Control,
    keeper: &'static mut Keeper,
    mut update: &'static mut Update,
    scenes: Scenes,
) {
    let mut playing = scenes.first();
    loop {
        update = audio::exchange(update).await;
        while let Ok(Wish::NextScene) = WISHES.try_receive() {
            playing = (playing + 1) % scenes.count();
            let (name, scene) = scenes.scene(playing);
            control.load(&scene);
            log::info!("scene {}", name);
        }
        tick(control, keeper, update);
        supervisor::check_in(Client::Control);
    }
}

/// Computes the next tick. A function of its own, so that it can be found and measured.
#[inline(never)]
fn tick(control: &mut Control, keeper: &mut Keeper, update: &mut Update) {
    control.tick(update);
    control.tick_cloud(keeper, update);
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
