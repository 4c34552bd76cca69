//! Textures against closed forms.

use super::image::Image;
use super::*;
use crate::light::octahedral;
use glam::{DAffine3, DVec2};
use scene::assets::{AssetSource, MemorySource};
use scene::model::{Encoding, ImageId, MipFilter, NoisePattern, TextureId, UvMap, Wrap};
use scene::noise;

fn at(u: f32, v: f32) -> Point {
    Point {
        uv: [Vec2::new(u, v); 2],
        ..Point::default()
    }
}

fn place(x: f64, y: f64, z: f64) -> Point {
    Point {
        p: Vec3::new(x as f32, y as f32, z as f32),
        ..Point::default()
    }
}

fn pfm(width: usize, height: usize, rgb: impl Fn(usize, usize) -> [f32; 3]) -> Vec<u8> {
    let mut bytes = format!("PF {width} {height} -1\n").into_bytes();
    for y in (0..height).rev() {
        for x in 0..width {
            for c in rgb(x, y) {
                bytes.extend(c.to_le_bytes());
            }
        }
    }
    bytes
}

fn picture(width: usize, height: usize, rgb: impl Fn(usize, usize) -> [f32; 3]) -> Image {
    Image::decode("a.pfm", &pfm(width, height, rgb), Encoding::Auto).unwrap()
}

fn image_texture(mip: Option<MipFilter>, wrap: Wrap) -> Texture {
    Texture::Image {
        image: ImageId(0),
        map: UvMap::default(),
        wrap: (wrap, wrap),
        nearest: false,
        mip,
        invert: false,
        scale: [1.0; 4],
    }
}

fn one(texture: Texture) -> Textures {
    Textures::new(vec![texture], vec![])
}

const RED: ColorTex = ColorTex::Const([1.0, 0.0, 0.0]);
const BLUE: ColorTex = ColorTex::Const([0.0, 0.0, 1.0]);

#[test]
fn cubes_alternate_along_all_axes() {
    let textures = one(Texture::Checkerboard3d {
        matrix: DAffine3::from_scale(glam::DVec3::splat(2.0)),
        even: RED,
        odd: BLUE,
    });
    for x in -3i32..3 {
        for y in -3i32..3 {
            for z in -3i32..3 {
                let center = |i: i32| (f64::from(i) + 0.5) / 2.0;
                let got = textures.eval(0, &place(center(x), center(y), center(z)))[0];
                assert_eq!(
                    got,
                    f32::from(u8::from((x + y + z) % 2 == 0)),
                    "{x} {y} {z}"
                );
            }
        }
    }
}

