//! Entry points of the stages that work in lanes: one for each level of instructions.

#![allow(unsafe_code)]

use super::paths::{Paths, Place};
use super::{Wave, camera, find, finish, numbers, scatter};
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
                // AVX-512 would bring nothing but its wider copies, which slow the clock down.
                if level >= SimdLevel::Avx2 {
                    // SAFETY: `SimdLevel::available` has found the feature on this processor.
                    return unsafe { avx2(wave, paths, $arg) };
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
    /// See [`find::find_meshes`].
    find_meshes, find::find_meshes, places: &[Place], ()
}
entry! {
    /// See [`find::find_flat`].
    find_flat, find::find_flat, places: &[Place], ()
}
entry! {
    /// See [`find::find_spheres`].
    find_spheres, find::find_spheres, places: &[Place], ()
}
entry! {
    /// See [`scatter::diffuse`].
    scatter_diffuse, scatter::diffuse, places: &[Place], ()
}
entry! {
    /// See [`scatter::conductor`].
    scatter_conductor, scatter::conductor, places: &[Place], ()
}
entry! {
    /// See [`scatter::dielectric`].
    scatter_dielectric, scatter::dielectric, places: &[Place], ()
}
entry! {
    /// See [`scatter::aim_conductor`].
    aim_conductor, scatter::aim_conductor, places: &[Place], ()
}
entry! {
    /// See [`camera::rays`].
    camera_rays, camera::rays, all: (), ()
}
entry! {
    /// See [`finish::add`].
    finish, finish::add, buffer: &mut SampleBuffer, u64
}
