//! `freshet flash`, all but the probe: the boards' chips and their flash, what of an ELF goes where, and the words when
//! it cannot. The probe itself is in `probe`, behind the feature `flash`.

use std::fmt::{self, Write as _};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use object::elf::{EM_386, EM_AARCH64, EM_ARM, EM_RISCV, EM_X86_64, Machine, PT_LOAD};
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Object, ObjectSymbol};

/// Where the chips' flash begins, and where they look for their vectors.
const FLASH: u64 = 0x0800_0000;
/// A symbol of this name and the board's is in every firmware: its build script defines it.
const BOARD_SYMBOL: &str = "__freshet_board_";
/// The control block of RTT, which no field build has.
const RTT_SYMBOL: &str = "_SEGGER_RTT";

/// What `freshet flash` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// The board that is plugged in
    #[arg(long, value_parser = boards())]
    pub board: &'static Target,
    /// The firmware [default: what `cargo build-BOARD` leaves]
    #[arg(long, value_name = "FILE")]
    pub elf: Option<PathBuf>,
    /// Which debug probe, where there are several
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    pub probe: Option<Selector>,
    /// Take nothing but a field build: one without a debugger's log
    #[arg(long)]
    pub field: bool,
}

fn boards() -> impl TypedValueParser<Value = &'static Target> {
    PossibleValuesParser::new(TARGETS.iter().map(|target| target.board)).map(|board| {
        let target = TARGETS.iter().find(|target| target.board == board);
        target.expect("only the boards' names are taken")
    })
}

/// A board as a debug probe meets it.
#[derive(Debug)]
pub struct Target {
    /// Its name on the command line.
    pub board: &'static str,
    /// Its chip's name in probe-rs.
    pub chip: &'static str,
    /// Its chip's device id.
    pub device: u16,
    /// Where its chip's DBGMCU_IDCODE is.
    pub id_register: u64,
    /// Its flash, in order and without gaps; each border is a sector's.
    pub flash: &'static [Area],
    /// How it comes to a probe.
    plug: &'static str,
}

/// A stretch of flash and its one purpose.
#[derive(Debug)]
pub struct Area {
    /// What it holds.
    pub holds: Holds,
    /// Its addresses.
    pub range: Range<u64>,
}

/// What a stretch of flash is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// Vectors, code and constants.
    Firmware,
    /// What the board has saved.
    Settings,
    /// Scenes and tables, replaced apart from the firmware.
    Bank,
}

const fn area(holds: Holds, range: Range<u64>) -> Area {
    Area { holds, range }
}

/// Every board.
pub static TARGETS: [Target; 3] = [
    Target {
        board: "f407",
        chip: "STM32F407VGTx",
        device: 0x413,
        id_register: 0xE004_2000,
        flash: &[
            area(Holds::Firmware, FLASH..0x0800_4000),
            area(Holds::Settings, 0x0800_4000..0x0800_C000),
            area(Holds::Firmware, 0x0800_C000..0x0808_0000),
            area(Holds::Bank, 0x0808_0000..0x0810_0000),
        ],
        plug: "connect the Discovery board's mini-USB socket (CN1) to this computer",
    },
    Target {
        board: "f411",
        chip: "STM32F411CEUx",
        device: 0x431,
        id_register: 0xE004_2000,
        flash: &[
            area(Holds::Firmware, FLASH..0x0800_4000),
            area(Holds::Settings, 0x0800_4000..0x0800_C000),
            area(Holds::Firmware, 0x0800_C000..0x0806_0000),
            area(Holds::Bank, 0x0806_0000..0x0808_0000),
        ],
        plug: "connect an ST-LINK to this computer and to the Black Pill's SWDIO, SWCLK, GND and 3V3",
    },
    Target {
        board: "h743",
        chip: "STM32H743ZITx",
        device: 0x450,
        id_register: 0x5C00_1000,
        flash: &[
            area(Holds::Firmware, FLASH..0x0810_0000),
            area(Holds::Bank, 0x0810_0000..0x081C_0000),
            area(Holds::Settings, 0x081C_0000..0x0820_0000),
        ],
        plug: "connect the Nucleo's micro-USB socket (CN1) to this computer",
    },
];