/// Where mappings put the axes: pbrt's conventions.
#[test]
fn directions_map_to_angles() {
    let bilerp = |map| {
        // s as red, t as green.
        one(Texture::Bilerp {
            map,
            corners: [[0.0; 3], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
        })
    };
    let check = |map: &UvMap, p: [f64; 3], s: f32, t: f32| {
        let [got_s, got_t, ..] = bilerp(map.clone()).eval(0, &place(p[0], p[1], p[2]));
        assert!(
            (got_s - s).abs() < 1e-6 && (got_t - t).abs() < 1e-6,
            "{map:?} {p:?}: {got_s} {got_t}, expected {s} {t}"
        );
    };
    let matrix = DAffine3::IDENTITY;
    let sphere = UvMap::Spherical { matrix };
    check(&sphere, [0.0, 0.0, 2.0], 0.0, 0.0);
    check(&sphere, [0.0, 0.0, -2.0], 1.0, 0.0);
    check(&sphere, [3.0, 0.0, 0.0], 0.5, 0.0);
    check(&sphere, [0.0, 3.0, 0.0], 0.5, 0.25);
    check(&sphere, [-1.0, 0.0, 1.0], 0.25, 0.5);
    check(&sphere, [0.0, -1.0, 0.0], 0.5, 0.75);
    check(&sphere, [0.0, 0.0, 0.0], 0.0, 0.0);
    let tube = UvMap::Cylindrical { matrix };
    check(&tube, [2.0, 0.0, 0.3], 0.5, 0.3);
    check(&tube, [0.0, 2.0, 0.4], 0.75, 0.4);
    check(&tube, [0.0, -2.0, 0.4], 0.25, 0.4);
    let moved = UvMap::Spherical {
        matrix: DAffine3::from_translation(glam::DVec3::NEG_Z),
    };
    check(&moved, [0.0, 5.0, 1.0], 0.5, 0.25);
}

#[test]
fn noise_patterns_follow_their_formulas() {
    let matrix = DAffine3::from_scale(glam::DVec3::splat(0.5));
    let p = glam::DVec3::new(1.25, -0.75, 3.5);
    let value = |pattern| one(Texture::Noise { matrix, pattern }).eval(0, &place(p.x, p.y, p.z));
    let q = p * 0.5;
    let roughness = 0.5;
    assert_eq!(
        value(NoisePattern::Fbm {
            octaves: 3,
            roughness
        })[0],
        noise::fbm(q, 0.5, 3) as f32
    );
    let wrinkled = value(NoisePattern::Wrinkled {
        octaves: 3,
        roughness,
    });
    assert_eq!(wrinkled, [wrinkled[0], wrinkled[0], wrinkled[0], 1.0]);
    assert_eq!(wrinkled[0], noise::turbulence(q, 0.5, 3) as f32);
    let windy = noise::fbm(q * 0.1, 0.5, 3).abs() * noise::fbm(q, 0.5, 6);
    assert_eq!(value(NoisePattern::Windy)[0], windy as f32);
    // Undisturbed veins depend on y alone; where the sine is -1 the spline is at its first colour.
    let marble = |y: f64| {
        let pattern = NoisePattern::Marble {
            octaves: 8,
            roughness,
            scale: 1.0,
            variation: 0.0,
        };
        let textures = one(Texture::Noise {
            matrix: DAffine3::IDENTITY,
            pattern,
        });
        [0.0, 7.5].map(|x| textures.eval(0, &place(x, y, -x)))
    };
    let [a, b] = marble(-std::f64::consts::FRAC_PI_2);
    assert_eq!(a, b);
    assert!(
        (a[0] - 0.87).abs() < 1e-4 && (a[2] - 0.9).abs() < 1e-4,
        "{a:?}"
    );
}

/// Three in eight of the cells have a dot (noise is often exactly 0 in the middle of a cell); a dot covers pi 0.35^2 of its cell and stays inside of it.
#[test]
fn dots_cover_the_share_that_they_should() {
    let textures = one(Texture::Dots {
        map: UvMap::default(),
        inside: RED,
        outside: BLUE,
    });
    let (cells, steps) = (40, 20);
    let (mut with_dot, mut covered) = (0, 0);
    for i in 0..cells {
        for j in 0..cells {
            let mut here = 0;
            for k in 0..steps * steps {
                let within = DVec2::new(f64::from(k % steps) + 0.5, f64::from(k / steps) + 0.5)
                    / f64::from(steps);
                let s = f64::from(i) - 0.5 + within.x;
                let t = f64::from(j) - 0.5 + within.y;
                let on = textures.eval(0, &at(s as f32, t as f32))[0] == 1.0;
                here += i32::from(on);
            }
            with_dot += i32::from(here > 0);
            covered += here;
        }
    }
    let share = f64::from(with_dot) / f64::from(cells * cells);
    assert!((0.33..0.42).contains(&share), "{share}");
    let area = f64::from(covered) / f64::from(with_dot * steps * steps);
    assert!((area - 0.3848).abs() < 0.01, "{area}");
}

#[test]
fn a_direction_mixes_by_its_cosine() {
    let direction = glam::DVec3::new(0.0, 0.6, 0.8);
    let textures = one(Texture::DirectionMix {
        a: RED,
        b: BLUE,
        direction,
    });
    for (n, facing) in [
        (Vec3::Y, 0.6),
        (Vec3::NEG_Y, 0.6),
        (Vec3::X, 0.0),
        (Vec3::new(0.0, 0.6, 0.8), 1.0),
    ] {
        let point = Point {
            n,
            ..Point::default()
        };
        let [r, _, b, a] = textures.eval(0, &point);
        assert!(
            (r - facing).abs() < 1e-6 && (b - (1.0 - facing)).abs() < 1e-6 && a == 1.0,
            "{n}: {r} {b}"
        );
    }
}

#[test]
fn greys_and_means() {
    let image = picture(4, 2, |x, y| [x as f32, y as f32, 3.0]);
    let textures = Textures::new(
        vec![
            image_texture(None, Wrap::Clamp),
            Texture::Grey {
                value: FloatTex::Texture(TextureId(0), Channel::B),
            },
            Texture::UnitMean {
                texture: TextureId(0),
            },
        ],
        vec![image],
    );
    assert_eq!(textures.eval(1, &at(0.3, 0.3)), [3.0, 3.0, 3.0, 1.0]);
    let mean = 0.2126 * 1.5 + 0.7152 * 0.5 + 0.0722 * 3.0;
    let [_, _, b, _] = textures.eval(2, &at(0.3, 0.3));
    assert!((b - 3.0 / mean).abs() < 1e-6, "{b}");
    // A picture without transparency has nothing to say in alpha.
    let number =
        |channel| textures.float(&FloatTex::Texture(TextureId(0), channel), &at(0.125, 0.75));
    assert_eq!(number(Channel::AlphaOrMean), number(Channel::Mean));
}

/// Beyond an edge of an octahedral picture lies what a direction beyond it sees.
#[test]
fn octahedral_edges_join() {
    let n = 16usize;
    let color = |x: usize, y: usize| {
        let uv = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / n as f32;
        (octahedral::to_sphere(uv) * 0.5 + 0.5).to_array()
    };
    let image = picture(n, n, color);
    let wrap = (Wrap::Octahedral, Wrap::Octahedral);
    for i in 0..200 {
        // Just inside and just outside of each edge: the same direction, nearly.
        let t = (i as f32 + 0.5) / 200.0;
        for (inside, outside) in [
            (Vec2::new(0.001, t), Vec2::new(-0.001, t)),
            (Vec2::new(0.999, t), Vec2::new(1.001, t)),
            (Vec2::new(t, 0.001), Vec2::new(t, -0.001)),
            (Vec2::new(t, 0.999), Vec2::new(t, 1.001)),
        ] {
            let (a, b) = (
                image.lookup(inside, wrap, false),
                image.lookup(outside, wrap, false),
            );
            for c in 0..3 {
                assert!(
                    (a[c] - b[c]).abs() < 0.02,
                    "{inside} {outside}: {a:?} {b:?}"
                );
            }
        }
    }
}

fn footprint(du: f32, dv: f32) -> Footprint {
    Footprint {
        dp: [Vec3::ZERO; 2],
        duv: [Vec2::new(du, 0.0), Vec2::new(0.0, dv)],
    }
}

const FILTERS: [MipFilter; 2] = [
    MipFilter::Trilinear,
    MipFilter::Ewa {
        max_anisotropy: 8.0,
    },
];

/// A pyramid keeps the mean, whatever the size; a footprint over everything sees it.
#[test]
fn wide_footprints_see_the_mean() {
    for (w, h) in [(16, 16), (7, 5), (1, 9), (33, 2), (1, 1)] {
        let value = |x: usize, y: usize| ((x * 7 + y * 13) % 11) as f32 / 10.0;
        let mean = (0..w * h).map(|i| value(i % w, i / w)).sum::<f32>() / (w * h) as f32;
        for filter in FILTERS {
            let textures = Textures::new(
                vec![image_texture(Some(filter), Wrap::Repeat)],
                vec![picture(w, h, |x, y| [value(x, y); 3]).with_pyramid()],
            );
            let mut point = at(0.37, 0.61);
            point.footprint = footprint(2.0, 2.0);
            // An ellipse of a few periods is not quite even over them.
            let bound = match filter {
                MipFilter::Trilinear => 1e-5,
                MipFilter::Ewa { .. } => 2e-3,
            };
            let got = textures.eval(0, &point)[0];
            assert!(
                (got - mean).abs() < bound,
                "{w} x {h} {filter:?}: {got}, {mean}"
            );
        }
    }
}

/// Without a footprint, or with one below a pixel, a picture is read as it is.
#[test]
fn narrow_footprints_change_little() {
    let image = picture(32, 32, |x, y| [(x as f32 / 31.0), (y as f32 / 31.0), 0.5]).with_pyramid();
    for filter in FILTERS {
        let textures = Textures::new(
            vec![
                image_texture(None, Wrap::Clamp),
                image_texture(Some(filter), Wrap::Clamp),
            ],
            vec![image.clone()],
        );
        for i in 0..50 {
            let mut point = at(0.1 + 0.016 * i as f32, 0.9 - 0.013 * i as f32);
            let plain = textures.eval(0, &point);
            assert_eq!(textures.eval(1, &point), plain);
            point.footprint = footprint(0.002, 0.002);
            let filtered = textures.eval(1, &point);
            for c in 0..3 {
                // A Gaussian over a few texels does not quite follow a ramp.
                assert!((filtered[c] - plain[c]).abs() < 0.012, "{filter:?} {i}");
            }
        }
    }
}

/// On a linear ramp every symmetric filter gives the value in the middle; stripes across a long
/// ellipse average out, stripes along it stay.
#[test]
fn ellipses_are_anisotropic() {
    let n = 64;
    let ewa = MipFilter::Ewa {
        max_anisotropy: 16.0,
    };
    let ramp = picture(n, n, |x, _| [(x as f32 + 0.5) / n as f32; 3]).with_pyramid();
    let textures = Textures::new(vec![image_texture(Some(ewa), Wrap::Clamp)], vec![ramp]);
    for width in [0.01, 0.03, 0.08] {
        let mut point = at(0.5, 0.5);
        point.footprint = footprint(width, 0.5 * width);
        let got = textures.eval(0, &point)[0];
        assert!((got - 0.5).abs() < 0.01, "{width}: {got}");
    }
    let stripes = picture(n, n, |x, _| [f32::from(u8::from(x / 4 % 2 == 0)); 3]).with_pyramid();
    let textures = Textures::new(vec![image_texture(Some(ewa), Wrap::Repeat)], vec![stripes]);
    let value = |du: f32, dv: f32| {
        // The middle of a bright stripe.
        let mut point = at(2.0 / 64.0, 0.5);
        point.footprint = footprint(du, dv);
        textures.eval(0, &point)[0]
    };
    assert!(
        (value(0.2, 0.016) - 0.5).abs() < 0.1,
        "{}",
        value(0.2, 0.016)
    );
    assert!(value(0.016, 0.2) > 0.8, "{}", value(0.016, 0.2));
}

/// 8 and 16 bits keep their numbers of channels; the values are those of the transfer function.
#[test]
fn pixels_stay_as_small_as_they_are() {
    let encode = |picture: ::image::DynamicImage| {
        let mut out = std::io::Cursor::new(vec![]);
        picture
            .write_to(&mut out, ::image::ImageFormat::Png)
            .unwrap();
        out.into_inner()
    };
    use ::image::DynamicImage as D;
    let cases: [(D, usize); 8] = [
        (D::new_luma8(3, 2), 1),
        (D::new_luma_a8(3, 2), 2),
        (D::new_rgb8(3, 2), 3),
        (D::new_rgba8(3, 2), 4),
        (D::new_luma16(3, 2), 2),
        (D::new_luma_a16(3, 2), 4),
        (D::new_rgb16(3, 2), 6),
        (D::new_rgba16(3, 2), 8),
    ];
    for (picture, bytes) in cases {
        let has_alpha = picture.color().has_alpha();
        let image = Image::decode("x.png", &encode(picture), Encoding::Auto).unwrap();
        let held: usize = image.parts().iter().map(|p| p.1).sum();
        assert_eq!(held, 6 * bytes);
        let [r, _, _, a] = image.texel(2, 1);
        assert_eq!(r, 0.0);
        assert_eq!((a > 0.999, image.is_opaque()), (!has_alpha, !has_alpha));
    }
    let grey = D::ImageLuma8(::image::GrayImage::from_raw(2, 1, vec![128, 255]).unwrap());
    let image = Image::decode("x.png", &encode(grey.clone()), Encoding::Auto).unwrap();
    assert!((image.texel(0, 0)[1] - 0.215_860_5).abs() < 1e-6);
    assert_eq!(image.texel(1, 0)[2], 1.0);
    let linear = Image::decode("x.png", &encode(grey), Encoding::Linear).unwrap();
    assert_eq!(linear.texel(0, 0)[0], 128.0 / 255.0);
    assert!((linear.mean_luminance() - (128.0 / 255.0 + 1.0) / 2.0).abs() < 1e-6);
}

/// A KTX2 file of 9 x 7 pixels whose blocks are each of one colour, brighter to the right: header, one
/// level, data format descriptor (UASTC with alpha), blocks of mode 8.
fn ktx2() -> Vec<u8> {
    const BLOCKS: [u8; 6] = [0, 1, 2, 0, 1, 2];
    let (descriptor, data) = (104u32, 160u32);
    let size = 16 * BLOCKS.len() as u32;
    let mut out = scene::picture::KTX2.to_vec();
    let mut words = |list: &[u32]| out.extend(list.iter().flat_map(|w| w.to_le_bytes()));
    words(&[0, 1, 9, 7, 0, 0, 1, 1, 0]); // format, type size, size, depth, layers, faces, levels, packing
    words(&[descriptor, 44, 0, 0, 0, 0, 0, 0]); // descriptor, no key-value data, no global data
    words(&[data, 0, size, 0, size, 0]); // the level: where, packed, unpacked
    words(&[
        44,
        0,
        2 | 40 << 16,
        166 | 1 << 8 | 1 << 16,
        3 | 3 << 8,
        16,
        0,
    ]);
    words(&[127 << 16 | 3 << 24, 0, 0, u32::MAX]);
    words(&[0, 0, 0]);
    for block in BLOCKS {
        let colour = u32::from_le_bytes([block * 80, 50, 77, 255]);
        out.extend((0x17 | (u128::from(colour) << 5)).to_le_bytes());
    }
    out
}

/// A picture with something in it, in every format that is read.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    use ::image::{DynamicImage, ImageFormat};
    let rgb8 =
        ::image::RgbImage::from_fn(9, 7, |x, y| ::image::Rgb([x as u8 * 25, y as u8 * 30, 77]));
    let rgba8 = ::image::RgbaImage::from_fn(9, 7, |x, y| {
        ::image::Rgba([x as u8 * 25, y as u8 * 30, 77, 200])
    });
    let float = DynamicImage::ImageRgb8(rgb8.clone()).into_rgb32f();
    let mut out = vec![];
    let mut add = |name, picture: DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(vec![]);
        picture.write_to(&mut bytes, format).unwrap();
        out.push((name, bytes.into_inner()));
    };
    add(
        "a.png",
        DynamicImage::ImageRgba8(rgba8.clone()),
        ImageFormat::Png,
    );
    let wide = DynamicImage::ImageRgb8(rgb8.clone()).into_rgb16();
    add("b.png", DynamicImage::ImageRgb16(wide), ImageFormat::Png);
    add(
        "a.jpg",
        DynamicImage::ImageRgb8(rgb8.clone()),
        ImageFormat::Jpeg,
    );
    add(
        "a.tga",
        DynamicImage::ImageRgba8(rgba8.clone()),
        ImageFormat::Tga,
    );
    add("a.webp", DynamicImage::ImageRgba8(rgba8), ImageFormat::WebP);
    add("a.bmp", DynamicImage::ImageRgb8(rgb8), ImageFormat::Bmp);
    add(
        "a.hdr",
        DynamicImage::ImageRgb32F(float.clone()),
        ImageFormat::Hdr,
    );
    add(
        "a.exr",
        DynamicImage::ImageRgb32F(float),
        ImageFormat::OpenExr,
    );
    out.push(("a.pfm", pfm(9, 7, |x, y| [x as f32, y as f32, 0.5])));
    out.push(("a.ktx2", ktx2()));
    out
}

