//! The firmware's ELF file: its sections and symbols, and patches made to it before it boots.

use std::ops::Range;
use std::path::{Path, PathBuf};

use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind, elf};

/// Why an ELF file could not be read, or does not hold what was asked of it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ElfError {
    /// The file could not be read.
    #[error("cannot read {}: {why}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        why: std::io::Error,
    },
    /// The file is no 32-bit ELF file.
    #[error("{} is not a firmware: {why}", path.display())]
    NotElf {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The file was built for another machine than a Cortex-M.
    #[error(
        "{} was built for another machine (ELF machine {machine}, this board runs Arm, 40)",
        path.display()
    )]
    OtherMachine {
        /// The file.
        path: PathBuf,
        /// `e_machine` of the file.
        machine: u16,
    },
    /// No symbol has the name.
    #[error(
        "no {kind} matches `{name}`: it may have been inlined or removed \
         (mark it `#[inline(never)]`)"
    )]
    NoSymbol {
        /// What was looked for: a symbol, a function or a section.
        kind: &'static str,
        /// The name as asked.
        name: String,
    },
    /// Several symbols have the name.
    #[error("`{name}` matches several symbols: {}", candidates.join(", "))]
    Ambiguous {
        /// The name as asked.
        name: String,
        /// Some of what it matches.
        candidates: Vec<String>,
    },
    /// A patch lies outside what the file places in memory.
    #[error("the firmware places nothing at {address:#010x}..{end:#010x}")]
    Unplaced {
        /// The first address.
        address: u32,
        /// The address past the last.
        end: u32,
    },
}

/// A named function or variable of the firmware.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Symbol {
    /// Its name, demangled and without the hash.
    pub name: String,
    /// Its name as the linker has it.
    pub raw: String,
    /// Where it is; a function's first instruction, the Thumb bit cleared.
    pub address: u32,
    /// Its size in bytes, 0 where the file does not say.
    pub size: u32,
    /// Whether it is a function.
    pub function: bool,
}

/// A section of the firmware that occupies memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Its name, such as `.rodata`.
    pub name: String,
    /// Where the firmware sees it, in memory.
    pub address: u32,
    /// Its size in bytes.
    pub size: u32,
    /// Whether the file holds bytes for it; `.bss` and `.noinit` have none.
    pub loaded: bool,
}

/// One stretch of bytes that is written to flash.
#[derive(Debug, Clone)]
struct Load {
    /// Where the firmware sees it.
    seen: u32,
    /// Where it is stored.
    stored: u32,
    /// Where its bytes are in the file.
    bytes: Range<usize>,
}

/// A firmware.
#[derive(Debug, Clone)]
pub struct Elf {
    path: PathBuf,
    bytes: Vec<u8>,
    loads: Vec<Load>,
    sections: Vec<Section>,
    symbols: Vec<Symbol>,
}

