//! The debug probe of `freshet flash`. Behind the feature `flash`; what can be decided without a probe is in
//! [`flash`](crate::flash).

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use probe_rs::architecture::arm::FullyQualifiedApAddress;
use probe_rs::architecture::arm::dp::DpAddress;
use probe_rs::architecture::arm::sequences::DefaultArmSequence;
use probe_rs::flashing::{
    DownloadOptions, FlashError, FlashProgress, ProgressEvent, ProgressOperation,
};
use probe_rs::probe::blackmagic::BlackMagicProbeFactory;
use probe_rs::probe::cmsisdap::CmsisDapFactory;
use probe_rs::probe::jlink::JLinkFactory;
use probe_rs::probe::list::{Accessibility, Lister, ProbeListItem};
use probe_rs::probe::stlink::StLinkFactory;
use probe_rs::probe::{DebugProbeInfo, Probe};
use probe_rs::{Permissions, Session};

use crate::flash::{Found, Plan, Request, Selector, Target, choose};

/// Why a chip may not answer, for people.
const NO_ANSWER: &str = "the debug probe works, but no chip answers (is the board powered, are SWDIO, SWCLK and GND connected?)";

/// Flashes, verifies and starts what is asked; returns the summary.
pub fn flash(request: &Request) -> Result<String> {
    let plan = Plan::read(request)?;
    let probes = probes();
    let found: Vec<Found> = probes.iter().map(found).collect();
    let chosen = choose(plan.target, &found, request.probe.as_ref())?;
    let mut session = connect(&probes[chosen].info, plan.target)?;
    program(&mut session, &plan)?;
    session
        .core(0)
        .and_then(|mut core| core.reset())
        .context("flashed and verified, but the board does not restart (press its reset button)")?;
    Ok(plan.summary())
}

/// The debug probes; no serial adapter that might be one.
fn probes() -> Vec<ProbeListItem> {
    let mut probes = Lister::new().list_all_with_access();
    probes.retain(|probe| {
        let info = &probe.info;
        info.is_probe_type::<StLinkFactory>()
            || info.is_probe_type::<CmsisDapFactory>()
            || info.is_probe_type::<JLinkFactory>()
            || info.is_probe_type::<BlackMagicProbeFactory>()
    });
    probes
}

fn found(probe: &ProbeListItem) -> Found {
    Found {
        name: probe.info.identifier.clone(),
        id: Selector {
            vendor: probe.info.vendor_id,
            product: probe.info.product_id,
            serial: probe.info.serial_number.clone(),
        },
        is_open: probe.accessibility == Accessibility::Accessible,
    }
}

/// Attaches to the board's chip, and to no other.
fn connect(probe: &DebugProbeInfo, target: &Target) -> Result<Session> {
    let (device, in_reset) = match device_id(probe, target, false) {
        Ok(device) => (device, false),
        // A program that sleeps deeply or has taken the debugger's pins answers while it is held in reset.
        Err(_) => (device_id(probe, target, true)?, true),
    };
    target.check_device(device)?;
    let (link, permissions) = (open(probe)?, Permissions::default());
    let session = if in_reset {
        link.attach_under_reset(target.chip, permissions)
    } else {
        link.attach(target.chip, permissions)
    };
    session.context("the board's chip answers, but cannot be halted (unplug everything for a second and try again)")
}

fn open(probe: &DebugProbeInfo) -> Result<Probe> {
    probe
        .open()
        .context("the debug probe cannot be opened (does another program use it?)")
}

/// The device id of the chip at the probe, asked in the way that all chips understand; in reset, if that is wanted.
fn device_id(probe: &DebugProbeInfo, target: &Target, in_reset: bool) -> Result<u16> {
    let mut link = open(probe)?;
    let attached = if in_reset {
        link.attach_to_unspecified_under_reset()
    } else {
        link.attach_to_unspecified()
    };
    let (mut link, device) = match attached {
        Ok(()) => read_device_id(link, target),
        Err(error) => (link, Err(error.into())),
    };
    if in_reset {
        // Nobody is left in reset; a probe without that wire never held anybody there.
        let _ = link.target_reset_deassert();
    }
    device.context(NO_ANSWER)
}