#[test]
fn every_format_is_read() {
    for (name, bytes) in samples() {
        let image = Image::decode(name, &bytes, Encoding::Linear).unwrap();
        assert_eq!((image.width, image.height), (9, 7), "{name}");
        let (a, b) = (image.texel(1, 3)[0], image.texel(7, 3)[0]);
        assert!(a < b, "{name}: {a} {b}");
        if name == "a.ktx2" {
            let colour = [80.0 / 255.0, 50.0 / 255.0, 77.0 / 255.0, 1.0];
            assert_eq!(image.texel(7, 3), colour);
        }
        // The name does not matter where the content says what it is.
        if name != "a.tga" {
            assert!(
                Image::decode("x.tga", &bytes, Encoding::Linear).is_ok(),
                "{name}"
            );
        }
        let cut = Image::decode(name, &bytes[..bytes.len() / 2], Encoding::Linear);
        assert!(cut.is_err() || name == "a.jpg", "{name}: half of a file");
    }
    assert!(Image::decode("a.gif", b"GIF89a12", Encoding::Auto).is_err());
    assert!(Image::decode("a.png", b"", Encoding::Auto).is_err());
}

mod damage {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(600))]
        /// Damaged pictures are refused or read, and nothing else happens.
        #[test]
        fn never_panics(
            which in 0usize..10,
            edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..4), 1..6),
        ) {
            let (name, mut bytes) = samples().swap_remove(which);
            for (at, byte, what) in edits {
                // Half of the damage goes to the header.
                let end = if what & 1 == 0 { bytes.len().min(40) } else { bytes.len() };
                if end == 0 {
                    break;
                }
                let at = at.index(end);
                match what {
                    0 | 1 => bytes[at] = byte,
                    2 => bytes.truncate(at),
                    _ => bytes.insert(at, byte),
                }
            }
            if let Ok(image) = Image::decode(name, &bytes, Encoding::Auto) {
                let [w, h] = [image.width as usize, image.height as usize];
                prop_assert!(w > 0 && h > 0);
                let corner = image.texel(w - 1, h - 1);
                prop_assert!(corner.iter().all(|c| c.is_finite()));
            }
        }
    }
}

