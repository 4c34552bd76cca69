//! How fast errors fall with the number of samples: like N^-1/2 for independent numbers, faster for
//! scrambled Sobol points, much faster where the picture is smooth.

use crate::common::*;
use glam::DAffine3;
use scene::assets::MemorySource;
use scene::model::*;

/// Slope of log RMSE over log N, against a picture of many samples with another seed.
fn slope(
    desc: &SceneDesc,
    assets: &MemorySource,
    sampler: SamplerKind,
    counts: &[u32],
    reference: &Picture,
) -> f64 {
    let mut desc = desc.clone();
    desc.sampler = sampler;
    let points: Vec<(f64, f64)> = counts
        .iter()
        .map(|&n| {
            let picture = Picture::of(&compile(&desc, assets, 3, 1), n);
            let square: f64 = picture
                .rgb
                .iter()
                .zip(&reference.rgb)
                .map(|(a, b)| (a[1] - b[1]) * (a[1] - b[1]))
                .sum();
            (
                f64::from(n).ln(),
                0.5 * (square / picture.rgb.len() as f64).ln(),
            )
        })
        .collect();
    let n = points.len() as f64;
    let (mx, my) = (
        points.iter().map(|p| p.0).sum::<f64>() / n,
        points.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let xy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let xx: f64 = points.iter().map(|p| (p.0 - mx) * (p.0 - mx)).sum();
    xy / xx
}

fn slopes(what: &str, desc: &SceneDesc, assets: &MemorySource, reference_spp: u32) -> [f64; 3] {
    let reference = Picture::of(&compile(desc, assets, 99, 1), reference_spp);
    let all = [
        SamplerKind::Independent,
        SamplerKind::Stratified,
        SamplerKind::OwenSobol,
    ]
    .map(|sampler| slope(desc, assets, sampler, &[4, 16, 64, 256], &reference));
    println!(
        "{what}: independent {:.2}, stratified {:.2}, owen-sobol {:.2}",
        all[0], all[1], all[2]
    );
    assert!(
        (all[0] + 0.5).abs() < 0.08,
        "{what}: independent numbers: {:.3}",
        all[0]
    );
    all
}

/// A plane under a lamp: two numbers for the pixel, two for the light, no edge anywhere.
#[test]
fn on_a_smooth_scene() {
    let mut desc = blank(16, 16);
    desc.camera.transform = Motion::fixed(look([0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]));
    desc.integrator = Integrator::Direct { max_depth: 1 };
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(0.8),
    );
    desc.place(
        Shape::Rectangle,
        horizontal([0.3, 1.5, 0.0], -0.5, 0.5),
        diffuse(0.0),
    )
    .emission = shining(3.0);
    let [_, stratified, sobol] = slopes("smooth", &desc, &MemorySource::new(), 8192);
    assert!(sobol < -0.75, "owen-sobol: {sobol:.3}");
    assert!(stratified < -0.5, "stratified: {stratified:.3}");
}

/// A zone plate (cos r^2, finer than the pixels at its rim) as a shining picture.
#[test]
fn on_a_zone_plate() {
    let size = 512;
    let mut plate = image::GrayImage::new(size, size);
    for (x, y, pixel) in plate.enumerate_pixels_mut() {
        let (u, v) = (
            f64::from(x) / f64::from(size),
            f64::from(y) / f64::from(size),
        );
        *pixel = image::Luma([(127.5 * (1.0 + (300.0 * (u * u + v * v)).cos())) as u8]);
    }
    let mut png = std::io::Cursor::new(vec![]);
    plate.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let assets = MemorySource::new()
        .with("plate.png", png.into_inner())
        .unwrap();
    let mut desc = blank(48, 48);
    desc.film.filter = Filter::Gaussian {
        radius: (1.5, 1.5),
        sigma: 0.5,
    };
    desc.images.push(ImageDesc {
        path: "plate.png".into(),
        encoding: Encoding::Linear,
        missing: false,
        bytes: None,
    });
    desc.textures.push(Texture::Image {
        image: ImageId(0),
        map: UvMap::default(),
        wrap: (Wrap::Clamp, Wrap::Clamp),
        nearest: false,
        mip: None,
        invert: false,
        scale: [1.0; 4],
    });
    let plane = desc.place(Shape::Rectangle, at(0.0, 0.0, -1.0), diffuse(0.0));
    plane.emission = Some(Emission {
        radiance: ColorTex::Texture(TextureId(0)),
        scale: 1.0,
        two_sided: false,
    });
    let [_, _, sobol] = slopes("zone plate", &desc, &assets, 4096);
    assert!(sobol < -0.7, "owen-sobol: {sobol:.3}");
}

/// A fine checkerboard up to the horizon: edges everywhere, yet faster than N^-1/2.
#[test]
fn on_a_checkerboard() {
    let mut desc = blank(32, 32);
    desc.camera.projection = perspective(50.0, None);
    desc.camera.transform = Motion::fixed(look([0.0, 1.0, 0.0], [0.2, 0.7, -1.0], [0.0, 1.0, 0.0]));
    desc.textures.push(Texture::Checkerboard {
        map: UvMap::Planar {
            matrix: DAffine3::from_rotation_x(std::f64::consts::FRAC_PI_2),
        },
        even: grey(0.9),
        odd: grey(0.05),
    });
    desc.lights.push(sky(1.0));
    let plane = desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 1000.0, 1000.0),
        diffuse(0.0),
    );
    plane.emission = Some(Emission {
        radiance: ColorTex::Texture(TextureId(0)),
        scale: 1.0,
        two_sided: false,
    });
    let [_, _, sobol] = slopes("checkerboard", &desc, &MemorySource::new(), 4096);
    assert!(sobol < -0.6, "owen-sobol: {sobol:.3}");
}
