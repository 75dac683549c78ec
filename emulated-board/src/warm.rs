//! A core that keeps what it translated over a reset.
//!
//! rigless' core drops every translation when it resets, which costs seconds of compiling at each boot.
//! The code in flash is the same after a reset as before, so this one goes back to the state it was
//! made in by loading it, which keeps them.

#![expect(
    unsafe_code,
    reason = "`Processor::map` hands on host memory by raw pointer"
)]

use std::ops::Range;
use std::sync::Arc;

use rigless::emulator::{
    BitAlias, CoreBus, CoreSpec, DataModel, Error, Exit, HaltReason, HostCall, Processor, Queued,
};
use rigless::soc::{Endian, Width};
use rigless::time::VirtualNanos;

/// `spec` with its core kept warm.
pub(crate) fn warm(mut spec: CoreSpec) -> CoreSpec {
    let make = spec.processor;
    spec.processor = Arc::new(move |endian| {
        let core = make(endian)?;
        let cold = core.save();
        Ok(Box::new(Warm { core, cold }))
    });
    spec
}

/// A core and the state it was made in.
#[derive(Debug)]
struct Warm {
    core: Box<dyn Processor>,
    cold: Vec<u8>,
}

impl Warm {
    /// The state the core was made in, with what it has retired since: the last of what it saves.
    fn state(&self) -> Option<Vec<u8>> {
        let (retired, before) = self.cold.split_last()?;
        (*retired == 0).then_some(())?;
        postcard::to_extend(&self.core.retired(), before.to_vec()).ok()
    }
}

impl Processor for Warm {
    fn reset(&mut self) {
        let loaded = self
            .state()
            .is_some_and(|state| self.core.load(&state).is_ok());
        if !loaded {
            self.core.reset();
        }
    }

    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        self.core.run(budget, bus)
    }

    fn retired(&self) -> u64 {
        self.core.retired()
    }

    fn ask(&mut self, queued: Queued) {
        self.core.ask(queued);
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.core.maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.core.page_size()
    }

    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        // SAFETY: the caller promises what the core asks for.
        unsafe { self.core.map(start, length, host, writable) }
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.core.boot(table, read);
    }

    fn take_reset_request(&mut self) -> bool {
        self.core.take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.core.next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.core.on_event(now);
    }

    fn waiting(&self) -> bool {
        self.core.waiting()
    }

    fn pc(&self) -> u64 {
        self.core.pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.core.add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.core.remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.core.pass_breakpoint(address);
    }

    fn attach_debugger(&mut self, attached: bool) {
        self.core.attach_debugger(attached);
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.core.hold_interrupts(held);
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.core.gdb_register(number)
    }

    fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.core.set_gdb_register(number, bytes)
    }

    fn debugger_access(
        &mut self,
        write: Option<u64>,
        address: u64,
        width: Width,
        now: VirtualNanos,
    ) -> Option<u64> {
        self.core.debugger_access(write, address, width, now)
    }

    fn take_debugger_trace(&mut self) -> Vec<u8> {
        self.core.take_debugger_trace()
    }

    fn target_xml(&self) -> &'static str {
        self.core.target_xml()
    }

    fn data_model(&self) -> DataModel {
        self.core.data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.core.byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.core.save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.core.load(bytes)
    }

    fn monitor_command(&mut self, command: &str) -> Option<String> {
        self.core.monitor_command(command)
    }

    fn debugger_halted(&mut self, why: HaltReason) -> bool {
        self.core.debugger_halted(why)
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias> {
        self.core.bit_alias(address, width)
    }

    fn own_ranges(&self) -> Vec<Range<u64>> {
        self.core.own_ranges()
    }

    fn check_reads(&mut self, every: bool) {
        self.core.check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.core.check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.core.host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.core.answer_host_call(answer);
    }
}