/// Textures 0, 1, ... that show pictures of files, under a budget.
fn loaded(files: &[(&str, Encoding, bool)], assets: &MemorySource, budget_bytes: u64) -> Textures {
    let image = |(path, encoding, _): &(&str, Encoding, bool)| scene::model::ImageDesc {
        bytes: None,
        path: (*path).into(),
        encoding: *encoding,
        missing: false,
    };
    let node = |(i, (_, _, filtered)): (usize, &(&str, Encoding, bool))| Texture::Image {
        image: ImageId(i as u32),
        map: UvMap::default(),
        wrap: (Wrap::Repeat, Wrap::Repeat),
        nearest: true,
        mip: filtered.then_some(MipFilter::Trilinear),
        invert: false,
        scale: [1.0; 4],
    };
    Textures::load(
        files.iter().enumerate().map(node).collect(),
        &files.iter().map(image).collect::<Vec<_>>(),
        &vec![false; files.len()],
        &[],
        budget_bytes,
        assets,
        &crate::StopFlag::default(),
    )
    .unwrap()
}

/// Pictures with the same bytes are decoded once and kept once, whatever they are called.
#[test]
fn equal_pictures_share_their_pixels() {
    let (_, png) = samples().swap_remove(0);
    let assets = MemorySource::new()
        .with("a.png", &png)
        .unwrap()
        .with("copy/b.png", &png)
        .unwrap();
    let files = [
        ("a.png", Encoding::Auto, false),
        ("copy/b.png", Encoding::Auto, false),
        ("a.png", Encoding::Linear, false),
    ];
    let textures = loaded(&files, &assets, u64::MAX);
    let [a, b, linear] = [0, 1, 2].map(|i| textures.eval(i, &at(0.6, 0.5)));
    assert!(a[0] < linear[0]);
    assert_eq!(a, b);
    assert_eq!(textures.memory_bytes(), 9 * 7 * 4);
    let with_pyramid = loaded(&[("copy/b.png", Encoding::Auto, true)], &assets, u64::MAX);
    assert!(with_pyramid.memory_bytes() > 9 * 7 * 4);
}

