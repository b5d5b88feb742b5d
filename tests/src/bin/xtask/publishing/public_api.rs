//! Compares what the published crates offer with what they offered before.

use anyhow::Result;
use clap::Args;

use super::crates;
use crate::{
    system::{command, read, run},
    tools,
};

/// The features with which the host is compared: all but `v4l2`, whose published bindings need libclang.
const HOST_FEATURES: &str = "calibration,mcap,scene";

/// The comparison of the public API with an earlier one.
#[derive(Args)]
pub struct PublicApi {
    /// The revision of before [default: the newest tag]
    #[arg(long, value_name = "REVISION")]
    baseline: Option<String>,
}

impl PublicApi {
    /// Compares with the newest tag.
    pub const SINCE_TAG: PublicApi = PublicApi { baseline: None };

    /// Fails if something that was public is gone or asks for more, and the version does not say so.
    pub fn check(&self) -> Result<()> {
        let newest_tag = || read(&mut command("git", ["describe", "--tags", "--abbrev=0"])).ok();
        let Some(baseline) = self.baseline.clone().or_else(newest_tag) else {
            println!("semver: skipped, there is no tag to compare with: give --baseline REVISION");
            return Ok(());
        };
        for package in crates::PUBLISHED.into_iter().filter(|&package| package != crates::PROGRAM) {
            let mut check = tools::SEMVER_CHECKS.command()?;
            check.args(["--baseline-rev", &baseline, "--package", package]);
            if package == crates::HOST {
                check.args(["--only-explicit-features", "--features", HOST_FEATURES]);
            }
            run(&mut check)?;
        }
        Ok(())
    }
}