/// Device ids of the boards' chips and of those that are easily taken for them.
const DEVICES: [(u16, &str); 9] = [
    (0x410, "STM32F103"),
    (0x413, "STM32F405/407"),
    (0x419, "STM32F427/429/437/439"),
    (0x421, "STM32F446"),
    (0x423, "STM32F401xB/C"),
    (0x431, "STM32F411"),
    (0x433, "STM32F401xD/E"),
    (0x450, "STM32H742/743/750/753"),
    (0x483, "STM32H723/725/733/735"),
];

fn device_name(device: u16) -> &'static str {
    let known = DEVICES.iter().find(|known| known.0 == device);
    known.map_or("chip of another kind", |known| known.1)
}

impl Target {
    /// The firmware that is flashed where none is named.
    pub fn default_elf(&self) -> PathBuf {
        format!(
            "target/thumbv7em-none-eabihf/firmware/freshet-{}",
            self.board
        )
        .into()
    }

    /// The command that builds the firmware.
    fn build(&self, field: bool) -> String {
        let how = if field { "field" } else { "build" };
        format!("`cargo {how}-{}`", self.board)
    }

    /// The chip's device id, by `read`ing its memory; none where nothing answers.
    pub fn device_id(&self, mut read: impl FnMut(u64) -> Option<u32>) -> Option<u16> {
        // Another board's register, too, for it may be another board.
        let registers = TARGETS.iter().map(|target| target.id_register);
        let device = std::iter::once(self.id_register)
            .chain(registers)
            .filter_map(|register| Some((read(register)? & 0xFFF) as u16))
            .find(|device| !matches!(device, 0 | 0xFFF))?;
        // The first F407s (revision A) say that they are an F2, which would be a Cortex-M3 (errata ES0182 §2.1).
        let is_m4 = |cpuid: u32| cpuid >> 4 & 0xFFF == 0xC24;
        if device == 0x411 && read(0xE000_ED00).is_some_and(is_m4) {
            return Some(0x413);
        }
        Some(device)
    }

    /// Refuses another chip than the board's.
    pub fn check_device(&self, device: u16) -> Result<()> {
        if device == self.device {
            return Ok(());
        }
        let advice = match TARGETS.iter().find(|target| target.device == device) {
            Some(other) => format!("for this chip give --board {}", other.board),
            None => "is this the right board?".into(),
        };
        bail!(
            "the probe found a {} (device id {device:#05x}), expected the {} of board {}; nothing was changed ({advice})",
            device_name(device),
            device_name(self.device),
            self.board,
        )
    }

    /// Refuses what does not lie in flash that is for it.
    fn check_place(&self, holds: Holds, range: &Range<u64>) -> Result<()> {
        let within = |area: &&Area| area.range.start <= range.start && range.end <= area.range.end;
        let meant = self.flash.iter().filter(|area| area.holds == holds);
        if meant.clone().any(|area| within(&area)) {
            return Ok(());
        }
        let meant: Vec<String> = meant.map(|area| show(&area.range)).collect();
        let met = self
            .flash
            .iter()
            .filter(|area| area.holds != holds)
            .find(|area| area.range.start < range.end && range.start < area.range.end);
        let where_to = match met.map(|area| area.holds) {
            Some(Holds::Settings) => "in the board's settings",
            Some(Holds::Bank) => "in the board's bank",
            Some(Holds::Firmware) => "in the board's firmware",
            None => "outside the board's flash",
        };
        bail!(
            "{} is {where_to}; expected {}",
            show(range),
            meant.join(" or ")
        )
    }
}

fn show(range: &Range<u64>) -> String {
    format!("{:#010X} to {:#010X}", range.start, range.end - 1)
}

/// What goes where.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The board.
    pub target: &'static Target,
    /// The file that it comes from.
    pub file: PathBuf,
    /// Every part lies in flash that is for it.
    pub parts: Vec<Part>,
}

/// Consecutive bytes for the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Where they go.
    pub address: u64,
    /// The bytes.
    pub data: Vec<u8>,
}

impl Plan {
    /// Reads and checks the firmware that is asked for.
    pub fn read(request: &Request) -> Result<Self> {
        let target = request.board;
        let file = request.elf.clone().unwrap_or_else(|| target.default_elf());
        let build = target.build(request.field);
        let bytes = read(&file, &build)?;
        let parts = firmware(&bytes, target, request.field).map_err(|error| {
            anyhow::anyhow!("{}: {error:#} ({build} builds it)", file.display())
        })?;
        Ok(Self {
            target,
            file,
            parts,
        })
    }

