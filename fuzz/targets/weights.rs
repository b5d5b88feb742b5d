//! Weights of networks: safetensors, wheels, files of PyTorch, and the format of our own.

#![no_main]

use libfuzzer_sys::fuzz_target;
use multiscopic::stereo::{
    cost::mccnn::{Architecture, Weights, checkpoint, package},
    network::DisparityNetwork,
};
use multiscopic_fuzz::file;

fuzz_target!(|bytes: &[u8]| {
    let path = file("weights", bytes);
    let _ = Weights::read(&path, Architecture::Fast);
    let _ = package::read(&path);
    let _ = checkpoint::model(bytes);
    let _ = DisparityNetwork::new(bytes);
});
