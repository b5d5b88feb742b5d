//! Weights of networks: safetensors, wheels, files of PyTorch, and the format of our own.

use multiscopic::stereo::{
    cost::mccnn::{Architecture, Weights, checkpoint, package},
    network::DisparityNetwork,
};

use crate::support::file;

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let path = file("weights", bytes);
    let _ = Weights::read(&path, Architecture::Fast);
    let _ = package::read(&path);
    let _ = checkpoint::model(bytes);
    let _ = DisparityNetwork::new(bytes);
    true
}
