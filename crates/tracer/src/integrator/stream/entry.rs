//! Entry points of the stages that work in lanes: one for each level of instructions.

#![allow(unsafe_code)]

use super::paths::{Paths, Place};
use super::{Wave, camera, diffuse, find, finish, numbers};
use crate::SimdLevel;
use crate::lanes::Plain;
use film::SampleBuffer;

/// Makes an entry point for each level out of a generic stage and picks one.
macro_rules! entry {
    ($(#[$doc:meta])* $name:ident, $module:ident :: $stage:ident, $arg:ident : $type:ty, $ret:ty) => {
        $(#[$doc])*
        pub(super) fn $name(level: SimdLevel, wave: &Wave, paths: &mut Paths, $arg: $type) -> $ret {
            #[cfg(target_arch = "x86_64")]
            {
                use crate::lanes::Avx2;
                #[target_feature(enable = "avx2")]
                fn avx2(wave: &Wave, paths: &mut Paths, $arg: $type) -> $ret {
                    $module::$stage::<Avx2>(wave, paths, $arg)
                }
                #[target_feature(enable = "avx2,avx512f,avx512vl")]
                fn avx512(wave: &Wave, paths: &mut Paths, $arg: $type) -> $ret {
                    $module::$stage::<Avx2>(wave, paths, $arg)
                }
                match level {
                    // SAFETY: `SimdLevel::available` has found the features on this processor.
                    SimdLevel::Avx512 => return unsafe { avx512(wave, paths, $arg) },
                    // SAFETY: as above.
                    SimdLevel::Avx2 => return unsafe { avx2(wave, paths, $arg) },
                    SimdLevel::Sse2 | SimdLevel::Scalar => {}
                }
            }
            let _ = level;
            $module::$stage::<Plain>(wave, paths, $arg)
        }
    };
}

entry! {
    /// Numbers of the lattice; see [`numbers::lattice`].
    lattice, numbers::lattice, places: &[Place], ()
}
entry! {
    /// See [`find::find`].
    find, find::find, places: &[Place], ()
}
entry! {
    /// See [`find::find_flat`].
    find_flat, find::find_flat, places: &[Place], ()
}
entry! {
    /// See [`diffuse::scatter`].
    scatter_diffuse, diffuse::scatter, places: &[Place], ()
}
entry! {
    /// See [`camera::rays`].
    camera_rays, camera::rays, all: (), ()
}
entry! {
    /// See [`finish::add`].
    finish, finish::add, buffer: &mut SampleBuffer, u64
}
