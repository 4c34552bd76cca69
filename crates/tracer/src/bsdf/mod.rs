//! Scattering at surfaces.
