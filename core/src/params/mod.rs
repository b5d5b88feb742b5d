//! Parameters: what is searched, and by which method. Immutable and validated.
//!
//! | module | what it is |
//! | --- | --- |
//! | `search` | [`SearchConfig`], [`SearchSpace`]: frames, views and search range, whatever the method |
//! | `prior` | [`Prior`]: the disparities around which is searched |
//! | `block_matching` | [`BlockMatchingParams`]: a search by block matching |
//! | `semi_global` | [`SemiGlobalParams`], [`Census`]: a search by semi-global matching |

mod block_matching;
mod prior;
mod search;
mod semi_global;

pub use block_matching::BlockMatchingParams;
pub use prior::Prior;
pub(crate) use prior::{PriorLine, available_from};
pub use search::{ParamsError, SearchConfig, SearchSpace};
pub use semi_global::{Census, PathPenalties, SemiGlobalCost, SemiGlobalParams};
