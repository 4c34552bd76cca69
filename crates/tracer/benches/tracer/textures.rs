//! Looking up textures.

use crate::{BATCH, Numbers};
use ::scene::model::{MipFilter, Texture, UvMap, Wrap};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::Vec2;
use tracer::texture::{Footprint, Point, Textures, image::Image};

#[derive(Clone, Copy, Debug)]
enum Kind {
    Nearest,
    Bilinear,
    Trilinear,
    Ellipse,
}

fn textures(kind: Kind) -> Textures {
    const EDGE: u32 = 1024;
    let mut pfm = format!("PF {EDGE} {EDGE} -1\n").into_bytes();
    let mut numbers = Numbers(9);
    for _ in 0..EDGE * EDGE * 3 {
        pfm.extend(numbers.one().to_le_bytes());
    }
    let image = Image::decode("a.pfm", &pfm, ::scene::model::Encoding::Linear).expect("a picture");
    let texture = Texture::Image {
        image: ::scene::model::ImageId(0),
        map: UvMap::default(),
        wrap: (Wrap::Repeat, Wrap::Repeat),
        nearest: matches!(kind, Kind::Nearest),
        mip: match kind {
            Kind::Trilinear => Some(MipFilter::Trilinear),
            Kind::Ellipse => Some(MipFilter::Ewa {
                max_anisotropy: 8.0,
            }),
            _ => None,
        },
        invert: false,
        scale: [1.0; 4],
    };
    Textures::new(vec![texture], vec![image])
}

#[divan::bench(args = [Kind::Nearest, Kind::Bilinear, Kind::Trilinear, Kind::Ellipse])]
fn lookup(bencher: Bencher, kind: &Kind) {
    let textures = textures(*kind);
    let mut numbers = Numbers(6);
    let points: Vec<Point> = (0..BATCH)
        .map(|_| Point {
            uv: [numbers.two(); 2],
            footprint: Footprint {
                duv: [Vec2::new(0.004, 0.0), Vec2::new(0.001, 0.002)],
                ..Footprint::default()
            },
            ..Point::NONE
        })
        .collect();
    bencher.counter(ItemsCount::new(BATCH)).bench_local(|| {
        let values = points.iter().map(|at| textures.eval(0, black_box(at)));
        values.map(|v| v[0]).sum::<f32>()
    });
}