/// Files with 32 x 32 pixels each of its own grey.
fn greys(count: usize) -> (MemorySource, Vec<String>) {
    let mut assets = MemorySource::new();
    let mut names = vec![];
    for i in 0..count {
        let grey = (i as f32 + 1.0) / 16.0;
        let name = format!("{i}.pfm");
        assets.insert(&name, pfm(32, 32, |_, _| [grey; 3])).unwrap();
        names.push(name);
    }
    (assets, names)
}

/// What does not fit is dropped, used longest ago first, and comes back as it was.
#[test]
fn pictures_come_and_go_within_the_budget() {
    const ONE: usize = 32 * 32 * 12;
    let (assets, names) = greys(5);
    let files: Vec<_> = (names.iter().map(|n| (n.as_str(), Encoding::Auto, false))).collect();
    let on_file: usize = names.iter().map(|n| assets.read(n).unwrap().len()).sum();
    let plenty = loaded(&files, &assets, u64::MAX);
    assert_eq!(plenty.memory_bytes(), 5 * ONE, "files are let go of");
    let tight = loaded(&files, &assets, 2 * ONE as u64);
    let mut view = tight.view();
    for i in [0, 4, 4, 2, 0, 1, 3, 0, 2, 2, 4] {
        assert_eq!(view.eval(i, &at(0.4, 0.7)), plenty.eval(i, &at(0.4, 0.7)));
        assert_eq!(tight.memory_bytes(), on_file + 2 * ONE);
        view.refresh();
    }
    // 2 and 4 were used last.
    let before = tight.pool.dropped();
    let view = tight.view();
    view.eval(2, &at(0.0, 0.0));
    view.eval(4, &at(0.0, 0.0));
    assert_eq!(tight.pool.dropped(), before);
    view.eval(0, &at(0.0, 0.0));
    assert_eq!(tight.pool.dropped(), before + 1);
    // One that is larger than the whole budget is there all the same.
    let none = loaded(&files, &assets, 0);
    assert_eq!(none.eval(3, &at(0.4, 0.7))[0], 0.25);
}

