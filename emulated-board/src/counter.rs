//! Counts of executed instructions: of a function, call by call, and of everything an interrupt runs.
//!
//! The emulator stops at a function's first instruction and where its caller goes on, and at a
//! handler's first instruction and where the interrupted code goes on. What interrupts execute inside
//! a call is taken off it, so a count repeats exactly.

use std::collections::BTreeMap;

use crate::registers::Registers;

/// The exception number of interrupt 0, B1.5.2 of DDI 0403E.
const FIRST_INTERRUPT: u32 = 16;
/// Where a stacked frame keeps the address to return to and the flags, B1.5.6.
const STACKED_PC: u32 = 0x18;
const STACKED_XPSR: u32 = 0x1C;
/// The sizes of a frame without and with floating-point registers.
const FRAME: u32 = 0x20;
const EXTENDED_FRAME: u32 = 0x68;
/// `xPSR` bit 9 of a frame: a word of padding was stacked.
const PADDED: u32 = 1 << 9;

/// Names what [`Board::count`](crate::Board::count) counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counter(pub(crate) usize);

/// Instructions executed in a function, everything it calls included and interrupts excluded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts {
    /// Each call that has returned, in order.
    pub calls: Vec<u64>,
}

impl Counts {
    /// Of all calls together.
    pub fn total(&self) -> u64 {
        self.calls.iter().sum()
    }

    /// Of the longest call.
    pub fn max(&self) -> u64 {
        self.calls.iter().copied().max().unwrap_or(0)
    }

    /// Of a call on average.
    pub fn mean(&self) -> f64 {
        match self.calls.len() {
            0 => 0.0,
            calls => self.total() as f64 / calls as f64,
        }
    }
}

/// What one exception's handler executed, what preempted it excluded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HandlerCounts {
    /// How often it was entered.
    pub entries: u64,
    /// Instructions executed in it.
    pub instructions: u64,
    /// Instructions of its longest run that has ended.
    pub max: u64,
}

/// Instructions by who executed them, since [`Board::count_interrupts`](crate::Board::count_interrupts).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InterruptCounts {
    /// In thread mode.
    pub thread: u64,
    /// By interrupt number; negative for the system exceptions: -1 is `SysTick`.
    pub handlers: BTreeMap<i32, HandlerCounts>,
}

/// A function counted.
#[derive(Debug)]
struct Function {
    entry: u32,
    counts: Counts,
}

/// A call under way.
#[derive(Debug)]
struct Call {
    function: usize,
    returns_to: u32,
    sp: u32,
    begun: u64,
    /// Instructions of interrupts taken meanwhile.
    interrupts: u64,
}

/// An exception under way.
#[derive(Debug)]
struct Exception {
    number: u32,
    frame: u32,
    returns_to: u32,
    sp: u32,
    /// Instructions of its own so far.
    own: u64,
    /// Calls that were under way when it was taken.
    calls: usize,
}

/// What the tracer needs of the emulator at a hit.
pub(crate) trait Look {
    /// The word at `address`.
    fn word(&mut self, address: u32) -> Option<u32>;
    /// Stops at `address`, or no longer.
    fn watch(&mut self, address: u32, on: bool);
}

/// Follows calls and exceptions from stop to stop.
#[derive(Debug, Default)]
pub(crate) struct Tracer {
    functions: Vec<Function>,
    handlers: Vec<u32>,
    calls: Vec<Call>,
    exceptions: Vec<Exception>,
    counts: InterruptCounts,
    charged: u64,
}

impl Tracer {
    /// Counts the function whose first instruction is at `entry`.
    pub(crate) fn count(&mut self, entry: u32, look: &mut dyn Look) -> Counter {
        let known = self.functions.iter().position(|one| one.entry == entry);
        Counter(known.unwrap_or_else(|| {
            look.watch(entry, true);
            let counts = Counts::default();
            self.functions.push(Function { entry, counts });
            self.functions.len() - 1
        }))
    }

    /// What `counter` counted so far, forgetting it.
    pub(crate) fn take(&mut self, counter: Counter) -> Counts {
        self.functions
            .get_mut(counter.0)
            .map(|function| std::mem::take(&mut function.counts))
            .unwrap_or_default()
    }

    /// Follows the exceptions whose handlers begin at `handlers`, from `retired` on.
    pub(crate) fn follow(&mut self, handlers: Vec<u32>, retired: u64, look: &mut dyn Look) {
        if self.handlers.is_empty() {
            self.charged = retired;
            for handler in &handlers {
                look.watch(*handler, true);
            }
            self.handlers = handlers;
        }
    }

