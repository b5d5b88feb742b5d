//! A match as a header for C: its method, memory and parameters.

use multiscopic::{Error, Result};
use multiscopic_core::{ConfidenceLines, Fusion};
use multiscopic_edge::{Matching, packet, state_pointers};

/// The header of `matching`, for programs with `multiscopic.h` on processors of 32 bits.
///
/// # Errors
/// The library for C does not have the method.
pub fn c_header(matching: &Matching) -> Result<String> {
    let Some(params) = matching.block_matching().filter(|_| matching.long_search().is_none()) else {
        return Err(Error::Usage("--header: the library for C has neither the network nor matches around a prior".into()));
    };
    let (search, columns, method) = (matching.search(), matching.tile_width(), matching.name());
    let views: Vec<String> = search.views().iter().map(|view| format!("{{{}, {}}}", view.right(), view.down())).collect();
    let places = search.views().places();
    // The methods for a number of views have sums of 16 bits.
    let of_views = if params.has_wide_sums() { String::new() } else { places.to_string() };
    let (confidence, of_confidences) = match matching.has_confidences() {
        true => ("_confidence", ConfidenceLines::memory_words(columns)),
        false => ("", 0),
    };
    let fusion = match search.fusion() {
        Fusion::Min => "MULTISCOPIC_MIN",
        Fusion::Mean => "MULTISCOPIC_MEAN",
        Fusion::Heuristic => "MULTISCOPIC_HEURISTIC",
        Fusion::Half => "MULTISCOPIC_HALF",
        Fusion::Trimmed => "MULTISCOPIC_TRIMMED",
    };
    Ok(format!(
        "/* A match by multiscopic.h, on processors of 32 bits: `multiscopic budget --header` wrote it. */\n\
         #define DEPTH_METHOD multiscopic_{method}{of_views}{confidence}\n\
         #define DEPTH_WIDTH {width}\n\
         #define DEPTH_HEIGHT {height}\n\
         #define DEPTH_COLUMNS {columns} /* disparities of a line */\n\
         #define DEPTH_MEMORY_WORDS {words}\n\
         #define DEPTH_PACKET_BUFFER_BYTES {bytes}\n\
         #define DEPTH_PARAMS \\\n    \
         {{{width}, {height}, {first}, {count}, {{{offsets}}}, {number}, {fusion}, {block}, 0, MULTISCOPIC_NO_CENSUS, 0, 0, 0}}\n",
        width = search.width(),
        height = search.height(),
        words = state_pointers(places) + of_confidences + matching.lengths().matcher.words(),
        bytes = packet::buffer_bytes_with_confidences(columns),
        first = search.min_disparity(),
        count = search.num_disparities(),
        offsets = views.join(", "),
        number = views.len(),
        block = params.block_size(),
    ))
}