/// A view that holds nothing lets the memory go: nothing else does.
#[test]
fn dropped_pictures_are_freed_when_views_refresh() {
    let (assets, names) = greys(3);
    let files: Vec<_> = (names.iter().map(|n| (n.as_str(), Encoding::Auto, false))).collect();
    let tight = loaded(&files, &assets, 0);
    let mut view = tight.view();
    view.eval(0, &at(0.0, 0.0));
    view.eval(1, &at(0.0, 0.0));
    let held = |view: &Textures| view.held.iter().filter(|h| h.get().is_some()).count();
    assert_eq!(held(&view), 2);
    view.refresh();
    assert_eq!(held(&view), 0);
    view.eval(2, &at(0.0, 0.0));
    view.refresh();
    let dropped = tight.pool.dropped();
    view.eval(2, &at(0.0, 0.0));
    view.refresh();
    assert_eq!(
        (tight.pool.dropped(), held(&view)),
        (dropped, 1),
        "nothing had to go"
    );
}

#[test]
fn threads_share_a_tight_budget() {
    let (assets, names) = greys(8);
    let files: Vec<_> = (names.iter().map(|n| (n.as_str(), Encoding::Auto, false))).collect();
    let tight = loaded(&files, &assets, 3 * 32 * 32 * 12);
    std::thread::scope(|scope| {
        for thread in 0..4usize {
            let tight = &tight;
            scope.spawn(move || {
                let mut view = tight.view();
                for step in 0..400usize {
                    let i = (step * (2 * thread + 1) + step / 7) % 8;
                    let grey = (i as f32 + 1.0) / 16.0;
                    assert_eq!(view.eval(i, &at(0.3, 0.3)), [grey, grey, grey, 1.0]);
                    view.refresh();
                }
            });
        }
    });
    assert!(tight.pool.dropped() > 100);
}