    /// Whether exceptions are followed.
    pub(crate) fn follows(&self) -> bool {
        !self.handlers.is_empty()
    }

    /// The counts by exception up to `retired`, forgetting them.
    pub(crate) fn take_interrupts(&mut self, retired: u64) -> InterruptCounts {
        self.charge(retired);
        std::mem::take(&mut self.counts)
    }

    /// The part restarted: nothing that was under way will ever return.
    pub(crate) fn restart(&mut self, retired: u64, look: &mut dyn Look) {
        self.charge(retired);
        for call in self.calls.drain(..) {
            look.watch(call.returns_to, false);
        }
        for exception in self.exceptions.drain(..) {
            look.watch(exception.returns_to, false);
        }
    }

    /// The core arrived at a watched instruction with `retired` instructions behind it.
    pub(crate) fn hit(&mut self, retired: u64, registers: &Registers, look: &mut dyn Look) {
        let pc = registers.pc();
        self.leave_exception(retired, registers, look);
        self.leave_call(retired, registers, look);
        if self.handlers.contains(&pc) && registers.exception != 0 {
            self.enter_exception(retired, registers, look);
        }
        if let Some(function) = self.functions.iter().position(|one| one.entry == pc) {
            self.enter_call(function, retired, registers, look);
        }
    }

    /// Charges what ran since the last look to whoever ran it.
    fn charge(&mut self, retired: u64) {
        let ran = retired - self.charged;
        self.charged = retired;
        if !self.follows() {
            return;
        }
        match self.exceptions.last_mut() {
            Some(exception) => {
                exception.own += ran;
                let calls = exception.calls;
                for call in &mut self.calls[..calls] {
                    call.interrupts += ran;
                }
                let number = exception.number as i32 - FIRST_INTERRUPT as i32;
                self.counts.handlers.entry(number).or_default().instructions += ran;
            }
            None => self.counts.thread += ran,
        }
    }

    fn enter_exception(&mut self, retired: u64, registers: &Registers, look: &mut dyn Look) {
        // EXC_RETURN, B1.5.8: bit 2 says which stack the frame is on, bit 4 which kind it is.
        let exc_return = registers.lr();
        let frame = if exc_return & 0b100 == 0 {
            registers.sp()
        } else {
            registers.other_sp
        };
        let top = self.exceptions.last();
        if top.is_some_and(|top| top.frame == frame && top.number == registers.exception) {
            return;
        }
        self.charge(retired);
        // A frame at or above this one's belongs to a handler that ended into this one.
        while self.exceptions.last().is_some_and(|top| top.frame <= frame) {
            self.end_exception(look);
        }
        let (Some(returns_to), Some(xpsr)) = (
            look.word(frame.wrapping_add(STACKED_PC)),
            look.word(frame.wrapping_add(STACKED_XPSR)),
        ) else {
            return;
        };
        let size = if exc_return & 0x10 == 0 {
            EXTENDED_FRAME
        } else {
            FRAME
        };
        let padding = if xpsr & PADDED != 0 { 4 } else { 0 };
        let returns_to = returns_to & !1;
        look.watch(returns_to, true);
        let number = registers.exception as i32 - FIRST_INTERRUPT as i32;
        self.counts.handlers.entry(number).or_default().entries += 1;
        self.exceptions.push(Exception {
            number: registers.exception,
            frame,
            returns_to,
            sp: frame.wrapping_add(size + padding),
            own: 0,
            calls: self.calls.len(),
        });
    }

    fn leave_exception(&mut self, retired: u64, registers: &Registers, look: &mut dyn Look) {
        let ended = self.exceptions.iter().position(|exception| {
            exception.returns_to == registers.pc()
                && exception.sp == registers.sp()
                && exception.number != registers.exception
        });
        if let Some(ended) = ended {
            self.charge(retired);
            while self.exceptions.len() > ended {
                self.end_exception(look);
            }
        }
    }

    fn end_exception(&mut self, look: &mut dyn Look) {
        let Some(ended) = self.exceptions.pop() else {
            return;
        };
        look.watch(ended.returns_to, false);
        let number = ended.number as i32 - FIRST_INTERRUPT as i32;
        let counts = self.counts.handlers.entry(number).or_default();
        counts.max = counts.max.max(ended.own);
        // A call its handler began and never returned from ends with it.
        while self.calls.len() > ended.calls {
            self.drop_call(look);
        }
    }

