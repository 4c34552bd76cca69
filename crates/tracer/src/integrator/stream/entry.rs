//! Entry points of the stages that work in lanes: one for each level of instructions.

use super::paths::{Paths, Place};
use super::{Wave, camera, find, finish, light, numbers, scatter};
use crate::lanes::entry;
use film::{Columns, SampleBuffer};

entry! {
    /// Numbers of the lattice; see [`numbers::lattice`].
    pub(super) fn lattice(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = numbers::lattice;
}
entry! {
    /// See [`find::find_meshes`].
    pub(super) fn find_meshes(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = find::find_meshes;
}
entry! {
    /// See [`find::find_flat`].
    pub(super) fn find_flat(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = find::find_flat;
}
entry! {
    /// See [`find::find_spheres`].
    pub(super) fn find_spheres(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = find::find_spheres;
}
entry! {
    /// See [`light::for_diffuse`].
    pub(super) fn choose_for_diffuse(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = light::for_diffuse;
}
entry! {
    /// See [`light::for_conductor`].
    pub(super) fn choose_for_conductor(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = light::for_conductor;
}
entry! {
    /// See [`light::for_any`].
    pub(super) fn choose_for_any(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = light::for_any;
}
entry! {
    /// See [`scatter::diffuse`].
    pub(super) fn scatter_diffuse(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::diffuse;
}
entry! {
    /// See [`scatter::conductor`].
    pub(super) fn scatter_conductor(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::conductor;
}
entry! {
    /// See [`scatter::dielectric`].
    pub(super) fn scatter_dielectric(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::dielectric;
}
entry! {
    /// See [`scatter::guide_diffuse`].
    pub(super) fn guide_diffuse(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::guide_diffuse;
}
entry! {
    /// See [`scatter::guide_conductor`].
    pub(super) fn guide_conductor(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::guide_conductor;
}
entry! {
    /// See [`scatter::guide_dielectric`].
    pub(super) fn guide_dielectric(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::guide_dielectric;
}
entry! {
    /// See [`scatter::aim_conductor`].
    pub(super) fn aim_conductor(wave: &Wave, paths: &mut Paths, places: &[Place]) -> () = scatter::aim_conductor;
}
entry! {
    /// See [`camera::rays`].
    pub(super) fn camera_rays(wave: &Wave, paths: &mut Paths) -> () = camera::rays;
}
entry! {
    /// See [`finish::add`].
    pub(super) fn finish(wave: &Wave, paths: &mut Paths, columns: &mut Columns, buffer: &mut SampleBuffer) -> u64 = finish::add;
}
