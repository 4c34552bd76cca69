//! Mixed materials: the sum of their parts, exactly where all parts share the shading frame, by chance
//! elsewhere.

use crate::common::*;
use glam::DVec3;
use scene::model::*;
use testkit::{Moments, ttest};

/// A floor that fills the picture, seen from above under a white sky.
fn floor(material: impl FnOnce(&mut SceneDesc) -> BsdfDesc) -> SceneDesc {
    let mut desc = blank(12, 12);
    desc.sampler = SamplerKind::Independent;
    desc.camera.transform = Motion::fixed(look([0.0, 3.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0]));
    let material = material(&mut desc);
    desc.place(
        Shape::Rectangle,
        horizontal(DVec3::ZERO.to_array(), 4.0, 4.0),
        material,
    );
    desc.lights.push(sky(1.0));
    desc
}

fn mix(a: MaterialId, b: MaterialId, amount: f32) -> BsdfDesc {
    BsdfDesc::Mix {
        a,
        b,
        amount: FloatTex::Const(amount),
    }
}

/// Under an even sky every direction of a diffuse floor brings the same: without chance in the mix there
/// is no noise at all.
#[test]
fn diffuse_parts_add_up_without_noise() {
    let desc = floor(|desc| {
        let [a, b, c] = [0.1, 0.6, 0.9].map(|r| desc.material(diffuse(r)));
        let inner = mix(a, b, 0.25);
        let inner = desc.material(inner);
        let both = desc.material(BsdfDesc::TwoSided { inner });
        mix(both, c, 0.3)
    });
    let expected = 0.7 * (0.75 * 0.1 + 0.25 * 0.6) + 0.3 * 0.9;
    let picture = render(&desc, 4);
    for rgb in &picture.rgb {
        let error = rgb[1] / expected - 1.0;
        assert!(error.abs() < ROUNDING, "{} : {expected}", rgb[1]);
    }
}

/// Nothing is left of a part that has no share, whatever the amount says.
#[test]
fn amounts_beyond_their_range_are_all_or_nothing() {
    for (amount, expected) in [(-1.0, 0.2), (0.0, 0.2), (1.0, 0.8), (3.0, 0.8)] {
        let desc = floor(|desc| {
            let [a, b] = [0.2, 0.8].map(|r| desc.material(diffuse(r)));
            mix(a, b, amount)
        });
        for rgb in &render(&desc, 2).rgb {
            let error = rgb[1] / expected - 1.0;
            assert!(error.abs() < ROUNDING, "{amount}: {}", rgb[1]);
        }
    }
}

/// Five materials are more than are added up; one of them is taken at a time.
#[test]
fn many_parts_are_chosen_from() {
    let desc = floor(|desc| {
        let parts = [0.9, 0.1, 0.5, 0.7, 0.3].map(|r| desc.material(diffuse(r)));
        let mut all = parts[0];
        for (n, part) in parts.iter().enumerate().skip(1) {
            // The n + 1st of equal shares.
            let next = mix(all, *part, 1.0 / (n as f32 + 1.0));
            all = desc.material(next);
        }
        BsdfDesc::TwoSided { inner: all }
    });
    let picture = render(&desc, 256);
    check("five parts", &picture.moments(), 0.5);
    let noise = picture.rgb.iter().map(|p| p[1]).collect::<Moments>();
    assert!(noise.error() > 0.0);
}

/// Half of the floor is not there: what lies below is seen through it.
#[test]
fn a_share_may_be_nothing() {
    let mut desc = floor(|desc| {
        let a = desc.material(diffuse(0.8));
        let b = desc.material(BsdfDesc::Interface);
        mix(a, b, 0.25)
    });
    let below = horizontal([0.0, -1.0, 0.0], 40.0, 40.0);
    desc.place(Shape::Rectangle, below, diffuse(0.0));
    // From below no light comes back: the floor's share is lit by the sky alone.
    check("cut out", &render(&desc, 1024).moments(), 0.75 * 0.8);
}

/// Mirrors, metal and paint together: as bright as the same surfaces one by one, by their shares. A lamp
/// makes it matter that light is sampled for all of them.
#[test]
fn parts_bring_what_they_bring_alone() {
    let parts = || {
        let metal = BsdfDesc::Conductor {
            fresnel: ConductorFresnel::Reflectance(grey(0.8)),
            roughness: Roughness {
                u: FloatTex::Const(0.3),
                v: FloatTex::Const(0.3),
                ..smooth()
            },
        };
        let mirror = BsdfDesc::Mirror {
            reflectance: grey(0.9),
        };
        [diffuse(0.5), metal, mirror]
    };
    let lit = |mut desc: SceneDesc| {
        let lamp = spanned([1.5, 2.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]);
        let lamp = desc.place(Shape::Rectangle, lamp, diffuse(0.0));
        lamp.emission = Some(Emission {
            two_sided: true,
            ..shining(5.0).unwrap()
        });
        render(&desc, 512).rgb
    };
    let [a, b, c] = parts().map(|part| lit(floor(|_| part)));
    let mixed = lit(floor(|desc| {
        let [a, b, c] = parts().map(|part| desc.material(part));
        let inner = mix(a, b, 0.4);
        let inner = desc.material(inner);
        mix(inner, c, 0.3)
    }));
    let differences: Moments = (0..mixed.len())
        .map(|i| mixed[i][1] - 0.7 * (0.6 * a[i][1] + 0.4 * b[i][1]) - 0.3 * c[i][1])
        .collect();
    assert!(differences.error() < 2e-3, "{}", differences.error());
    ttest::assert_mean("mixed beside its parts", &differences, 0.0, LEVEL);
}

/// The basic ray tracer, which has no place for mixes, takes the larger part.
#[test]
fn the_larger_part_stands_for_all_in_the_basic_tracer() {
    for (amount, expected) in [(0.7, 0.9), (0.3, 0.0)] {
        let mut desc = floor(|desc| {
            let a = desc.material(diffuse(0.5));
            let b = desc.material(BsdfDesc::Mirror {
                reflectance: grey(0.9),
            });
            mix(a, b, amount)
        });
        desc.integrator = Integrator::Whitted { max_depth: 4 };
        for rgb in &render(&desc, 1).rgb {
            assert!((rgb[1] - expected).abs() < ROUNDING, "{amount}: {}", rgb[1]);
        }
    }
}
