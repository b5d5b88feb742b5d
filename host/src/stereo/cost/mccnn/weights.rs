//! The weights of a network, and their files.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
};

use safetensors::{Dtype, SafeTensorError, SafeTensors, View};

use crate::{
    error::{Error, Result},
    files::{input, output},
};

/// An array of any number of dimensions, the last of which is contiguous.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// The size of each dimension.
    pub shape: Vec<usize>,
    /// As many values as the product of the shape.
    pub values: Vec<f32>,
}

/// The architecture of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Architecture {
    /// 64 features per pixel, compared by their cosine.
    Fast,
    /// 112 features per pixel, compared by fully connected layers.
    Accurate,
}

impl Architecture {
    /// Both.
    pub const ALL: [Architecture; 2] = [Architecture::Fast, Architecture::Accurate];

    /// Its name, as in `--method mccnn-fast`.
    pub fn name(self) -> &'static str {
        match self {
            Architecture::Fast => "fast",
            Architecture::Accurate => "accurate",
        }
    }

    /// The number of aggregations before the optimization, and after it, as published for Middlebury.
    pub fn iterations(self) -> [usize; 2] {
        match self {
            Architecture::Fast => [0, 0],
            Architecture::Accurate => [2, 0],
        }
    }

    /// The number of features of a pixel.
    pub fn channels(self) -> usize {
        match self {
            Architecture::Fast => 64,
            Architecture::Accurate => 112,
        }
    }

    /// The name of the file of its weights, here and in the package, without the extension.
    pub(super) fn file_stem(self) -> String {
        format!("mc_cnn_{}_mb_weights", self.name())
    }

    /// The names and shapes of its tensors: weights are `[outputs, inputs, 3, 3]` in convolutions and
    /// `[outputs, inputs]` in fully connected layers.
    pub(super) fn shapes(self) -> BTreeMap<String, Vec<usize>> {
        let channels = self.channels();
        let convolutions =
            (0..5).map(|i| (format!("conv_blocks.{}", 2 * i), vec![channels, if i == 0 { 1 } else { channels }, 3, 3]));
        let connected = [[HIDDEN, 2 * channels], [HIDDEN, HIDDEN], [HIDDEN, HIDDEN], [1, HIDDEN]];
        let connected = connected.into_iter().enumerate().map(|(i, shape)| (format!("fl_blocks.{}", 2 * i), shape.to_vec()));
        let connected = connected.take(if self == Architecture::Accurate { 4 } else { 0 });
        let both = |(layer, shape): (String, Vec<usize>)| {
            [(format!("{layer}.bias"), vec![shape[0]]), (format!("{layer}.weight"), shape)]
        };
        convolutions.chain(connected).flat_map(both).collect()
    }
}

/// The outputs of each hidden, fully connected layer of the accurate network.
pub(super) const HIDDEN: usize = 384;

/// The weights of a network: complete, of the right shapes, and finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    architecture: Architecture,
    tensors: BTreeMap<String, Tensor>,
}

impl Weights {
    /// The folder of the weights: `$MULTISCOPIC_WEIGHTS`, else `multiscopic` in the user's folder for caches
    /// (`$XDG_CACHE_HOME` or `~/.cache`; on Windows, `%LOCALAPPDATA%`).
    ///
    /// # Errors
    /// If the user has no home.
    pub fn folder() -> Result<PathBuf> {
        if let Some(folder) = env::var_os("MULTISCOPIC_WEIGHTS").filter(|folder| !folder.is_empty()) {
            return Ok(folder.into());
        }
        let home = env::home_dir()
            .ok_or_else(|| Error::Usage("there is no folder for weights: set HOME or MULTISCOPIC_WEIGHTS".into()))?;
        let (variable, usual) = if cfg!(windows) { ("LOCALAPPDATA", "AppData/Local") } else { ("XDG_CACHE_HOME", ".cache") };
        let caches = env::var_os(variable).map(PathBuf::from).filter(|folder| folder.is_absolute());
        Ok(caches.unwrap_or_else(|| home.join(usual)).join("multiscopic"))
    }

