//! The clock controller of rigless with what this board adds: the kernel clock of the I2S, and a
//! crystal that does not start.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange, ResetCause};
use rigless::soc::stm32f427::generated::rcc::{Register, cfgr, cr, pllcfgr, plli2scfgr};
use rigless::soc::stm32f427::peripherals::rcc::{HSI_HZ, PLLM, Rcc};
use rigless::time::EventId;

/// The clock output that carries the I2S kernel clock, in millihertz; beyond rigless' own.
pub(crate) const I2S_KERNEL: usize = 1000;

/// The reset and clock control.
#[derive(Debug)]
pub(crate) struct Clocks {
    rcc: Rcc,
    crystal_hz: u64,
    own_divider: bool,
    kernel_mhz: u64,
}

impl Clocks {
    /// A tree with a crystal of `crystal_hz`; at 0 it never starts. `own_divider`: the PLLI2S has one for its input, as
    /// the F411's, and does not share the main PLL's.
    pub(crate) fn new(crystal_hz: u64, own_divider: bool) -> Self {
        let mut rcc = Rcc::new();
        rcc.attach_crystals(crystal_hz, 0);
        Self {
            rcc,
            crystal_hz,
            own_divider,
            kernel_mhz: 0,
        }
    }

    /// See [`Rcc::restarted`].
    pub(crate) fn restarted(
        &mut self,
        cause: ResetCause,
        flags: u64,
        registers: &mut RegisterFile,
    ) {
        self.rcc.restarted(cause, flags, registers);
    }

    /// What the I2S runs on, Hz.
    pub(crate) fn i2s_kernel_hz(&self) -> f64 {
        self.kernel_mhz as f64 / 1000.0
    }

    fn follow(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.crystal_hz == 0 {
            // rigless has an empty oscillator reach ready at no frequency; a crystal does not.
            let control = registers.get(Register::Cr);
            registers.set(Register::Cr, cr::HSERDY.set(control, 0));
        }
        let mhz = kernel_mhz(
            self.crystal_hz,
            self.own_divider,
            registers.get(Register::Cr),
            registers.get(Register::Pllcfgr),
            registers.get(Register::Plli2scfgr),
            registers.get(Register::Cfgr),
        );
        if mhz != self.kernel_mhz {
            self.kernel_mhz = mhz;
            context.clock(I2S_KERNEL, mhz);
        }
    }
}

/// The kernel clock of the I2S in mHz: the R output of the PLLI2S, RM0090 7.3.23. 0 while the PLL is
/// not ready, or where `I2SSRC` selects the pin, which nothing drives.
fn kernel_mhz(
    crystal_hz: u64,
    own_divider: bool,
    cr: u64,
    pllcfgr: u64,
    plli2scfgr: u64,
    cfgr: u64,
) -> u64 {
    // RM0383 6.3.20: PLLI2SM stands where PLLCFGR has PLLM.
    let m = PLLM.get(if own_divider { plli2scfgr } else { pllcfgr });
    let r = plli2scfgr::PLLI2SRX.get(plli2scfgr);
    if !cr::PLLI2SRDY.is_set(cr) || cfgr::I2SSRC.is_set(cfgr) || m == 0 || r == 0 {
        return 0;
    }
    let input = if pllcfgr::PLLSRC.is_set(pllcfgr) {
        crystal_hz
    } else {
        HSI_HZ
    };
    input * 1000 * plli2scfgr::PLLI2SNX.get(plli2scfgr) / (m * r)
}

impl Device for Clocks {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.rcc.write(register, value, registers, context);
        self.follow(registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.rcc.on_event(event, registers, context);
        self.follow(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.rcc.on_request(change, registers, context);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_clock_is_what_the_tree_gives() {
        let ready = cr::PLLI2SRDY.mask();
        let pll = |m: u64| m | pllcfgr::PLLSRC.mask();
        let plli2s = |n: u64, r: u64| n << 6 | r << 28;
        assert_eq!(
            kernel_mhz(8_000_000, false, ready, pll(5), plli2s(192, 5), 0),
            61_440_000_000
        );
        assert_eq!(
            kernel_mhz(8_000_000, false, ready, pll(8), plli2s(258, 3), 0),
            86_000_000_000
        );
        assert_eq!(
            kernel_mhz(8_000_000, false, 0, pll(5), plli2s(192, 5), 0),
            0,
            "not locked"
        );
        assert_eq!(
            kernel_mhz(0, false, ready, pll(5), plli2s(192, 5), 0),
            0,
            "no crystal"
        );
        assert_eq!(
            kernel_mhz(
                8_000_000,
                false,
                ready,
                pll(5),
                plli2s(192, 5),
                cfgr::I2SSRC.mask()
            ),
            0
        );
        assert_eq!(
            kernel_mhz(0, false, ready, 16, plli2s(192, 5), 0),
            38_400_000_000,
            "from the HSI"
        );
        assert_eq!(
            kernel_mhz(25_000_000, true, ready, pll(7), plli2s(384, 5) | 25, 0),
            76_800_000_000,
            "its own divider"
        );
    }
}