    /// Bytes for the flash.
    pub fn size(&self) -> usize {
        self.parts.iter().map(|part| part.data.len()).sum()
    }

    /// The summary, for people.
    pub fn summary(&self) -> String {
        let (file, board) = (self.file.display(), self.target.board);
        format!(
            "{file}  {} bytes flashed and verified; board {board} runs it",
            self.size()
        )
    }
}

fn read(file: &Path, build: &str) -> Result<Vec<u8>> {
    let name = file.display();
    // A device or a pipe may never end.
    if fs::metadata(file).is_ok_and(|meta| !meta.is_file()) {
        bail!("cannot read {name}: expected a file, the ELF that {build} leaves");
    }
    fs::read(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => {
            anyhow::anyhow!("there is no {name}: build it with {build}, or name another with --elf")
        }
        kind => anyhow::anyhow!("cannot read {name}: {kind}"),
    })
}

/// The parts of an ELF for `target`, checked.
fn firmware(bytes: &[u8], target: &Target, field: bool) -> Result<Vec<Part>> {
    if !bytes.starts_with(b"\x7FELF") {
        bail!("not an ELF file; expected firmware with its addresses, no .bin or .hex");
    }
    let elf = arm(bytes)?;
    check_board(&elf, target)?;
    if field && has_symbol(&elf, RTT_SYMBOL) {
        bail!("logs to a debugger; expected a field build");
    }
    let parts = segments(&elf)?;
    for part in &parts {
        let range = part.address..part.address + part.data.len() as u64;
        target.check_place(Holds::Firmware, &range)?;
    }
    if !parts.iter().any(|part| part.address == FLASH) {
        bail!("nothing at {FLASH:#010X}, where the chip looks for its vectors");
    }
    Ok(parts)
}

fn arm(bytes: &[u8]) -> Result<ElfFile32<'_>> {
    // The machine stands at the same place whatever the size of the others.
    let machine = match (bytes.get(5), bytes.get(18..20)) {
        (Some(1), Some(&[low, high])) => Machine(u16::from_le_bytes([low, high])),
        (Some(2), Some(&[high, low])) => Machine(u16::from_le_bytes([low, high])),
        _ => bail!("an ELF file that is cut short or broken"),
    };
    if machine != EM_ARM {
        let machine = match machine {
            EM_386 => "x86",
            EM_X86_64 => "x86-64",
            EM_AARCH64 => "64-bit ARM",
            EM_RISCV => "RISC-V",
            _ => "another processor",
        };
        bail!("an ELF file for {machine}; expected one for 32-bit ARM");
    }
    ElfFile32::parse(bytes)
        .map_err(|error| anyhow::anyhow!("an ELF file that is cut short or broken: {error}"))
}

fn symbols<'a>(elf: &'a ElfFile32<'_>) -> impl Iterator<Item = &'a str> {
    elf.symbols().filter_map(|symbol| symbol.name().ok())
}

fn has_symbol(elf: &ElfFile32<'_>, name: &str) -> bool {
    symbols(elf).any(|symbol| symbol == name)
}

fn check_board(elf: &ElfFile32<'_>, target: &Target) -> Result<()> {
    match symbols(elf).find_map(|symbol| symbol.strip_prefix(BOARD_SYMBOL)) {
        Some(board) if board == target.board => Ok(()),
        Some(board) => bail!(
            "firmware for board {board}, expected board {}",
            target.board
        ),
        None => bail!(
            "does not say which board it is for (symbol {BOARD_SYMBOL}…); expected freshet's firmware, not stripped"
        ),
    }
}

/// What is loaded, by its address in flash: initial values of variables lie there too.
fn segments(elf: &ElfFile32<'_>) -> Result<Vec<Part>> {
    let endian = elf.endian();
    let loaded = elf
        .elf_program_headers()
        .iter()
        .filter(|segment| segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) > 0);
    loaded
        .map(|segment| match segment.data(endian, elf.data()) {
            Ok(data) => Ok(Part {
                address: segment.p_paddr(endian).into(),
                data: data.to_vec(),
            }),
            Err(()) => bail!("an ELF file that is cut short"),
        })
        .collect()
}

