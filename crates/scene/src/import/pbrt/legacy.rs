//! Words of pbrt-v3 that pbrt-v4 no longer has, and what to write instead.

/// What a v3 word is called now.
fn table(what: &str) -> &'static [(&'static str, &'static str)] {
    match what {
        "material" => &[
            ("matte", "diffuse"),
            ("plastic", "coateddiffuse"),
            ("uber", "coateddiffuse"),
            ("substrate", "coateddiffuse"),
            ("disney", "coateddiffuse"),
            ("metal", "conductor"),
            ("mirror", "conductor"),
            ("glass", "dielectric"),
            ("translucent", "diffusetransmission"),
            ("fourier", "measured"),
            ("kdsubsurface", "subsurface"),
        ],
        "film" => &[("image", "rgb")],
        "sampler" => &[
            ("random", "independent"),
            ("02sequence", "paddedsobol"),
            ("lowdiscrepancy", "paddedsobol"),
            ("maxmindist", "pmj02bn"),
        ],
        "integrator" => &[
            ("directlighting", "path"),
            ("whitted", "path"),
            ("ao", "ambientocclusion"),
        ],
        "camera" => &[("environment", "spherical")],
        "shape" => &[
            ("heightfield", "trianglemesh"),
            ("heightfield2", "trianglemesh"),
            ("nurbs", "trianglemesh"),
            ("cone", "trianglemesh"),
            ("paraboloid", "trianglemesh"),
            ("hyperboloid", "trianglemesh"),
        ],
        "light" => &[("infinite image", "infinite"), ("exinfinite", "infinite")],
        _ => &[],
    }
}

/// The end of a message about an unknown type of something.
pub(super) fn hint(what: &str, name: &str, known: &[&str]) -> String {
    match table(what).iter().find(|(old, _)| *old == name) {
        Some((_, new)) => format!(": it is of pbrt-v3; pbrt-v4 has {new:?}"),
        None => crate::suggest::did_you_mean(name, known.iter().copied()),
    }
}

/// Directives that are gone.
pub(super) fn directive(word: &str) -> Option<&'static str> {
    Some(match word {
        "WorldEnd" => "the world ends with the file in pbrt-v4: leave it out",
        "SurfaceIntegrator" | "VolumeIntegrator" | "Renderer" => "pbrt-v4 has \"Integrator\"",
        "Volume" => "pbrt-v4 has \"MakeNamedMedium\"",
        "MakeNamedVolume" => "pbrt-v4 has \"MakeNamedMedium\"",
        "SearchPath" => "pbrt-v4 has no search path: names are relative to the main file",
        "PixelBounds" => "pbrt-v4 has \"pixelbounds\" on Film",
        _ => return None,
    })
}
