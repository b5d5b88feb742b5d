//! Makes clusters of this machine, shares work between their nodes, loses one in the middle, and compares the results with those
//! of one machine.
//!
//! They run the commands that docs/many-machines.md shows.

mod daemon;
mod guide;
mod ray_cluster;
mod shared_folder;
mod slurm_cluster;

use anyhow::Result;
use clap::{Args, ValueEnum};

use self::shared_folder::SharedFolder;
use crate::system::process::built_program;

/// The clusters to make.
#[derive(Args)]
pub struct Clusters {
    /// One engine alone
    #[arg(value_name = "ENGINE")]
    engine: Option<ClusterEngine>,
}

/// The software that shares work between nodes.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ClusterEngine {
    Slurm,
    Ray,
}

impl Clusters {
    /// Both clusters.
    pub const ALL: Clusters = Clusters { engine: None };

    /// Makes them. It needs Linux, and Slurm needs root.
    pub fn run(&self) -> Result<()> {
        let is_asked_for = |engine| self.engine.is_none_or(|one| one == engine);
        let folder = SharedFolder::new(built_program()?)?;
        if is_asked_for(ClusterEngine::Slurm) {
            slurm_cluster::check(&folder)?;
        }
        if is_asked_for(ClusterEngine::Ray) {
            ray_cluster::check(&folder)?;
        }
        Ok(())
    }
}