impl Elf {
    /// Reads the firmware at `path`.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, that is no little-endian 32-bit ELF file, or that was built for
    /// another machine than Arm.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ElfError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|why| ElfError::Read {
            path: path.to_owned(),
            why,
        })?;
        Self::new(path, bytes)
    }

    /// The firmware in `bytes`, called `path` in errors.
    ///
    /// # Errors
    ///
    /// As for [`Elf::load`], less reading the file.
    pub fn new(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, ElfError> {
        let path = path.as_ref().to_owned();
        let wrong = |why: object::read::Error| ElfError::NotElf {
            path: path.clone(),
            why: why.to_string(),
        };
        let file = ElfFile32::<Endianness>::parse(bytes.as_slice()).map_err(wrong)?;
        let machine = file.elf_header().e_machine(file.endian());
        if machine != elf::EM_ARM {
            return Err(ElfError::OtherMachine { path, machine });
        }
        let mut loads = Vec::new();
        for header in file.elf_program_headers() {
            let endian = file.endian();
            if header.p_type(endian) == elf::PT_LOAD && header.p_filesz(endian) > 0 {
                let data = header.data(endian, bytes.as_slice()).map_err(|()| {
                    let why = "a segment ends past the end of the file".to_owned();
                    ElfError::NotElf {
                        path: path.clone(),
                        why,
                    }
                })?;
                let start = header.p_offset(endian) as usize;
                loads.push(Load {
                    seen: header.p_vaddr(endian),
                    stored: header.p_paddr(endian),
                    bytes: start..start + data.len(),
                });
            }
        }
        let sections = file
            .sections()
            .filter(|section| section.address() != 0 && section.size() != 0)
            .filter_map(|section| {
                Some(Section {
                    name: section.name().ok()?.to_owned(),
                    address: u32::try_from(section.address()).ok()?,
                    size: u32::try_from(section.size()).ok()?,
                    loaded: section.kind() != SectionKind::UninitializedData,
                })
            })
            .collect();
        let mut symbols: Vec<Symbol> = file
            .symbols()
            .filter(|symbol| symbol.is_definition() || symbol.kind() == SymbolKind::Label)
            .filter_map(|symbol| {
                let raw = symbol.name().ok().filter(|name| !name.starts_with('$'))?;
                let function = symbol.kind() == SymbolKind::Text;
                let address = u32::try_from(symbol.address()).ok()?;
                (!raw.is_empty()).then(|| Symbol {
                    name: format!("{:#}", rustc_demangle::demangle(raw)),
                    raw: raw.to_owned(),
                    address: if function { address & !1 } else { address },
                    size: u32::try_from(symbol.size()).unwrap_or(0),
                    function,
                })
            })
            .collect();
        symbols.sort_by(|a, b| (a.address, &a.name).cmp(&(b.address, &b.name)));
        Ok(Self {
            path,
            bytes,
            loads,
            sections,
            symbols,
        })
    }

    /// Where the file was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Every symbol, by ascending address.
    pub fn symbols(&self) -> &[Symbol] {
        &self.symbols
    }

    /// Every section that occupies memory.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// The section called `name`.
    ///
    /// # Errors
    ///
    /// No section has the name.
    pub fn section(&self, name: &str) -> Result<&Section, ElfError> {
        self.sections
            .iter()
            .find(|section| section.name == name)
            .ok_or_else(|| no_symbol("section", name))
    }

    /// The symbol `name` means: the one of exactly that name, mangled or demangled, else the one
    /// whose demangled name ends in it, else the one that contains it. `..` stands for anything:
    /// `synth::Synth<..>::render`.
    ///
    /// # Errors
    ///
    /// None or several match.
    pub fn symbol(&self, name: &str) -> Result<&Symbol, ElfError> {
        self.find("symbol", name, |_| true)
    }

    /// [`Elf::symbol`] among functions alone.
    ///
    /// # Errors
    ///
    /// None or several match.
    pub fn function(&self, name: &str) -> Result<&Symbol, ElfError> {
        self.find("function", name, |symbol| symbol.function)
    }

    /// Every symbol whose demangled name contains `part`.
    pub fn matching<'a>(&'a self, part: &'a str) -> impl Iterator<Item = &'a Symbol> {
        self.symbols
            .iter()
            .filter(move |symbol| symbol.name.contains(part))
    }

    /// The name of what is at `address`, with the offset into it: `main+0x12`.
    pub fn name_of(&self, address: u32) -> Option<String> {
        let upto = self.symbols.partition_point(|s| s.address <= address);
        let symbol = self.symbols[..upto]
            .iter()
            .rev()
            .find(|symbol| symbol.function && address - symbol.address < symbol.size.max(2))?;
        Some(match address - symbol.address {
            0 => symbol.name.clone(),
            offset => format!("{}+{offset:#x}", symbol.name),
        })
    }

    /// The `length` bytes the file places at `address`, as stored or as the firmware sees them.
    ///
    /// # Errors
    ///
    /// The file places nothing there.
    pub fn read(&self, address: u32, length: usize) -> Result<&[u8], ElfError> {
        self.range(address, length).map(|range| &self.bytes[range])
    }

    /// Writes `bytes` over what the file places at `address`, before it boots.
    ///
    /// # Errors
    ///
    /// The file places nothing there.
    pub fn patch(&mut self, address: u32, bytes: &[u8]) -> Result<(), ElfError> {
        let range = self.range(address, bytes.len())?;
        self.bytes[range].copy_from_slice(bytes);
        Ok(())
    }

    /// [`Elf::patch`] from the start of the symbol `name` means.
    ///
    /// # Errors
    ///
    /// As for [`Elf::symbol`] and [`Elf::patch`].
    pub fn patch_symbol(&mut self, name: &str, bytes: &[u8]) -> Result<(), ElfError> {
        let address = self.symbol(name)?.address;
        self.patch(address, bytes)
    }

    /// The file's bytes, patches included.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    fn range(&self, address: u32, length: usize) -> Result<Range<usize>, ElfError> {
        let holds = |base: u32, load: &Load| {
            let offset = usize::try_from(address.checked_sub(base)?).ok()?;
            let end = offset.checked_add(length)?;
            (end <= load.bytes.len()).then(|| load.bytes.start + offset..load.bytes.start + end)
        };
        self.loads
            .iter()
            .find_map(|load| holds(load.seen, load).or_else(|| holds(load.stored, load)))
            .ok_or(ElfError::Unplaced {
                address,
                end: address.saturating_add(u32::try_from(length).unwrap_or(u32::MAX)),
            })
    }

    fn find(
        &self,
        kind: &'static str,
        name: &str,
        wanted: impl Fn(&Symbol) -> bool,
    ) -> Result<&Symbol, ElfError> {
        let exact = |symbol: &Symbol| symbol.raw == name || symbol.name == name;
        let suffix = |symbol: &Symbol| matches(&symbol.name, name, true);
        let inside = |symbol: &Symbol| matches(&symbol.name, name, false);
        for rule in [&exact as &dyn Fn(&Symbol) -> bool, &suffix, &inside] {
            let mut found: Vec<&Symbol> = self
                .symbols
                .iter()
                .filter(|symbol| wanted(symbol) && rule(symbol))
                .collect();
            // Identical functions the linker folded have one address and are one place.
            found.dedup_by_key(|symbol| symbol.address);
            match found.as_slice() {
                [] => {}
                [one] => return Ok(one),
                many => {
                    return Err(ElfError::Ambiguous {
                        name: name.to_owned(),
                        candidates: many.iter().take(8).map(|s| s.name.clone()).collect(),
                    });
                }
            }
        }
        Err(no_symbol(kind, name))
    }
}

