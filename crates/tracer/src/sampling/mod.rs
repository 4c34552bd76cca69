//! Warps from uniform numbers in [0, 1) to the distributions that the tracer samples, in threes:
//! `warp(u)` gives a point, `warp_pdf(point)` its density in the measure that the function names,
//! `warp_inverse(point)` the uniform numbers again (tests, and sampling that is driven from both
//! ends). Every warp is continuous where it can be, so that well spread points stay well spread.

mod alias;
mod disk;
pub(crate) mod lanes;
mod linear;
mod piecewise;
mod sphere;
mod triangle;

pub use alias::{AliasSample, AliasTable};
pub use disk::{
    RegularPolygon, uniform_disk_concentric, uniform_disk_concentric_inverse, uniform_disk_pdf,
};
pub use linear::{linear, linear_inverse, linear_pdf, tent, tent_inverse, tent_pdf};
pub use piecewise::{Piecewise1d, Piecewise2d, PiecewiseSample};
pub use sphere::{
    cosine_hemisphere, cosine_hemisphere_inverse, cosine_hemisphere_pdf, cosine_hemisphere_polar,
    power_cosine, power_cosine_inverse, power_cosine_pdf, uniform_cone, uniform_cone_inverse,
    uniform_cone_pdf, uniform_hemisphere, uniform_hemisphere_inverse, uniform_hemisphere_pdf,
    uniform_sphere, uniform_sphere_inverse, uniform_sphere_pdf,
};
pub use triangle::{uniform_triangle, uniform_triangle_inverse};

#[cfg(test)]
mod tests;