/// A debug probe, as `--probe` names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selector {
    /// USB vendor id.
    pub vendor: u16,
    /// USB product id.
    pub product: u16,
    /// Serial number; none stands for any.
    pub serial: Option<String>,
}

impl FromStr for Selector {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut words = text.splitn(3, ':');
        let mut id = || {
            let word = words.next().filter(|word| word.len() <= 4)?;
            u16::from_str_radix(word, 16).ok()
        };
        let (Some(vendor), Some(product)) = (id(), id()) else {
            return Err(
                "expected two hexadecimal numbers and perhaps a serial number, such as 0483:374b or 0483:374b:066DFF",
            );
        };
        let serial = words.next().map(str::to_owned);
        Ok(Self {
            vendor,
            product,
            serial,
        })
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}:{:04x}", self.vendor, self.product)?;
        match &self.serial {
            Some(serial) => write!(f, ":{serial}"),
            None => Ok(()),
        }
    }
}

impl Selector {
    fn takes(&self, other: &Self) -> bool {
        (self.vendor, self.product) == (other.vendor, other.product)
            && (self.serial.is_none() || self.serial == other.serial)
    }
}

/// A debug probe that is plugged in.
#[derive(Clone, Debug)]
pub struct Found {
    /// What it calls itself.
    pub name: String,
    /// Who it is.
    pub id: Selector,
    /// Whether this user may use it.
    pub is_open: bool,
}

/// Which of the probes that were `found` to take.
pub fn choose(target: &Target, found: &[Found], wanted: Option<&Selector>) -> Result<usize> {
    let fits = |found: &Found| wanted.is_none_or(|wanted| wanted.takes(&found.id));
    let mut fitting = (0..found.len()).filter(|&i| fits(&found[i]));
    let Some(first) = fitting.next() else {
        match wanted {
            Some(wanted) if !found.is_empty() => {
                bail!("no debug probe {wanted}; plugged in:{}", list(found))
            }
            Some(wanted) => bail!("no debug probe {wanted}, nor any other: {}", plug(target)),
            None => bail!("no debug probe was found: {}", plug(target)),
        }
    };
    // One that can be reached in two ways is still one.
    if fitting.any(|i| found[i].id != found[first].id) {
        bail!(
            "several debug probes are plugged in; choose with --probe:{}",
            list(found)
        );
    }
    let Found { id, is_open, .. } = &found[first];
    if !is_open {
        let rule = udev_rule(id.vendor);
        let cure = if cfg!(target_os = "linux") {
            format!("; allow it, and plug it in again:\n\n{rule}")
        } else {
            String::new()
        };
        bail!("the debug probe {id} may not be used by this user{cure}");
    }
    Ok(first)
}

fn list(found: &[Found]) -> String {
    found.iter().fold(String::new(), |mut text, found| {
        let _ = write!(text, "\n  --probe {}  {}", found.id, found.name);
        text
    })
}

fn plug(target: &Target) -> String {
    let linux = if cfg!(target_os = "linux") {
        "; where only root finds it, add the udev rule of docs/boards.md"
    } else {
        ""
    };
    format!(
        "{}, with a cable that carries data and not only power{linux}",
        target.plug
    )
}

/// The commands that let everybody at this computer use the probes of a `vendor`.
fn udev_rule(vendor: u16) -> String {
    format!(
        "  echo 'SUBSYSTEM==\"usb|hidraw\", ATTRS{{idVendor}}==\"{vendor:04x}\", MODE=\"0660\", GROUP=\"plugdev\", TAG+=\"uaccess\"' \\\n    \
         | sudo tee /etc/udev/rules.d/69-freshet.rules\n  sudo udevadm control --reload"
    )
}

#[cfg(test)]
#[path = "../tests/elf/mod.rs"]
mod elf;

#[cfg(test)]
mod tests {
    use super::elf::Elf;
    use super::*;

