//! The control task: below audio, it computes the next tick while this one plays, and listens to the serial line and the
//! button.

use cortex_m::peripheral::SCB;
use embassy_executor::Spawner;
use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer};
use freshet::Synth;
use freshet::cloud::Keep;
use freshet::control::Control;
use freshet::mix::Output;
use freshet::profile::Profile;
use freshet::protocol::{Device as _, Refusal, Shell};
use static_cell::ConstStaticCell;

use crate::audio::{self, Update};
use crate::board::{self, Capacity};
use crate::clock::SAMPLE_RATE;
use crate::device::{Device, First, Past, Work};
use crate::flash::Scenes;
use crate::log;
use crate::serial::Line;
use crate::storage;
use crate::supervisor::{self, Client};

/// The cloud's control path.
type Keeper = <Capacity as Profile>::Keeper;

/// What a person asks for.
enum Wish {
    NextScene,
}

// No stack would hold any of these on the way: they are made in their places.
static CONTROL: ConstStaticCell<Control> = ConstStaticCell::new(Control::OFF);
static SYNTH: ConstStaticCell<Synth<Capacity>> = ConstStaticCell::new(Synth::OFF);
static KEEPER: ConstStaticCell<Keeper> = ConstStaticCell::new(Capacity::KEEPER);
static UPDATES: ConstStaticCell<[Update; 2]> = ConstStaticCell::new([Update::new(), Update::new()]);

/// Bytes of answers that may wait to be sent.
const ANSWERS: usize = 2048;

/// The protocol on the serial line.
static SHELL: ConstStaticCell<Shell<ANSWERS>> = ConstStaticCell::new(Shell::new());

/// The same on the USB port.
#[cfg(feature = "usb")]
static USB_SHELL: ConstStaticCell<Shell<ANSWERS>> = ConstStaticCell::new(Shell::new());

static WISHES: Channel<CriticalSectionRawMutex, Wish, 8> = Channel::new();

/// Reads the scenes and starts the sound.
pub fn start(
    button: board::Button,
    past: Past,
    #[cfg(feature = "usb")] port: crate::usb::Port,
    spawner: Spawner,
) {
    let scenes = Scenes::open();
    let (mut kept, sound) = block_on(storage::open());
    let seed = scenes.seed();
    let first = First::choose(&scenes, &mut kept);
    supervisor::set_trouble(scenes.damaged() | !sound | first.trouble);
    let playing = first.number;
    let (control, synth) = (CONTROL.take(), SYNTH.take());
    start_control(control, &first, seed);
    start_synth(synth, control, seed);
    let [first, next] = UPDATES.take().each_mut();
    let keeper = KEEPER.take();
    keeper.start(seed, SAMPLE_RATE);
    tick(control, keeper, next);
    board::spawner().spawn(unwrap(audio::run(synth, first)));
    let device = Device::new(control, scenes, playing, kept, past);
    let doors = Doors {
        line: Line::start(),
        shell: SHELL.take(),
        #[cfg(feature = "usb")]
        port,
        #[cfg(feature = "usb")]
        usb_shell: USB_SHELL.take(),
    };
    spawner.spawn(unwrap(run(device, keeper, next, doors)));
    spawner.spawn(unwrap(watch(button)));
}

// Functions of their own, so that what each needs on the way stands on the stack only there.

#[inline(never)]
fn start_control(control: &mut Control, first: &First, seed: u64) {
    log::info!("scene {}, seed {}", first.number, seed);
    control.start(&first.scene, SAMPLE_RATE, Capacity::LIMITS, seed);
}

#[inline(never)]
fn start_synth(synth: &mut Synth<Capacity>, control: &Control, seed: u64) {
    synth.start(seed, Output::Bits24, control, SAMPLE_RATE);
}

/// Each task is started once, so there is a place for it.
fn unwrap<T>(token: Result<T, embassy_executor::SpawnError>) -> T {
    // PANIC: a task started twice is a fault of this program; the restart that follows says so.
    token.expect("each task is started once")
}

/// Where the protocol is spoken.
struct Doors {
    line: Line,
    shell: &'static mut Shell<ANSWERS>,
    #[cfg(feature = "usb")]
    port: crate::usb::Port,
    #[cfg(feature = "usb")]
    usb_shell: &'static mut Shell<ANSWERS>,
}

impl Doors {
    fn greet(&mut self, device: &Device) {
        self.shell.greet(device);
        #[cfg(feature = "usb")]
        self.usb_shell.greet(device);
    }

    /// Once a tick.
    fn look(&mut self, device: &mut Device) {
        (self.line).receive(|bytes| self.shell.receive(bytes, device));
        self.shell.tick(device);
        #[cfg(feature = "usb")]
        {
            (self.port).receive(|bytes| self.usb_shell.receive(bytes, device));
            self.usb_shell.tick(device);
        }
        self.send();
    }

    fn send(&mut self) {
        self.line.send(self.shell.out());
        #[cfg(feature = "usb")]
        self.port.send(self.usb_shell.out());
    }

    /// A job is over: the shell that began it answers.
    fn finished(&mut self, result: Result<(), Refusal<'static>>, device: &Device) {
        self.shell.finished(result, device);
        #[cfg(feature = "usb")]
        self.usb_shell.finished(result, device);
    }

    /// Starts the chip again, when the answer is out, or the line does not take it.
    async fn restart(&mut self) -> ! {
        const PATIENCE_MS: u64 = 200;
        let end = Instant::now() + Duration::from_millis(PATIENCE_MS);
        while Instant::now() < end && !(self.line.is_free() && self.shell.out().is_empty()) {
            self.send();
            Timer::after_millis(1).await;
        }
        // The last bytes leave the USART.
        Timer::after_millis(2).await;
        SCB::sys_reset()
    }
}

/// One tick after another.
#[embassy_executor::task]
async fn run(
    mut device: Device,
    keeper: &'static mut Keeper,
    mut update: &'static mut Update,
    mut doors: Doors,
) {
    doors.greet(&device);
    loop {
        update = audio::exchange(update).await;
        device.begin_tick();
        doors.look(&mut device);
        while let Ok(Wish::NextScene) = WISHES.try_receive() {
            device.next_scene();
        }
        tick(device.control_mut(), keeper, update);
        supervisor::check_in(Client::Control);
        match device.due() {
            None => {}
            Some(Work::Keep) => {
                let result = device.keep().await;
                doors.finished(result, &device);
            }
            Some(Work::Restart) => {
                doors.finished(Ok(()), &device);
                doors.restart().await;
            }
        }
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