fn read_device_id(link: Probe, target: &Target) -> (Probe, Result<u16>) {
    let mut arm = match link.try_into_arm_debug_interface(DefaultArmSequence::create()) {
        Ok(arm) => arm,
        Err((link, error)) => return (link, Err(error.into())),
    };
    let port = FullyQualifiedApAddress::v1_with_default_dp(0);
    let device = arm
        .select_debug_port(DpAddress::Default)
        .and_then(|()| {
            let mut memory = arm.memory_interface(&port)?;
            Ok(target.device_id(|address| memory.read_word_32(address).ok()))
        })
        .map_err(anyhow::Error::new)
        .and_then(|device| device.context("it does not say which chip it is"));
    (arm.close(), device)
}

fn program(session: &mut Session, plan: &Plan) -> Result<()> {
    let mut loader = session.target().flash_loader();
    for part in &plan.parts {
        loader.add_data(part.address, &part.data)?;
    }
    let mut bars = Bars::default();
    let mut options = DownloadOptions::default();
    // Sectors without a part keep their settings and their bank; no sector holds both (see `Target::flash`).
    options.do_chip_erase = false;
    options.keep_unwritten_bytes = false;
    options.verify = true;
    options.progress = FlashProgress::new(|event| bars.show(&event));
    loader.commit(session, options).map_err(|error| match error {
        FlashError::Verify => anyhow::anyhow!(
            "the flash does not hold what was written (try again; if it stays so, the chip is worn or its supply is weak)"
        ),
        error => anyhow::Error::new(error).context(
            "flashing stopped half-way, and the board will not run (check the cable, and flash again)",
        ),
    })
}

/// A bar for each step, one after the other.
#[derive(Default)]
struct Bars {
    totals: [u64; 3],
    bar: Option<ProgressBar>,
}

impl Bars {
    fn show(&mut self, event: &ProgressEvent) {
        match *event {
            ProgressEvent::AddProgressBar { operation, total } => {
                if let Some((i, _)) = step(operation) {
                    self.totals[i] += total.unwrap_or(0);
                }
            }
            ProgressEvent::Started(operation) => {
                if let Some((i, name)) = step(operation) {
                    self.bar = Some(bar(self.totals[i], name));
                }
            }
            ProgressEvent::Progress { size, .. } => {
                if let Some(bar) = &self.bar {
                    bar.inc(size);
                }
            }
            ProgressEvent::Finished(_) | ProgressEvent::Failed(_) => {
                if let Some(bar) = self.bar.take() {
                    bar.finish_and_clear();
                }
            }
            ProgressEvent::FlashLayoutReady { .. } | ProgressEvent::DiagnosticMessage { .. } => {}
        }
    }
}

/// Number and name of a step.
fn step(operation: ProgressOperation) -> Option<(usize, &'static str)> {
    match operation {
        ProgressOperation::Erase => Some((0, "erase")),
        ProgressOperation::Program => Some((1, "program")),
        ProgressOperation::Verify => Some((2, "verify")),
        ProgressOperation::Fill => None,
    }
}

fn bar(bytes: u64, name: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(bytes), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}  {eta} left")
        .expect("the template is valid");
    bar.set_style(style);
    bar.set_message(name);
    bar
}

#[cfg(test)]
mod tests {
    use probe_rs::config::Registry;

    use crate::flash::TARGETS;

    #[test]
    fn the_boards_flash_is_the_chips_and_no_sector_has_two_purposes() {
        for board in &TARGETS {
            let registry = Registry::from_builtin_families();
            let chip = registry.get_target_by_name(board.chip).unwrap();
            for area in board.flash {
                let algorithm = chip.flash_algorithms.iter().find(|algorithm| {
                    let range = &algorithm.flash_properties.address_range;
                    range.contains(&area.range.start) && area.range.end <= range.end
                });
                let flash = &algorithm.unwrap().flash_properties;
                for border in [area.range.start, area.range.end] {
                    let offset = border - flash.address_range.start;
                    let sectors = flash.sectors.iter().rev();
                    let size = sectors.clone().find(|s| s.address <= offset).unwrap().size;
                    assert_eq!(offset % size, 0, "{} {border:#x}", board.board);
                }
            }
            let end = board.flash.last().unwrap().range.end;
            let in_flash = |at| {
                chip.memory_region_by_address(at)
                    .is_some_and(|m| m.is_nvm())
            };
            assert!(in_flash(end - 1) && !in_flash(end), "{}", board.board);
        }
    }
}
