//! The Cortex-M4: one instruction after another. LLVM's model knows this processor too, but not the registers of a
//! multiple transfer, nor that an isolated load takes two cycles.

use super::instruction::Instruction;

/// Cycles of a division, which takes 2 to 12 cycles by its operands.
const DIVISION: u64 = 7;

/// The cycles of `sequence` by Arm's Cortex-M4 Technical Reference Manual, table 3-1.
pub fn cycles(sequence: &[&Instruction]) -> u64 {
    let next = sequence.iter().skip(1).map(Some).chain([None]);
    sequence.iter().zip(next).map(|(instruction, next)| alone(instruction) + wait(instruction, next.copied())).sum()
}

fn alone(instruction: &Instruction) -> u64 {
    match instruction.transfers() {
        Some(registers) => 1 + registers,
        None if instruction.name().contains("div") => DIVISION,
        None => 1,
    }
}

/// The second cycle of a load, which only a load or store of one register overlaps.
fn wait(instruction: &Instruction, next: Option<&Instruction>) -> u64 {
    let waits = instruction.is_load() && next.is_some_and(|next| !next.is_load() && !next.is_store());
    u64::from(waits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_in_a_row_overlap() {
        let cycles = |lines: &[&str]| {
            let sequence: Vec<_> = lines.iter().map(|line| Instruction::new(line)).collect();
            cycles(&sequence.iter().collect::<Vec<_>>())
        };
        let (load, add) = ("ldr r0, [r1]", "add r2, r3");
        assert_eq!(cycles(&[load, add]), 3);
        assert_eq!(cycles(&[load, load, load, add]), 5);
        assert_eq!(cycles(&[load, "str r0, [r2]", add]), 3);
        assert_eq!(cycles(&["ldm r0!, {r4, r5, r6, r7}", "ldrd r2, r3, [sp]"]), 5 + 3);
        assert_eq!(cycles(&[]), 0);
    }
}
