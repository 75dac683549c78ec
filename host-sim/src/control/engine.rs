//! A twin that runs in real time without a sound card, and one that follows a board.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::Result;
use freshet::param;
use freshet::protocol::{Choice, Device, Pair};
use freshet::{Frame, TICK};

use super::outbox::Order;
use super::sound::Tap;
use crate::client::Hello;
use crate::twin::Twin;

/// A twin that several threads have to do with.
pub type Shared = Arc<Mutex<Twin>>;

/// Time by which the sound may be late before it is let go.
const LATE: Duration = Duration::from_millis(250);
/// How often the sound goes on.
const STRETCH: Duration = Duration::from_millis(8);

/// Whoever renders a twin, for as long as this is kept.
pub struct Engine {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Engine {
    /// Renders `twin` in real time into `tap`.
    pub fn start(twin: &Shared, tap: &Tap) -> Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let (twin, tap, flag) = (Arc::clone(twin), tap.clone(), Arc::clone(&stop));
        let run = move || {
            let tick = locked(&twin).tick_time();
            let mut due = Instant::now();
            while !flag.load(Ordering::Relaxed) {
                while due <= Instant::now() {
                    let mut frames = [Frame::ZERO; TICK];
                    locked(&twin).render(&mut frames);
                    tap.pass(&frames);
                    due += tick;
                    // A machine that cannot keep up is to go on being an instrument.
                    if due.elapsed() > LATE {
                        due = Instant::now();
                    }
                    if flag.load(Ordering::Relaxed) {
                        return;
                    }
                }
                thread::sleep(STRETCH);
            }
        };
        let thread = thread::Builder::new().name("twin".to_owned()).spawn(run)?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has nothing left to say.
            let _ = thread.join();
        }
    }
}

/// A twin that is asked for the same as a board.
pub struct Mirror(pub Shared);

impl Mirror {
    /// Stands as the board does.
    pub fn stand(&self, hello: &Hello, values: &[Pair], anew: bool) {
        let mut twin = locked(&self.0);
        let device = twin.device();
        let number = device.number_of(Choice::Name(&hello.scene));
        if let Some(number) = number
            && (anew || number != device.playing())
            && let Some((_, scene)) = device.scene(number)
        {
            device.control_mut().load(&scene);
            device.set_playing(number);
        }
        // First the intensity: it moves others.
        let intensity = |pair: &&Pair| pair.0 == param::TABLE[param::INTENSITY].id;
        let first = values.iter().filter(|pair| intensity(pair));
        let rest = values.iter().filter(|pair| !intensity(pair));
        for &(id, value) in first.chain(rest) {
            if let Some(index) = param::index_of_id(id)
                && device.control().target(index) != value
            {
                // The board has the same table: what it says may be set.
                let _ = device.control_mut().set(index, value, Some(0.0));
            }
        }
        if anew {
            device.control_mut().mute(false);
        }
    }

    /// Does what the board did.
    pub fn follow(&self, order: &Order) {
        let mut twin = locked(&self.0);
        let device = twin.device();
        match order {
            Order::Set(pairs, ramp) => {
                for &(id, value) in pairs {
                    if let Some(index) = param::index_of_id(id) {
                        // What the board refused the twin refuses too.
                        let _ = device.control_mut().set(index, value, *ramp);
                    }
                }
            }
            Order::Scene(name) => {
                if let Some(number) = device.number_of(Choice::Name(name))
                    && let Some((_, scene)) = device.scene(number)
                {
                    device.control_mut().load(&scene);
                    device.set_playing(number);
                }
            }
            Order::Mute(on) => device.control_mut().mute(*on),
            Order::Trigger => {
                let control = device.control_mut();
                let [radius, pressure, rise] = [
                    param::DROPS_RADIUS,
                    param::DROPS_PRESSURE,
                    param::DROPS_RISE,
                ]
                .map(|index| control.get(index));
                // One too many is not heard on the board either.
                let _ = control.trigger(radius * 1e-3, pressure, rise);
            }
            // What is kept is known from the board's next answer.
            Order::Store(..) | Order::Recall(_) | Order::Erase(_) => {}
        }
    }
}

/// The twin, whatever became of who had it before.
pub fn locked(twin: &Mutex<Twin>) -> MutexGuard<'_, Twin> {
    twin.lock().unwrap_or_else(PoisonError::into_inner)
}
