//! Which way normal maps turn a surface.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;
use std::sync::Arc;

/// A picture of one colour as a file.
fn pixel(rgb: [f32; 3]) -> ImageDesc {
    let mut bytes = b"PF 1 1 -1\n".to_vec();
    for c in rgb {
        bytes.extend(c.to_le_bytes());
    }
    ImageDesc {
        path: "pixel.pfm".into(),
        encoding: Encoding::Linear,
        missing: false,
        bytes: Some(bytes.into()),
    }
}

/// A square that fills the view with a normal map of one colour; its texture coordinates follow +X and
/// +Y.
fn square(map: [f32; 3], tangent: Option<[f32; 4]>, transform: DAffine3) -> SceneDesc {
    let mut desc = blank(4, 4);
    desc.integrator = Integrator::Normals;
    desc.images.push(pixel(map));
    desc.textures.push(Texture::Image {
        image: ImageId(0),
        map: UvMap::default(),
        wrap: (Wrap::Repeat, Wrap::Repeat),
        nearest: false,
        mip: None,
        invert: false,
        scale: [1.0; 4],
    });
    let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
    let mut mesh = triangles(&corners.map(|[x, y]| [x, y, 0.0]), &[[0, 1, 2], [0, 2, 3]]);
    mesh.normals = Arc::new(vec![[0.0, 0.0, 1.0]; 4]);
    mesh.uvs = vec![Arc::new(corners.to_vec())];
    mesh.tangents = Arc::new(tangent.map_or(vec![], |t| vec![t; 4]));
    let shape = desc.mesh(mesh);
    desc.place(shape, transform, diffuse(0.5));
    desc.materials[0].normal_map = Some((TextureId(0), 1.0));
    desc
}

#[track_caller]
fn seen(desc: &SceneDesc, normal: [f64; 3]) {
    let expected = DVec3::from(normal).normalize() * 0.5 + 0.5;
    for rgb in render(desc, 1).rgb {
        assert!(
            (DVec3::from(rgb) - expected).length() < 1e-4,
            "{:?} instead of {normal:?}",
            (DVec3::from(rgb) - 0.5) * 2.0
        );
    }
}

/// Red leans along the tangent, green along the bitangent; the mesh's own tangents go before those of
/// its texture coordinates, and a mirrored copy looks mirrored.
#[test]
fn normal_maps_follow_the_tangents_of_the_mesh() {
    let back = at(0.0, 0.0, -2.0);
    let map = [0.65, 0.55, 0.9]; // (0.3, 0.1, 0.8)
    seen(&square(map, None, back), [0.3, 0.1, 0.8]);
    let along_y = Some([0.0, 1.0, 0.0, 1.0]);
    seen(&square(map, along_y, back), [-0.1, 0.3, 0.8]);
    let other_hand = Some([0.0, 1.0, 0.0, -1.0]);
    seen(&square(map, other_hand, back), [0.1, 0.3, 0.8]);
    let mirror = back * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    seen(&square(map, along_y, mirror), [0.1, 0.3, 0.8]);
    // The same where the copy moves, which is placed only when it is hit.
    let mut moving = square(map, along_y, mirror);
    let key = moving.primitives[0].transform.keys[0];
    moving.primitives[0].transform.keys = vec![
        MotionKey { time: 0.0, ..key },
        MotionKey { time: 9.0, ..key },
    ];
    moving.primitives[0].transform.keys[1]
        .transform
        .translation
        .z -= 1e-3;
    seen(&moving, [0.1, 0.3, 0.8]);
}

/// A map that points into the surface is turned no further than one that points along it.
#[test]
fn normal_maps_do_not_leap_at_the_horizon() {
    let at_slope = |blue: f32| {
        let rgb = render(&square([0.9, 0.5, blue], None, at(0.0, 0.0, -2.0)), 1).rgb[0];
        (rgb[0] - 0.5) * 2.0
    };
    let (steep, past) = (at_slope(0.5), at_slope(0.3));
    assert!(steep > 0.6, "{steep}");
    assert_eq!(steep, past);
}

/// What is diffuse is lit about the map's own normal, also where that leans so far that the facets have
/// to be turned back: a sphere of uniform light lights a plane that leans by an angle by (1 + cos) / 2 of
/// what lies above the real surface; the softened terminator and the turned facets only darken.
#[test]
fn diffuse_light_fades_as_a_map_leans() {
    let mut before = f64::INFINITY;
    for degrees in [0.0f32, 20.0, 45.0, 70.0, 89.0, 100.0, 120.0, 150.0] {
        let (sin, cos) = tracer::math::sin_cos_2pi(degrees / 360.0);
        let map = [0.5 + 0.5 * sin, 0.5, 0.5 + 0.5 * cos];
        let mut desc = square(map, None, at(0.0, 0.0, -2.0));
        desc.integrator = blank(4, 4).integrator;
        desc.lights.push(sky(1.0));
        desc.materials[0].bsdf = BsdfDesc::Principled(Box::new(Principled {
            base_color: grey(1.0),
            metallic: FloatTex::Const(0.0),
            roughness: FloatTex::Const(0.5),
            specular: FloatTex::Const(0.0),
            ..Principled::default()
        }));
        let picture = render(&desc, 1024);
        let mean = picture.rgb.iter().map(|c| c[1]).sum::<f64>() / picture.rgb.len() as f64;
        let bound = f64::from(1.0 + cos) * 0.5;
        // Beyond the horizon the turned facets cut more.
        let least = if degrees < 90.0 { 0.7 } else { 0.3 } * bound;
        assert!(
            mean < bound + 0.01 && mean > least && mean < before,
            "{degrees} degrees: {mean}, at most {bound}, before {before}"
        );
        before = mean;
    }
}
