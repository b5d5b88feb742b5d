//! The command line that the firmware is started with.

use multiscopic_core::{BlockMatchingParams, Fusion, SearchConfig, SemiGlobalCost, SemiGlobalParams, Views};
use multiscopic_edge::Matching;
use semihosting::experimental::env;

use crate::{fault::FirmwareError, host_file::HostError};

/// The most bytes of a command line.
const COMMAND_LINE_BYTES: usize = 256;

/// The words of the command line. The first is the name of the program.
fn words() -> Result<env::Args<COMMAND_LINE_BYTES>, FirmwareError> {
    env::args::<COMMAND_LINE_BYTES>().map_err(|error| FirmwareError::CommandLine(HostError(error)))
}

/// The fusion that is the only argument.
///
/// Not inlined, so that the command line leaves the stack before matching begins.
#[inline(never)]
pub fn fusion() -> Result<Fusion, FirmwareError> {
    let words = words()?;
    (&words).nth(1).and_then(Result::ok).and_then(fusion_of).ok_or(FirmwareError::Fusion)
}

/// The computation of a calibration.
///
/// The arguments are width, height, number of views (1 to 4, or 8), smallest disparity, number of disparities,
/// block size, fusion, columns of a tile, and the method: `bm`, `sgm` with sums of absolute differences,
/// or `bm-around` with the long baseline in short ones and the number of disparities there.
///
/// Not inlined, like [`fusion`].
#[inline(never)]
pub fn calibration() -> Option<Matching> {
    let words = words().ok()?;
    let mut words = (&words).into_iter().skip(1).map_while(Result::ok);
    let (width, height) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let views = match words.next()? {
        "1" => Views::STEREO,
        "2" => Views::HORIZONTAL,
        "3" => Views::THREE,
        "4" => Views::CROSS,
        "8" => Views::ARRAY,
        _ => return None,
    };
    let (min_disparity, num_disparities) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let block_size = words.next()?.parse().ok()?;
    let search = SearchConfig { width, height, views, fusion: fusion_of(words.next()?)?, min_disparity, num_disparities }
        .checked()
        .ok()?;
    let tile_width = words.next()?.parse().ok()?;
    let blocks = || BlockMatchingParams::block_matching(search, block_size).ok();
    Some(match words.next()? {
        "bm" => Matching::Blocks { params: blocks()?, tile_width },
        "sgm" => Matching::SemiGlobal(SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size }).ok()?),
        "bm-around" => {
            let multiple = words.next()?.parse().ok()?;
            Matching::around_prior(blocks()?, multiple, words.next()?.parse().ok()?)?
        }
        _ => return None,
    })
}

fn fusion_of(name: &str) -> Option<Fusion> {
    Fusion::ALL.into_iter().find(|fusion| fusion.name() == name)
}