    fn drop_call(&mut self, look: &mut dyn Look) {
        if let Some(call) = self.calls.pop() {
            look.watch(call.returns_to, false);
        }
    }

    fn enter_call(
        &mut self,
        function: usize,
        retired: u64,
        registers: &Registers,
        look: &mut dyn Look,
    ) {
        let sp = registers.sp();
        // A loop that goes back to the first instruction is no call.
        let again = |call: &Call| call.function == function && call.sp == sp;
        if self.calls.last().is_some_and(again) {
            return;
        }
        self.charge(retired);
        let returns_to = registers.lr() & !1;
        look.watch(returns_to, true);
        self.calls.push(Call {
            function,
            returns_to,
            sp,
            begun: retired,
            interrupts: 0,
        });
    }

    fn leave_call(&mut self, retired: u64, registers: &Registers, look: &mut dyn Look) {
        let ended = self
            .calls
            .iter()
            .rposition(|call| call.returns_to == registers.pc() && call.sp == registers.sp());
        let Some(ended) = ended else {
            return;
        };
        self.charge(retired);
        while self.calls.len() > ended + 1 {
            self.drop_call(look);
        }
        if let Some(call) = self.calls.pop() {
            look.watch(call.returns_to, false);
            let counts = &mut self.functions[call.function].counts;
            counts.calls.push(retired - call.begun - call.interrupts);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Memory {
        words: BTreeMap<u32, u32>,
        watched: BTreeMap<u32, i32>,
    }

    impl Look for Memory {
        fn word(&mut self, address: u32) -> Option<u32> {
            self.words.get(&address).copied()
        }

        fn watch(&mut self, address: u32, on: bool) {
            *self.watched.entry(address).or_default() += if on { 1 } else { -1 };
        }
    }

    fn at(pc: u32, sp: u32, lr: u32, exception: u32) -> Registers {
        let mut r = [0; 16];
        (r[13], r[14], r[15]) = (sp, lr, pc);
        Registers {
            r,
            exception,
            locked_up: false,
            sleeping: false,
            other_sp: 0,
        }
    }

    #[test]
    fn an_interrupt_inside_a_call_is_taken_off_it() {
        let mut memory = Memory::default();
        let mut tracer = Tracer::default();
        let counter = tracer.count(0x100, &mut memory);
        tracer.follow(vec![0x800], 0, &mut memory);
        tracer.hit(10, &at(0x100, 0x2000, 0x51, 0), &mut memory);
        // Interrupt 0 after 20 instructions of the call, 7 of its own.
        let frame = 0x1F00;
        memory.words.insert(frame + STACKED_PC, 0x120);
        memory.words.insert(frame + STACKED_XPSR, 0);
        tracer.hit(30, &at(0x800, frame, 0xFFFF_FFF9, 16), &mut memory);
        tracer.hit(37, &at(0x120, frame + FRAME, 0, 0), &mut memory);
        tracer.hit(50, &at(0x50, 0x2000, 0, 0), &mut memory);
        assert_eq!(tracer.take(counter).calls, [33]);
        let counts = tracer.take_interrupts(60);
        assert_eq!(
            counts.handlers[&0],
            HandlerCounts {
                entries: 1,
                instructions: 7,
                max: 7
            }
        );
        assert_eq!(counts.thread, 53);
        assert_eq!(memory.watched[&0x50], 0, "no watch is left behind");
        assert_eq!(memory.watched[&0x120], 0);
    }

    #[test]
    fn handlers_that_chain_share_a_frame() {
        let mut memory = Memory::default();
        let mut tracer = Tracer::default();
        tracer.follow(vec![0x800, 0x900], 0, &mut memory);
        let frame = 0x1F00;
        memory.words.insert(frame + STACKED_PC, 0x120);
        memory.words.insert(frame + STACKED_XPSR, PADDED);
        tracer.hit(5, &at(0x800, frame, 0xFFFF_FFF9, 16), &mut memory);
        tracer.hit(9, &at(0x900, frame, 0xFFFF_FFF9, 17), &mut memory);
        tracer.hit(20, &at(0x120, frame + FRAME + 4, 0, 0), &mut memory);
        let counts = tracer.take_interrupts(20);
        assert_eq!(counts.handlers[&0].instructions, 4);
        assert_eq!(counts.handlers[&1].instructions, 11);
        assert_eq!(counts.thread, 5);
    }
}
