//! The memory footprint of a linked image.

use anyhow::{Context, Result};
use object::{
    LittleEndian,
    elf::{FileHeader32, SHF_ALLOC, SHF_WRITE, SHT_NOBITS},
    read::elf::FileHeader,
};
use std::{fmt, fs, path::Path};

/// The size of an image by kind of memory, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Footprint {
    /// Code, constants and the vector table.
    pub text: u64,
    /// Initialised statics, which take RAM and flash.
    pub data: u64,
    /// Zeroed statics, which take RAM alone.
    pub bss: u64,
}

impl Footprint {
    /// The footprint of the ELF file at `path`.
    pub fn of(path: &Path) -> Result<Footprint> {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        measure(&bytes).with_context(|| format!("{} is not a 32-bit little-endian ELF file", path.display()))
    }

    /// The flash that the image takes.
    pub fn flash(&self) -> u64 {
        self.text + self.data
    }

    /// The RAM that the statics take.
    pub fn ram(&self) -> u64 {
        self.data + self.bss
    }
}

impl fmt::Display for Footprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Footprint { text, data, bss } = self;
        write!(f, "text {text} B, static RAM {} B (data {data}, bss {bss}), flash {} B", self.ram(), self.flash())
    }
}

fn measure(bytes: &[u8]) -> object::Result<Footprint> {
    let header = FileHeader32::<LittleEndian>::parse(bytes)?;
    let endian = header.endian()?;
    let mut footprint = Footprint::default();
    let sections = header.sections(endian, bytes)?;
    for section in sections.iter() {
        // Measured by itself. On Arm it is no section.
        if sections.section_name(endian, section)? == b".stack" {
            continue;
        }
        let (flags, size) = (section.sh_flags.get(endian), u64::from(section.sh_size.get(endian)));
        let has = |flag: u32| flags & flag != 0;
        match (has(SHF_ALLOC), has(SHF_WRITE), section.sh_type.get(endian)) {
            (false, ..) => {}
            (true, false, _) => footprint.text += size,
            (true, true, SHT_NOBITS) => footprint.bss += size,
            (true, true, _) => footprint.data += size,
        }
    }
    Ok(footprint)
}
