//! Warps against their inverses and densities.
