//! Tangents that we make against those that others made, where their model is present.

use crate::import::gltf::tangents;
use crate::{Overrides, assets, load};
use glam::Vec3;
use std::path::Path;

#[test]
fn tangents_agree_with_those_of_a_model_that_has_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes/gltf");
    let mut compared = 0;
    for name in ["WaterBottle", "LightsPunctualLamp"] {
        let folder = root.join(name);
        if !folder.is_dir() {
            eprintln!("skipped: no shared models beside the repository");
            return;
        }
        let (source, main) = assets::open(&folder).unwrap();
        let (desc, _) = load(&main, &*source, &Overrides::default()).unwrap();
        for given in &desc.meshes {
            let mut made = given.clone();
            made.tangents = Default::default();
            tangents::generate(&mut made, 0, &tangents::PLAIN);
            let corners = given.indices.as_flattened().iter();
            let (mut close, mut signs, mut all) = (0, 0, 0);
            for (g, m) in corners.zip(made.indices.as_flattened()) {
                let (g, m) = (given.tangents[*g as usize], made.tangents[*m as usize]);
                let axis = |t: [f32; 4]| Vec3::new(t[0], t[1], t[2]);
                all += 1;
                close += usize::from(axis(g).dot(axis(m)) > 0.9);
                signs += usize::from(g[3] == m[3]);
            }
            println!("{name}: {close} close, {signs} signs of {all}");
            // Exporters differ in seams and poles, not in what a tangent is.
            assert!(close * 100 > all * 95 && signs * 100 > all * 99, "{name}");
            compared += all;
        }
    }
    assert!(compared > 10_000);
}