fn no_symbol(kind: &'static str, name: &str) -> ElfError {
    ElfError::NoSymbol {
        kind,
        name: name.to_owned(),
    }
}

/// Whether the parts of `pattern` between `..` occur in `name` in order, the last at its end when
/// `suffix`. A suffix starts at a whole word.
fn matches(name: &str, pattern: &str, suffix: bool) -> bool {
    let parts: Vec<&str> = pattern
        .split("..")
        .filter(|part| !part.is_empty())
        .collect();
    let Some((last, firsts)) = parts.split_last() else {
        return false;
    };
    let mut from = 0;
    for part in firsts {
        match name[from..].find(part) {
            Some(at) => from += at + part.len(),
            None => return false,
        }
    }
    if !suffix {
        return name[from..].contains(last);
    }
    let whole = |at: usize| {
        let before = name[..at].chars().next_back();
        !firsts.is_empty() || before.is_none_or(|c| !c.is_alphanumeric() && c != '_')
    };
    name[from..].ends_with(last) && whole(name.len() - last.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_matches_in_order_and_a_suffix_starts_at_a_word() {
        let name = "<freshet::synth::Synth<32>>::render";
        assert!(matches(name, "Synth<..>::render", true));
        assert!(matches(name, "render", true));
        assert!(!matches(name, "ender", true));
        assert!(matches(name, "ynth<..>>::ren", false));
        assert!(!matches(name, "render..Synth", false));
        assert!(!matches(name, "..", false));
    }

    #[test]
    fn what_is_no_firmware_is_said_to_be_none() {
        let missing = Elf::load("/nonexistent/firmware");
        assert!(matches!(missing, Err(ElfError::Read { .. })), "{missing:?}");
        let text = Elf::new("readme", b"not an ELF file at all, just text".to_vec());
        assert!(matches!(text, Err(ElfError::NotElf { .. })), "{text:?}");
        let empty = Elf::new("empty", Vec::new());
        assert!(matches!(empty, Err(ElfError::NotElf { .. })), "{empty:?}");
        let host = Elf::load(std::env::current_exe().expect("this test"));
        assert!(host.is_err(), "a program of the desk is no firmware");
    }
}
