//! Parameters: what is searched, and by which method. Immutable and validated.
//!
//! | module | what it is |
//! | --- | --- |
//! | `search` | [`Search`]: frames, views and search range, whatever the method |
//! | `prior` | [`Prior`]: what an earlier match tells a search |
//! | `block_matching` | [`Params`]: a search by block matching |
//! | `census_transform` | [`Census`]: which pixels of a window are brighter than their opposites |
//! | `path_params` | [`SemiGlobalParams`]: a search by semi-global matching |

mod block_matching;
mod census_transform;
mod path_params;
mod prior;
mod search;

pub use block_matching::Params;
pub use census_transform::Census;
pub use path_params::{PathPenalties, SemiGlobalCost, SemiGlobalParams};
pub use prior::Prior;
pub use search::{ParamsError, Search, SearchConfig};