    fn target(board: &str) -> &'static Target {
        TARGETS.iter().find(|target| target.board == board).unwrap()
    }

    /// Refused, with all of `words` in the message.
    #[track_caller]
    fn refused<T: fmt::Debug>(result: Result<T>, words: &[&str]) {
        let message = format!("{:#}", result.unwrap_err());
        for word in words {
            assert!(message.contains(word), "no `{word}` in: {message}");
        }
    }

    #[test]
    fn flash_is_divided_without_gaps_and_every_board_has_its_place_for_all() {
        for target in &TARGETS {
            assert_eq!(target.flash[0].range.start, FLASH);
            for pair in target.flash.windows(2) {
                assert_eq!(pair[0].range.end, pair[1].range.start, "{}", target.board);
            }
            for holds in [Holds::Firmware, Holds::Settings, Holds::Bank] {
                assert!(target.flash.iter().any(|area| area.holds == holds));
            }
        }
    }

    #[test]
    fn the_guide_says_the_same() {
        let guide = include_str!("../../docs/boards.md");
        for target in &TARGETS {
            assert!(guide.contains(&format!("| `{}`", target.board)));
            for area in target.flash {
                let start = format!("| {:#010X}", area.range.start);
                assert!(guide.contains(&start), "{} {start}", target.board);
            }
        }
        for line in udev_rule(0x0483).lines() {
            assert!(guide.contains(line.trim()), "{line}");
        }
    }

    #[test]
    fn what_is_loaded_goes_to_its_address_in_flash() {
        for board in ["f407", "f411"] {
            let bytes = Elf::firmware(board).bytes();
            let parts = firmware(&bytes, target(board), true).unwrap();
            let places: Vec<_> = parts.iter().map(|p| (p.address, p.data.len())).collect();
            let expected = [
                (0x0800_0000, 0x188),
                (0x0800_C000, 5_000),
                (0x0800_D388, 64),
            ];
            assert_eq!(places, expected);
            // The bytes themselves count on from one segment to the next.
            assert_eq!(parts[0].data[..3], [0, 1, 2]);
            assert_eq!(parts[1].data[0], (0x188 % 251) as u8);
        }
    }

    #[test]
    fn a_file_that_is_no_firmware_is_refused() {
        let f407 = target("f407");
        let check = |bytes: &[u8]| firmware(bytes, f407, false);
        refused(check(b""), &["not an ELF file", ".bin"]);
        refused(check(b":10000000"), &["not an ELF file"]);
        refused(check(b"\x7FELF"), &["cut short"]);
        let mut elf = Elf::firmware("f407");
        let whole = elf.bytes();
        for length in 0..whole.len() {
            assert!(check(&whole[..length]).is_err(), "{length} bytes");
        }
        for (machine, name) in [
            (62, "x86-64"),
            (3, "x86"),
            (183, "64-bit ARM"),
            (9, "another"),
        ] {
            elf.machine = machine;
            refused(check(&elf.bytes()), &[name, "32-bit ARM"]);
        }
    }

    #[test]
    fn firmware_says_which_board_it_is_for_and_whether_it_logs() {
        let h743 = Elf::firmware("h743").bytes();
        refused(
            firmware(&h743, target("f411"), false),
            &["for board h743", "expected board f411"],
        );
        let mut elf = Elf::firmware("f407");
        elf.symbols.push(RTT_SYMBOL.into());
        assert!(firmware(&elf.bytes(), target("f407"), false).is_ok());
        refused(
            firmware(&elf.bytes(), target("f407"), true),
            &["field build"],
        );
        elf.symbols.clear();
        refused(
            firmware(&elf.bytes(), target("f407"), false),
            &["does not say which board"],
        );
    }

    #[test]
    fn firmware_stays_off_the_settings_the_bank_and_everything_that_is_no_flash() {
        for (place, size, word) in [
            (0x0800_4000, 4, "settings"),
            (0x0800_3FFF, 2, "settings"),
            (0x0807_FFFF, 2, "bank"),
            (0x2000_0000, 4, "outside"),
            (0x0900_0000, 4, "outside"),
            (0xFFFF_FFFF, 4, "outside"),
        ] {
            let mut elf = Elf::firmware("f407");
            elf.segments.push([place, place, size]);
            let result = firmware(&elf.bytes(), target("f407"), false);
            refused(result, &[word, "expected 0x08000000 to 0x08003FFF or"]);
        }
        let mut elf = Elf::firmware("f407");
        elf.segments.remove(0);
        refused(
            firmware(&elf.bytes(), target("f407"), false),
            &["0x08000000", "vectors"],
        );
    }

    #[test]
    fn a_bank_has_its_own_place() {
        for (board, start) in [
            ("f407", 0x0808_0000),
            ("f411", 0x0806_0000),
            ("h743", 0x0810_0000),
        ] {
            let check = |start: u64| target(board).check_place(Holds::Bank, &(start..start + 8));
            assert!(check(start).is_ok());
            refused(check(start - 8), &["in the board's firmware"]);
        }
    }

    #[test]
    fn a_chip_says_who_it_is() {
        let f4 = |id: u32| move |at: u64| (at == 0xE004_2000).then_some(id);
        assert_eq!(target("f407").device_id(f4(0x1007_6413)), Some(0x413));
        assert_eq!(target("h743").device_id(f4(0x1007_6413)), Some(0x413));
        let h7 = |at: u64| (at == 0x5C00_1000).then_some(0x2003_6450);
        for board in ["f407", "h743"] {
            assert_eq!(target(board).device_id(h7), Some(0x450));
        }
        assert_eq!(target("f407").device_id(f4(0)), None);
        assert_eq!(target("f407").device_id(f4(u32::MAX)), None);
        assert_eq!(target("f407").device_id(|_| None), None);
        // The F407 of revision A and the F2 that it calls itself.
        for (cpuid, device) in [(0x410F_C241, 0x413), (0x412F_C230, 0x411)] {
            let chip = |at| match at {
                0xE004_2000 => Some(0x2000_6411),
                0xE000_ED00 => Some(cpuid),
                _ => None,
            };
            assert_eq!(target("f407").device_id(chip), Some(device));
        }
    }

    #[test]
    fn another_chip_is_refused_with_advice() {
        for target in &TARGETS {
            assert!(target.check_device(target.device).is_ok());
        }
        refused(
            target("f407").check_device(0x450),
            &[
                "STM32H742/743",
                "STM32F405/407",
                "--board h743",
                "nothing was changed",
            ],
        );
        refused(
            target("f411").check_device(0x423),
            &["STM32F401xB/C", "0x423", "right board?"],
        );
        refused(target("f411").check_device(0x999), &["another kind"]);
    }

    #[test]
    fn a_probe_is_named_as_it_is_listed() {
        for text in ["0483:374b", "0483:3748:066DFF", "0d28:0204:a:b c"] {
            assert_eq!(text.parse::<Selector>().unwrap().to_string(), text);
        }
        for text in ["", "0483", "0483:", "st:link", "00483:374b", "0483-374b"] {
            assert!(text.parse::<Selector>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_only_probe_is_taken_and_among_several_the_one_that_is_named() {
        let f407 = target("f407");
        let probe = |id: &str| Found {
            name: "STLink V2-1".into(),
            id: id.parse().unwrap(),
            is_open: true,
        };
        let [a, b, c] = ["0483:374b:AA", "0483:374b:BB", "1366:0101:CC"].map(probe);
        let wanted = |text: &str| Some(text.parse::<Selector>().unwrap());
        assert_eq!(choose(f407, std::slice::from_ref(&a), None).unwrap(), 0);
        // One that can be reached in two ways.
        assert_eq!(choose(f407, &[a.clone(), a.clone()], None).unwrap(), 0);
        let all = [a, b, c];
        for (text, i) in [("0483:374b:BB", 1), ("1366:0101", 2), ("1366:0101:CC", 2)] {
            assert_eq!(choose(f407, &all, wanted(text).as_ref()).unwrap(), i);
        }
        let several = ["several", "--probe 0483:374b:BB  STLink V2-1"];
        refused(choose(f407, &all, None), &several);
        refused(choose(f407, &all, wanted("0483:374b").as_ref()), &several);
        refused(
            choose(f407, &all, wanted("0483:374b:DD").as_ref()),
            &["no debug probe 0483:374b:DD", "--probe 1366:0101:CC"],
        );
    }

    #[test]
    fn where_there_is_no_probe_it_says_what_to_plug_in() {
        for (board, word) in [("f407", "CN1"), ("f411", "ST-LINK"), ("h743", "Nucleo")] {
            let words = ["no debug probe", word, "carries data"];
            refused(choose(target(board), &[], None), &words);
        }
        let locked = Found {
            name: "STLink V3".into(),
            id: "0483:374e:AA".parse().unwrap(),
            is_open: false,
        };
        let result = choose(target("h743"), &[locked], None);
        refused(result, &["0483:374e:AA may not be used"]);
        assert!(udev_rule(0x0483).contains("ATTRS{idVendor}==\"0483\""));
    }
}
