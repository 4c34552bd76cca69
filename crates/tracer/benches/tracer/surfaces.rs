//! Values and samples of every scattering function.

use crate::{BATCH, Numbers};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::{Vec2, Vec3};
use std::sync::{Arc, LazyLock};
use tracer::bsdf::*;
use tracer::math::Rgb;

const KINDS: [&str; 16] = [
    "diffuse",
    "oren_nayar",
    "phong",
    "lafortune",
    "mirror",
    "glass",
    "rough_glass",
    "pane",
    "metal",
    "coated_diffuse",
    "coated_metal",
    "leaf",
    "plastic",
    "lacquered_metal",
    "velvet",
    "hair",
];

static COAT: LazyLock<CoatTable> =
    LazyLock::new(|| CoatTable::new(1.5, 0.1, 0.1, 0.01, 0.0, Rgb::ZERO, 10));
static TABLES: LazyLock<PrincipledTables> = LazyLock::new(|| {
    let curve = Arc::new(Curve::new(1.5, false, false));
    PrincipledTables {
        facets: Arc::new(Facets::new(true)),
        base: curve.clone(),
        coat: curve,
    }
});
static PLAIN: LazyLock<Principled<'static>> =
    LazyLock::new(|| Principled::new(&TABLES, &PrincipledParams::default()));
static LACQUERED: LazyLock<Principled<'static>> = LazyLock::new(|| {
    let params = PrincipledParams {
        metallic: 1.0,
        coat: 1.0,
        ..PrincipledParams::default()
    };
    Principled::new(&TABLES, &params)
});
static VELVET: LazyLock<Principled<'static>> = LazyLock::new(|| {
    let params = PrincipledParams {
        sheen_color: Rgb::ONE,
        sheen_roughness: 0.5,
        roughness: 1.0,
        ..PrincipledParams::default()
    };
    Principled::new(&TABLES, &params)
});
static LOBES: LazyLock<Vec<LobeParam>> = LazyLock::new(|| {
    vec![LobeParam {
        albedo: Rgb::splat(0.4),
        c: Vec3::new(-1.0, -1.0, 1.0),
        n: 20.0,
    }]
});

fn bsdf(kind: &str) -> Bsdf<'static> {
    let grey = Rgb::splat(0.5);
    let gold = (Rgb::new(0.14, 0.37, 1.44), Rgb::new(3.98, 2.38, 1.6));
    match kind {
        "diffuse" => Bsdf::Diffuse(Diffuse::new(grey)),
        "oren_nayar" => Bsdf::OrenNayar(OrenNayar::new(grey, 20.0)),
        "phong" => Bsdf::Phong(Phong::new(grey, grey, 40.0)),
        "lafortune" => Bsdf::Lafortune(Lafortune::new(grey, &LOBES)),
        "mirror" => Bsdf::Mirror(Mirror::new(grey)),
        "glass" => Bsdf::Dielectric(Dielectric::new(1.5, 0.0, 0.0, Rgb::ONE, Rgb::ONE)),
        "rough_glass" => Bsdf::Dielectric(Dielectric::new(1.5, 0.2, 0.2, Rgb::ONE, Rgb::ONE)),
        "pane" => Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
        "metal" => Bsdf::Conductor(Conductor::new(gold.0, gold.1, 0.2, 0.2)),
        "coated_diffuse" => Bsdf::CoatedDiffuse(CoatedDiffuse::new(grey, &COAT, 0.1, 0.1)),
        "coated_metal" => {
            let (eta, k) = gold;
            Bsdf::CoatedConductor(CoatedConductor::new(eta, k, 0.2, 0.2, &COAT, 0.1, 0.1))
        }
        "leaf" => Bsdf::DiffuseTransmission(DiffuseTransmission::new(grey, grey * 0.5)),
        "plastic" => Bsdf::Principled(&PLAIN),
        "lacquered_metal" => Bsdf::Principled(&LACQUERED),
        "velvet" => Bsdf::Principled(&VELVET),
        "hair" => Bsdf::Hair(Hair::new(0.3, 1.55, grey, 0.3, 0.3, 2.0)),
        other => unreachable!("{other} is no kind"),
    }
}

#[divan::bench(args = KINDS)]
fn eval(bencher: Bencher, kind: &str) {
    let (bsdf, mut numbers) = (bsdf(kind), Numbers(3));
    let pairs: [(Vec3, Vec3); BATCH] =
        std::array::from_fn(|_| (up(&mut numbers), numbers.direction()));
    bencher.counter(ItemsCount::new(BATCH)).bench_local(|| {
        let values = pairs.iter().map(|(o, i)| bsdf.eval_pdf(*black_box(o), *i));
        values.map(|(f, pdf)| f.x + pdf).sum::<f32>()
    });
}

#[divan::bench(args = KINDS)]
fn sample(bencher: Bencher, kind: &str) {
    let (bsdf, mut numbers) = (bsdf(kind), Numbers(4));
    let inputs: [(Vec3, f32, Vec2); BATCH] =
        std::array::from_fn(|_| (up(&mut numbers), numbers.one(), numbers.two()));
    bencher.counter(ItemsCount::new(BATCH)).bench_local(|| {
        let samples = inputs
            .iter()
            .filter_map(|(o, lobe, u)| bsdf.sample(*black_box(o), *lobe, *u));
        samples.map(|s| s.weight.x + s.wi.z).sum::<f32>()
    });
}

fn up(numbers: &mut Numbers) -> Vec3 {
    let d = numbers.direction();
    d.with_z(d.z.abs().max(0.01))
}
