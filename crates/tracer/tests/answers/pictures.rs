//! Scenes with more pictures than memory.

use crate::common::*;
use film::{SampleRange, Unit};
use glam::{DAffine3, DVec3};
use scene::assets::MemorySource;
use scene::model::*;
use tracer::{PrepareSettings, StopFlag};

/// Pictures on walls, as a light, as a hole mask and as a sky.
fn gallery() -> (SceneDesc, MemorySource) {
    let mut desc = blank(80, 70);
    let mut assets = MemorySource::new();
    for i in 0..9u32 {
        let mut bytes = format!("PF {} 16 -1\n", 16 + i).into_bytes();
        for k in 0..16 * (16 + i) {
            for c in 0..3 {
                let value = ((k * (i + 3) + c * 7) % 13) as f32 / 13.0;
                bytes.extend(value.to_le_bytes());
            }
        }
        let path = format!("{i}.pfm");
        assets.insert(&path, bytes).unwrap();
        desc.images.push(ImageDesc {
            path,
            encoding: Encoding::Linear,
            missing: false,
            bytes: None,
        });
        desc.textures.push(Texture::Image {
            image: ImageId(i),
            map: UvMap::default(),
            wrap: (Wrap::Repeat, Wrap::Mirror),
            nearest: false,
            mip: (i % 2 == 0).then_some(MipFilter::Trilinear),
            invert: false,
            scale: [1.0; 4],
        });
    }
    for i in 0..6u32 {
        let (x, y) = (f64::from(i % 3) * 0.7 - 0.7, f64::from(i / 3) * 0.9 - 0.45);
        let turned = DAffine3::from_rotation_y(f64::from(i) * 0.2 - 0.5)
            * DAffine3::from_scale(DVec3::new(0.4, 0.4, 1.0));
        let wall = desc.place(
            Shape::Rectangle,
            at(x, y, -2.0) * turned,
            BsdfDesc::Diffuse {
                reflectance: ColorTex::Texture(TextureId(i)),
            },
        );
        if i == 4 {
            wall.alpha = Some(FloatTex::Texture(TextureId(6), Channel::R));
        }
        if i == 5 {
            wall.emission = Some(Emission {
                radiance: ColorTex::Texture(TextureId(7)),
                scale: 3.0,
                two_sided: true,
            });
        }
    }
    desc.lights.push(Light::Environment {
        transform: DAffine3::IDENTITY,
        radiance: [1.0; 3],
        image: Some((ImageId(8), SphereMapping::LatLong)),
        hidden: false,
        illuminance: None,
        portal: None,
    });
    (desc, assets)
}

/// The sums of all tiles, each rendered by a thread of its own.
fn sums(desc: &SceneDesc, assets: &MemorySource, picture_bytes: u64) -> Vec<Vec<u8>> {
    let settings = PrepareSettings {
        seed: 3,
        frame: 0,
        clamp_indirect: None,
        threads: 2,
        picture_bytes,
    };
    let scene = tracer::prepare(desc, assets, &settings, &StopFlag::default()).unwrap();
    let one = |tile| {
        let unit = Unit {
            frame: 0,
            tile,
            samples: SampleRange { begin: 0, end: 4 },
        };
        let (buffer, counters) = tracer::render_unit(&scene, &unit, &StopFlag::default()).unwrap();
        assert_eq!(buffer.rejected_count(), 0);
        film::codec::encode_unit(unit, &buffer, &counters, film::ENGINE_VERSION)
    };
    std::thread::scope(|scope| {
        let one = &one;
        let threads: Vec<_> = (0..scene.grid().count())
            .map(|tile| scope.spawn(move || one(tile)))
            .collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    })
}

/// The budget decides what is in memory, never what is rendered.
#[test]
fn a_tight_budget_changes_no_bit() {
    let (desc, assets) = gallery();
    let plenty = sums(&desc, &assets, u64::MAX);
    assert!(plenty.len() > 2);
    for budget in [0, 4000, 9000] {
        assert!(sums(&desc, &assets, budget) == plenty, "{budget} bytes");
    }
}
