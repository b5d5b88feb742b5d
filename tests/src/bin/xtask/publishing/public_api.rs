//! Compares what the published crates offer with what they offered before.

use anyhow::{Context, Result};
use clap::Args;

use super::crates;
use crate::{
    system::process::{command, read, run},
    tools::cargo_tool,
};

/// The features with which the host is compared: all but `v4l2`, whose published bindings need libclang.
const HOST_FEATURES: &str = "calibration,live,manuals,mcap,scene";

/// What to compare with.
#[derive(Args)]
pub struct PublicApi {
    /// The revision of before [default: the newest tag]
    #[arg(long, value_name = "REVISION")]
    baseline: Option<String>,
}

impl PublicApi {
    /// Fails if something that was public is gone or asks for more, and the version does not say so.
    pub fn check(&self) -> Result<()> {
        let newest_tag = || {
            read(&mut command("git", ["describe", "--tags", "--abbrev=0"]))
                .context("there is no tag to compare with: give --baseline REVISION")
        };
        let baseline = self.baseline.clone().map_or_else(newest_tag, Ok)?;
        for package in crates::PUBLISHED {
            let mut check = cargo_tool::SEMVER_CHECKS.command()?;
            check.args(["--baseline-rev", &baseline, "--package", package]);
            if package == crates::HOST {
                check.args(["--only-explicit-features", "--features", HOST_FEATURES]);
            }
            run(&mut check)?;
        }
        Ok(())
    }
}
