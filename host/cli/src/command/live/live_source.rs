//! The source of the page of `live`: a camera on a stage, or a captured folder.

use std::path::PathBuf;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, Id, value_parser};

use crate::command::capture::RecorderOptions;

/// A camera on a stage, or a captured folder.
#[derive(Debug)]
pub enum LiveSource {
    /// `RIG_DIR`.
    Rig(PathBuf),
    /// `--camera` and what it needs.
    Camera(Box<CameraOptions>),
}

/// The camera, the stage, and the folder of the sets.
#[derive(Debug, Args)]
pub struct CameraOptions {
    #[command(flatten)]
    pub recorder: RecorderOptions,

    /// Folder for the sets, which become its folders 0001, 0002, and so on
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

const RIG: &str = "rig";

/// The options of a camera are required unless there is a folder: clap does not derive that.
impl Args for LiveSource {
    fn augment_args(command: Command) -> Command {
        let command = CameraOptions::augment_args(command);
        let needed: Vec<Id> = ["camera", "stage", "output", "baseline"].map(Id::from).into();
        let command = needed.iter().fold(command, |command, id| {
            command.mut_arg(id, |arg| arg.required(false).required_unless_present(RIG).conflicts_with(RIG))
        });
        command.arg(
            Arg::new(RIG)
                .value_name("RIG_DIR")
                .value_parser(value_parser!(PathBuf))
                .help("Captured folder with a rig.toml, without a camera: the same as `multiscopic tune RIG_DIR`"),
        )
    }

    fn augment_args_for_update(command: Command) -> Command {
        LiveSource::augment_args(command)
    }
}

impl FromArgMatches for LiveSource {
    fn from_arg_matches(matches: &ArgMatches) -> Result<LiveSource, clap::Error> {
        Ok(match matches.get_one::<PathBuf>(RIG) {
            Some(rig) => LiveSource::Rig(rig.clone()),
            None => LiveSource::Camera(Box::new(CameraOptions::from_arg_matches(matches)?)),
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = LiveSource::from_arg_matches(matches)?;
        Ok(())
    }
}
