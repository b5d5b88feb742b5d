//! The vector instructions of x86-64.

/// Defines a token from the one list of its processor features, which are those that
/// [`Isa::compiled`](super::Isa::compiled) enables, that its constructor demands, and that its constant
/// names.
macro_rules! token {
    ($(#[$doc:meta])* $token:ident: $($feature:literal),+) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $token(());

        impl $token {
            /// The processor features that it needs, as `is_x86_feature_detected!` names them.
            pub const FEATURES: &[&str] = &[$($feature),+];

            /// The token.
            ///
            /// # Safety
            /// The processor has all [`FEATURES`](Self::FEATURES).
            pub const unsafe fn new() -> $token {
                $token(())
            }

            /// Runs work in a function compiled for these features.
            fn run<W: Work>(self, work: W) {
                $(#[target_feature(enable = $feature)])+
                fn run<W: Work>(work: W) {
                    work.run();
                }
                // SAFETY: who made the token vouched for the features.
                unsafe { run(work) }
            }
        }

        impl Sealed for $token {}
    };
}

mod avx2;
mod avx2_bytes;
mod avx512;
mod avx512_bytes;

pub use avx2::Avx2;
pub use avx512::Avx512;