    /// The file in `folder` for the weights of a network.
    pub fn file(folder: &Path, architecture: Architecture) -> PathBuf {
        folder.join(architecture.file_stem() + ".safetensors")
    }

    /// Reads the installed weights.
    ///
    /// # Errors
    /// As [`read`](Weights::read). If the weights are not installed, the error says how to install them.
    pub fn load(architecture: Architecture) -> Result<Weights> {
        let path = Weights::installed(architecture)?;
        Weights::read(&path, architecture)
    }

    /// The file of the installed weights.
    ///
    /// # Errors
    /// If they are not installed. The error says how to install them.
    pub fn installed(architecture: Architecture) -> Result<PathBuf> {
        let path = Weights::file(&Weights::folder()?, architecture);
        if path.is_file() {
            return Ok(path);
        }
        let (name, path) = (architecture.name(), path.display());
        Err(Error::Usage(format!(
            "the weights of mccnn-{name} are not installed, there is no {path}: run `multiscopic weights install`"
        )))
    }

    /// Reads a safetensors file.
    ///
    /// # Errors
    /// If the file cannot be read, or does not have exactly the tensors of the network, in their shapes, with
    /// finite `f32` values.
    pub fn read(path: &Path, architecture: Architecture) -> Result<Weights> {
        let bytes = input::read(path)?;
        let expected = || format!("the weights of mccnn-{}: run `multiscopic weights install`", architecture.name());
        let file = SafeTensors::deserialize(&bytes)
            .map_err(|error| Error::format(path, format!("no safetensors file ({error})"), expected()))?;
        let tensor = |(name, view): (String, safetensors::tensor::TensorView)| {
            if view.dtype() != Dtype::F32 {
                return Err(format!("{name} as {:?}", view.dtype()));
            }
            let values = view.data().as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
            Ok((name, Tensor { shape: view.shape().to_vec(), values }))
        };
        let tensors = file.tensors().into_iter().map(tensor).collect::<std::result::Result<_, _>>();
        tensors.and_then(|tensors| Weights::new(architecture, tensors)).map_err(|found| Error::format(path, found, expected()))
    }

    /// The weights in `tensors`.
    ///
    /// # Errors
    /// A description of the first fault.
    pub(super) fn new(architecture: Architecture, tensors: BTreeMap<String, Tensor>) -> std::result::Result<Weights, String> {
        let shapes = architecture.shapes();
        if let Some(name) = tensors.keys().find(|name| !shapes.contains_key(*name)) {
            return Err(format!("an unknown tensor {name:?}"));
        }
        for (name, shape) in &shapes {
            match tensors.get(name) {
                None => return Err(format!("no tensor {name}")),
                Some(tensor) if tensor.shape != *shape => {
                    return Err(format!("{name} of shape {:?} instead of {shape:?}", tensor.shape));
                }
                Some(tensor) if !tensor.values.iter().all(|value| value.is_finite()) => {
                    return Err(format!("{name} with values that are not finite"));
                }
                Some(_) => {}
            }
        }
        Ok(Weights { architecture, tensors })
    }

    /// Writes a safetensors file, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = safetensors::serialize(&self.tensors, None)
            .map_err(|error: SafeTensorError| Error::Write { path: path.into(), source: std::io::Error::other(error) })?;
        output::write(path, |writer| writer.write_all(&bytes))
    }

    /// The architecture that the weights are for.
    pub fn architecture(&self) -> Architecture {
        self.architecture
    }

    /// The weights and the biases of a layer, such as `conv_blocks.0`.
    ///
    /// # Panics
    /// If the network has no such layer.
    pub(super) fn layer(&self, name: &str) -> (&[f32], &[f32]) {
        let values = |kind: &str| self.tensors[&format!("{name}.{kind}")].values.as_slice();
        (values("weight"), values("bias"))
    }
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        self.values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn data_len(&self) -> usize {
        4 * self.values.len()
    }
}
