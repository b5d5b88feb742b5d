//! What a firmware image matches.

use multiscopic_core::{Fusion, Params, Views};

/// Parameters under a name.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// How reports name it.
    pub name: &'static str,
    /// What is matched.
    pub params: Params,
}

/// All four neighbours of a small frame.
pub const SMALL: Profile = profile("small", Params::new(160, 120, Views::ALL, Fusion::Heuristic, 1, 16, 7));

const fn profile(name: &'static str, params: Result<Params, multiscopic_core::ParamsError>) -> Profile {
    match params {
        Ok(params) => Profile { name, params },
        Err(_) => panic!("a profile's parameters are out of range: see Params::new"),
    }
}