/// Coverage is looked up wherever rays are traced: its pictures stay, through whatever textures.
#[test]
fn pictures_of_coverage_stay() {
    let (assets, names) = greys(3);
    let images: Vec<_> = (names.iter())
        .map(|n| scene::model::ImageDesc {
            bytes: None,
            path: n.clone(),
            encoding: Encoding::Auto,
            missing: false,
        })
        .collect();
    let show = |i| match image_texture(None, Wrap::Repeat) {
        Texture::Image { map, wrap, .. } => Texture::Image {
            image: ImageId(i),
            map,
            wrap,
            nearest: true,
            mip: None,
            invert: false,
            scale: [1.0; 4],
        },
        other => other,
    };
    let nodes = vec![
        show(0),
        show(1),
        show(2),
        Texture::Mix {
            a: RED,
            b: ColorTex::Texture(TextureId(1)),
            amount: FloatTex::Const(0.5),
        },
        Texture::Threshold {
            value: FloatTex::Texture(TextureId(3), Channel::R),
            at: 0.1,
        },
    ];
    let coverage = [FloatTex::Texture(TextureId(4), Channel::R)];
    let textures = Textures::load(
        nodes,
        &images,
        &[true, false, false],
        &coverage,
        0,
        &assets,
        &crate::StopFlag::default(),
    )
    .unwrap();
    assert_eq!(textures.images[0].texel(0, 0)[0], 1.0 / 16.0);
    let dropped = textures.pool.dropped();
    textures.eval(4, &at(0.5, 0.5));
    textures.eval(0, &at(0.5, 0.5));
    textures.eval(2, &at(0.5, 0.5));
    let view = textures.view();
    view.eval(4, &at(0.5, 0.5));
    view.eval(0, &at(0.5, 0.5));
    assert_eq!(textures.pool.dropped(), dropped);
}

/// What does not decode is found before anything is rendered, whatever the budget.
#[test]
fn broken_pictures_are_found_under_any_budget() {
    let assets = MemorySource::new().with("a.png", b"no picture").unwrap();
    for budget_bytes in [0, u64::MAX] {
        let image = scene::model::ImageDesc {
            bytes: None,
            path: "a.png".into(),
            encoding: Encoding::Auto,
            missing: false,
        };
        let stop = crate::StopFlag::default();
        let found = Textures::load(
            vec![],
            &[image],
            &[false],
            &[],
            budget_bytes,
            &assets,
            &stop,
        );
        assert!(matches!(found, Err(crate::PrepareError::Decode { path, .. }) if path == "a.png"));
    }
}
