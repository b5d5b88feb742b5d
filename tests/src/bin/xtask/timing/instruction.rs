//! The properties of an instruction that its time depends on, read from its text.

/// An instruction as the disassembler prints it, with a label for the target of a branch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    text: String,
}

impl Instruction {
    /// Takes a line of the disassembler without its address.
    pub fn new(line: &str) -> Instruction {
        // A target is a number before its symbol: `bne 0x88a0 <match+0x10>`.
        let code = line.split(['@', '<']).next().unwrap_or_default().replace('\t', " ");
        let text = match code.trim().rsplit_once(' ') {
            Some((code, target)) if target.starts_with("0x") => format!("{code} .Ltarget"),
            _ => code,
        };
        Instruction { text: text.trim().to_owned() }
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its name without type and width: `ldr` of `ldr.w`, `vldrh` of `vldrh.u16`.
    pub fn name(&self) -> &str {
        let name = self.text.split(' ').next().unwrap_or_default();
        name.split('.').next().unwrap_or_default()
    }

    /// The number of registers that it loads or stores if they are several core registers.
    pub fn transfers(&self) -> Option<u64> {
        match self.name() {
            name if ["ldrd", "strd"].iter().any(|double| name.starts_with(double)) => Some(2),
            name if ["ldm", "stm", "push", "pop"].iter().any(|multiple| name.starts_with(multiple)) => {
                Some(self.text.split('{').nth(1).map_or(1, |list| list.split(',').count() as u64))
            }
            _ => None,
        }
    }

    /// Returns true if it loads one register.
    pub fn is_load(&self) -> bool {
        self.name().starts_with("ldr") && self.transfers().is_none()
    }

    /// Returns true if it stores one register.
    pub fn is_store(&self) -> bool {
        self.name().starts_with("str") && self.transfers().is_none()
    }

    /// The number of instructions after it that are conditional on it (IT, VPT, VPST).
    pub fn conditions(&self) -> usize {
        let of = |stem: &str| {
            let rest = self.name().strip_prefix(stem)?;
            rest.chars().all(|each| each == 't' || each == 'e').then_some(1 + rest.len())
        };
        ["it", "vpt", "vpst"].into_iter().find_map(of).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_are_read_from_their_text() {
        let branch = Instruction::new("bne.w\t0x88a0 <match+0x10>       @ imm = #-0x20");
        assert_eq!((branch.text(), branch.name()), ("bne.w .Ltarget", "bne"));
        assert_eq!(Instruction::new("ldr\tr0, [pc, #0x10] @ 0x8414 <match+0x4>").text(), "ldr r0, [pc, #0x10]");
        assert_eq!(Instruction::new("adr r1, #468 <match+0x103>").text(), "adr r1, #468");
        assert_eq!(Instruction::new("subs r0, #0x20").text(), "subs r0, #0x20");
        let transfers = |line| Instruction::new(line).transfers();
        assert_eq!(transfers("ldm.w r11!, {r4, r5, r6, r7}"), Some(4));
        assert_eq!((transfers("pop {pc}"), transfers("strd r0, r1, [sp]"), transfers("ldr r0, [r1]")), (Some(1), Some(2), None));
        let conditions = |line| Instruction::new(line).conditions();
        assert_eq!((conditions("it ne"), conditions("itte ne"), conditions("add r0, r1")), (1, 3, 0));
        assert_eq!((conditions("vpt.u16 hi, q0, q1"), conditions("vpste"), conditions("vpsel q0, q1, q2")), (1, 2, 0));
    }
}
