//! The cost of emulated firmware, by function: the price of each block that the emulator ran, times how often it ran.

use anyhow::{Result, ensure};
use multiscopic::Processor;
use std::{collections::BTreeMap, path::Path};

use crate::{
    emulation::{
        self,
        counter::{self, BlockTrace, Counter, Instructions, Succession, TracedBlock},
        emulated_board::EmulatedBoard,
    },
    timing::{self, Disassembly},
};

/// The least share of the cycles, in percent, of a function that is printed.
const SHARE: f64 = 3.0;

/// The cost of a run, or of a function in it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    pub instructions: u64,
    pub cycles: u64,
}

impl Cost {
    pub fn cycles_per_instruction(self) -> f64 {
        self.cycles as f64 / self.instructions as f64
    }
}

impl std::iter::Sum for Cost {
    fn sum<I: Iterator<Item = Cost>>(costs: I) -> Cost {
        costs.fold(Cost::default(), |sum, cost| Cost {
            instructions: sum.instructions + cost.instructions,
            cycles: sum.cycles + cost.cycles,
        })
    }
}

/// Runs `image` in `folder`, and returns the cost of each function.
pub fn traced(board: &EmulatedBoard, image: &Path, folder: &Path, counter: &Counter) -> Result<BTreeMap<String, Cost>> {
    let plugin = format!("{},{}", counter.plugin(image)?, counter::TRACE_ARGUMENT);
    let exit = emulation::run(board, image, &[], folder, Some(&plugin))?;
    ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
    let costs = priced(&counter::read_trace(folder)?, &Disassembly::of(image, board.processor)?, board.processor)?;
    let (traced, counted) = (costs.values().copied().sum::<Cost>().instructions, Instructions::read(folder)?.pipeline());
    ensure!(traced == counted, "the blocks have {traced} instructions, the emulator counted {counted}");
    Ok(costs)
}

/// The cost of each function in `trace`.
fn priced(trace: &BlockTrace, disassembly: &Disassembly, processor: Processor) -> Result<BTreeMap<String, Cost>> {
    let code = |block: TracedBlock| disassembly.code(block.address, block.instructions);
    let pairs: Vec<_> = trace.keys().map(|pair| pair.map(code)).collect();
    let added = timing::added(processor, pairs.iter().map(|pair| pair.each_ref().map(|code| &*code.instructions)))?;
    let mut costs = BTreeMap::<String, Cost>::new();
    for (((&[_, block], &Succession { times, splits }), [before, after]), added) in trace.iter().zip(&pairs).zip(added) {
        let branch = before.instructions.last().filter(|_| before.end != block.address);
        let refill = branch.map_or(0, |branch| timing::refill(processor, branch));
        let cost = costs.entry(disassembly.function(block.address)?.to_owned()).or_default();
        cost.instructions += times * after.instructions.len() as u64;
        cost.cycles += times * (added + refill) + splits * timing::split(processor);
    }
    Ok(costs)
}

/// Prints the cost of a run and of its most expensive functions.
pub fn print(run: &str, total: Cost, functions: &BTreeMap<String, Cost>, evaluations: f64, unit: &str) {
    let line = |cost: Cost, name: &str| {
        let [instructions, cycles] = [cost.instructions, cost.cycles].map(|count| count as f64 / evaluations);
        let name = name.rsplit_once("::h").map_or(name, |(name, _)| name);
        println!("{instructions:>9.3} {cycles:>9.3} {:>9.2}  {name}", cost.cycles_per_instruction());
    };
    println!("cycles: {run}: instructions and cycles per {unit}, cycles per instruction");
    line(total, "all");
    let mut functions: Vec<_> =
        functions.iter().filter(|(_, cost)| 100.0 * cost.cycles as f64 > SHARE * total.cycles as f64).collect();
    functions.sort_by_key(|(_, cost)| std::cmp::Reverse(cost.cycles));
    functions.iter().for_each(|(name, cost)| line(**cost, name));
}
