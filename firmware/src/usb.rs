//! A serial port over USB: the same protocol, with a shell of its own. Bytes pass through two pipes that the control task
//! looks at once a tick, as it does at the serial line; here too it never waits.

use embassy_executor::Spawner;
use embassy_futures::join::join3;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::peripherals::{PA11, PA12, USB_OTG_FS};
use embassy_stm32::usb::{self, Driver, InterruptHandler};
use embassy_stm32::{Peri, bind_interrupts, interrupt};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_usb::class::cdc_acm::{CdcAcmClass, Receiver, Sender, State};
use embassy_usb::driver::EndpointError;
use embassy_usb::{Builder, Config, UsbDevice};
use freshet::protocol::Outbox;
use static_cell::{ConstStaticCell, StaticCell};

use crate::board;

/// Bytes of a packet at full speed.
const PACKET: usize = 64;
/// Bytes that may be on their way, each direction.
const PIPE: usize = 512;
/// The number that pid.codes leaves to anybody for tests; a product that is sold needs one of its own.
const VENDOR: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;
/// Below the audio task.
const PRIORITY: Priority = Priority::P7;

bind_interrupts!(struct Interrupts {
    OTG_FS => InterruptHandler<USB_OTG_FS>;
});

type Bus = Driver<'static, USB_OTG_FS>;
type Bytes = Pipe<CriticalSectionRawMutex, PIPE>;

static IN: Bytes = Pipe::new();
static OUT: Bytes = Pipe::new();

/// What the port is made of.
pub struct Pins {
    /// The peripheral.
    pub port: Peri<'static, USB_OTG_FS>,
    /// D+.
    pub plus: Peri<'static, PA12>,
    /// D-.
    pub minus: Peri<'static, PA11>,
}

/// The port as the control task sees it.
pub struct Port;

impl Port {
    /// Gives `take` what came since the last time.
    pub fn receive(&mut self, mut take: impl FnMut(&[u8])) {
        let mut packet = [0; PACKET];
        // No more than were there: what comes meanwhile waits for the next tick.
        for _ in 0..PIPE / PACKET {
            match IN.try_read(&mut packet) {
                Ok(count) => take(&packet[..count]),
                Err(_) => break,
            }
        }
    }

    /// Sends on what waits, as far as there is room.
    pub fn send<const N: usize>(&mut self, out: &mut Outbox<N>) {
        let mut packet = [0; PACKET];
        while !out.is_empty() {
            let room = OUT.free_capacity().min(PACKET);
            let count = out.take(&mut packet[..room]);
            if count == 0 || OUT.try_write(&packet[..count]).is_err() {
                break;
            }
        }
    }
}

/// Starts the port.
pub fn start(pins: Pins, spawner: Spawner) -> Port {
    static ENDPOINTS: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    static DESCRIPTORS: ConstStaticCell<[[u8; 256]; 2]> = ConstStaticCell::new([[0; 256]; 2]);
    static CONTROL: ConstStaticCell<[u8; PACKET]> = ConstStaticCell::new([0; PACKET]);
    static STATE: StaticCell<State<'static>> = StaticCell::new();
    let mut config = usb::Config::default();
    // Powered from USB, or always plugged in for all it knows.
    config.vbus_detection = false;
    let Pins { port, plus, minus } = pins;
    let driver = Driver::new_fs(port, Interrupts, plus, minus, ENDPOINTS.take(), config);
    interrupt::OTG_FS.set_priority(PRIORITY);
    let mut config = Config::new(VENDOR, PRODUCT);
    config.manufacturer = Some("freshet");
    config.product = Some(board::NAME);
    let [configuration, boot] = DESCRIPTORS.take();
    let mut builder = Builder::new(driver, config, configuration, boot, &mut [], CONTROL.take());
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);
    let device = builder.build();
    let (sender, receiver) = class.split();
    if let Ok(task) = run(device, sender, receiver) {
        spawner.spawn(task);
    }
    Port
}

#[embassy_executor::task]
async fn run(
    mut device: UsbDevice<'static, Bus>,
    mut sender: Sender<'static, Bus>,
    mut receiver: Receiver<'static, Bus>,
) {
    let comes = async {
        loop {
            receiver.wait_connection().await;
            // Until it is unplugged.
            let _ = pass_in(&mut receiver).await;
        }
    };
    let goes = async {
        loop {
            sender.wait_connection().await;
            let _ = pass_out(&mut sender).await;
        }
    };
    join3(device.run(), comes, goes).await;
}

async fn pass_in(receiver: &mut Receiver<'static, Bus>) -> Result<(), EndpointError> {
    let mut packet = [0; PACKET];
    loop {
        let count = receiver.read_packet(&mut packet).await?;
        // Where the control task does not keep up, the host waits.
        IN.write_all(&packet[..count]).await;
    }
}

async fn pass_out(sender: &mut Sender<'static, Bus>) -> Result<(), EndpointError> {
    // Never a full packet: that would want an empty one after it.
    let mut packet = [0; PACKET - 1];
    loop {
        let count = OUT.read(&mut packet).await;
        sender.write_packet(&packet[..count]).await?;
    }
}
