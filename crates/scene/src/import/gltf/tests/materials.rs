//! Materials, textures, extensions.

use super::*;

/// The principled surface of a material, its emission, alpha and media.
fn read(material: Value) -> (SceneDesc, Principled) {
    let mut m = Model::triangle();
    m.picture();
    let names: Vec<String> = material["extensions"]
        .as_object()
        .into_iter()
        .flatten()
        .map(|(name, _)| name.clone())
        .collect();
    let m = m.with("/extensionsUsed", json!(names)).material(material);
    let desc = m.fine();
    match &desc.materials[0].bsdf {
        BsdfDesc::Principled(p) => {
            let p = (**p).clone();
            (desc, p)
        }
        other => panic!("{other:?}"),
    }
}

fn extension(name: &str, value: Value) -> (SceneDesc, Principled) {
    read(json!({"extensions": {name: value}}))
}

fn image(desc: &SceneDesc, id: TextureId) -> (Encoding, [f32; 4]) {
    match &desc.textures[id.index()] {
        Texture::Image { image, scale, .. } => (desc.images[image.index()].encoding, *scale),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_core_of_a_material() {
    let (_, p) = read(json!({"name": "plain"}));
    let one = FloatTex::Const(1.0);
    assert_eq!(
        (p.metallic, p.roughness, p.base_color),
        (one, one, ColorTex::Const([1.0; 3]))
    );
    assert!(!p.thin);
    let (desc, p) = read(json!({
        "name": "everything",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": {"index": 0},
            "metallicFactor": 0.5, "roughnessFactor": 0.75, "metallicRoughnessTexture": {"index": 0}
        },
        "normalTexture": {"index": 0, "scale": 2},
        "occlusionTexture": {"index": 0},
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 0}
    }));
    assert_eq!(desc.materials[0].name, "everything");
    let ColorTex::Texture(base) = p.base_color else {
        panic!()
    };
    assert_eq!(image(&desc, base), (Encoding::Srgb, [0.5, 0.25, 1.0, 1.0]));
    let FloatTex::Texture(data, Channel::B) = p.metallic else {
        panic!()
    };
    assert_eq!(p.roughness, FloatTex::Texture(data, Channel::G));
    assert_eq!(
        image(&desc, data),
        (Encoding::Linear, [1.0, 0.75, 0.5, 1.0])
    );
    let (normal, 2.0) = desc.materials[0].normal_map.unwrap() else {
        panic!()
    };
    assert_eq!(image(&desc, normal), (Encoding::Linear, [1.0; 4]));
    let emission = desc.primitives[0].emission.clone().unwrap();
    let ColorTex::Texture(glow) = emission.radiance else {
        panic!()
    };
    assert_eq!(image(&desc, glow), (Encoding::Srgb, [1.0, 0.5, 0.0, 1.0]));
    assert_eq!((emission.scale, emission.two_sided), (1.0, true));
}

#[test]
fn alpha_modes() {
    let check = |mode: &str, alpha: f32, cutoff: f32, expect: Option<f32>| {
        let (desc, _) = read(json!({
            "alphaMode": mode, "alphaCutoff": cutoff,
            "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}
        }));
        assert_eq!(
            desc.primitives[0].alpha,
            expect.map(FloatTex::Const),
            "{mode} {alpha} {cutoff}"
        );
    };
    check("OPAQUE", 0.25, 0.5, None);
    check("BLEND", 0.25, 0.5, Some(0.25));
    check("BLEND", 1.0, 0.5, None);
    check("MASK", 0.5, 0.5, None);
    check("MASK", 0.25, 0.5, Some(0.0));
    let (desc, p) = read(json!({
        "alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}
    }));
    let Some(FloatTex::Texture(mask, Channel::R)) = desc.primitives[0].alpha else {
        panic!()
    };
    let ColorTex::Texture(base) = p.base_color else {
        panic!()
    };
    assert_eq!(
        desc.textures[mask.index()],
        Texture::Threshold {
            value: FloatTex::Texture(base, Channel::A),
            at: 0.5
        }
    );
}

#[test]
fn extensions_of_materials() {
    let number = FloatTex::Const;
    let (desc, _) = read(json!({
        "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5}}
    }));
    assert_eq!(desc.primitives[0].emission.as_ref().unwrap().scale, 5.0);
    let (_, p) = extension("KHR_materials_ior", json!({"ior": 1.33}));
    assert_eq!(p.ior, 1.33);
    assert_eq!(extension("KHR_materials_ior", json!({"ior": 0})).1.ior, 0.0);
    let (desc, p) = extension(
        "KHR_materials_specular",
        json!({"specularFactor": 0.5, "specularTexture": {"index": 0}, "specularColorFactor": [2, 1, 0]}),
    );
    let FloatTex::Texture(id, Channel::A) = p.specular else {
        panic!()
    };
    assert_eq!(image(&desc, id), (Encoding::Linear, [0.5; 4]));
    assert_eq!(p.specular_color, ColorTex::Const([2.0, 1.0, 0.0]));
    let (_, p) = extension(
        "KHR_materials_transmission",
        json!({"transmissionFactor": 0.5}),
    );
    assert_eq!((p.transmission, p.thin), (number(0.5), true));
    let (desc, p) = extension(
        "KHR_materials_clearcoat",
        json!({"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25,
               "clearcoatRoughnessTexture": {"index": 0}, "clearcoatNormalTexture": {"index": 0, "scale": 3}}),
    );
    assert_eq!(p.coat, number(0.5));
    assert!(matches!(p.coat_roughness, FloatTex::Texture(_, Channel::G)));
    assert_eq!(p.coat_normal_map.map(|(_, s)| s), Some(3.0));
    assert!(!mesh(&desc).tangents.is_empty());
    let (_, p) = extension(
        "KHR_materials_sheen",
        json!({"sheenColorFactor": [1, 0.5, 0], "sheenRoughnessFactor": 0.5, "sheenRoughnessTexture": {"index": 0}}),
    );
    assert_eq!(p.sheen_color, ColorTex::Const([1.0, 0.5, 0.0]));
    assert!(matches!(
        p.sheen_roughness,
        FloatTex::Texture(_, Channel::A)
    ));
    let (desc, p) = extension(
        "KHR_materials_iridescence",
        json!({"iridescenceFactor": 1, "iridescenceIor": 1.8, "iridescenceThicknessMinimum": 200,
               "iridescenceThicknessMaximum": 600, "iridescenceThicknessTexture": {"index": 0}}),
    );
    assert_eq!((p.iridescence, p.iridescence_ior), (number(1.0), 1.8));
    let FloatTex::Texture(id, Channel::R) = p.iridescence_thickness else {
        panic!()
    };
    assert!(matches!(
        desc.textures[id.index()],
        Texture::Mix {
            a: ColorTex::Const([200.0, 200.0, 200.0]),
            b: ColorTex::Const([600.0, 600.0, 600.0]),
            amount: FloatTex::Texture(_, Channel::G)
        }
    ));
    let (_, p) = extension(
        "KHR_materials_iridescence",
        json!({"iridescenceFactor": 0.5}),
    );
    assert_eq!(p.iridescence_thickness, number(400.0));
    let (desc, p) = extension(
        "KHR_materials_anisotropy",
        json!({"anisotropyStrength": 0.5, "anisotropyRotation": std::f64::consts::FRAC_PI_2,
               "anisotropyTexture": {"index": 0}}),
    );
    assert!(matches!(p.anisotropy, FloatTex::Texture(_, Channel::B)));
    assert_eq!(p.anisotropy_rotation, number(90.0));
    assert!(p.anisotropy_direction.is_some() && !mesh(&desc).tangents.is_empty());
    let (_, p) = extension(
        "KHR_materials_diffuse_transmission",
        json!({"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [1, 0, 0]}),
    );
    assert_eq!(p.diffuse_transmission, number(0.5));
    assert_eq!(
        p.diffuse_transmission_color,
        ColorTex::Const([1.0, 0.0, 0.0])
    );
    let (desc, p) = extension(
        "KHR_materials_pbrSpecularGlossiness",
        json!({"diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.25, 0.25, 0.25],
               "glossinessFactor": 0.75, "specularGlossinessTexture": {"index": 0}}),
    );
    assert_eq!((p.metallic, p.ior), (number(0.0), 0.0));
    let ColorTex::Texture(id) = p.specular_color else {
        panic!()
    };
    assert_eq!(image(&desc, id), (Encoding::Srgb, [0.25, 0.25, 0.25, 1.0]));
    let FloatTex::Texture(id, Channel::R) = p.roughness else {
        panic!()
    };
    let Texture::Mix {
        amount: FloatTex::Texture(gloss, Channel::A),
        ..
    } = desc.textures[id.index()]
    else {
        panic!()
    };
    assert_eq!(
        image(&desc, gloss),
        (Encoding::Linear, [1.0, 1.0, 1.0, 0.75])
    );
}

#[test]
fn volumes_absorb() {
    let (desc, p) = read(json!({"name": "glass", "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 2,
                                 "attenuationColor": [1, 0.5, 0]}
    }}));
    assert!(!p.thin);
    let sides = desc.primitives[0].media.unwrap();
    assert_eq!(sides.outside, None);
    let medium = &desc.media[sides.inside.unwrap().index()];
    assert_eq!(medium.name, "glass");
    let half = std::f32::consts::LN_2 / 2.0;
    assert_eq!(medium.sigma_a[0], 0.0);
    assert!((medium.sigma_a[1] - half).abs() < 1e-6);
    assert!(medium.sigma_a[2] > 6.0 && medium.sigma_a[2].is_finite());
    // A volume without thickness is a sheet, and white absorbs nothing.
    for volume in [
        json!({"attenuationDistance": 2, "attenuationColor": [0, 0, 0]}),
        json!({"thicknessFactor": 1}),
    ] {
        let thick = volume.get("thicknessFactor").is_some();
        let (desc, p) = extension("KHR_materials_volume", volume);
        assert_eq!(p.thin, !thick);
        assert_eq!((desc.media.len(), desc.primitives[0].media), (0, None));
    }
}

#[test]
fn unlit_surfaces_shine_and_reflect_nothing() {
    let mut m = Model::triangle();
    m.picture();
    let m = m.with("/extensionsUsed", json!(["KHR_materials_unlit"])).material(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0, 1]}, "emissiveFactor": [1, 1, 1],
        "normalTexture": {"index": 0}, "extensions": {"KHR_materials_unlit": {}}
    }));
    let desc = m.fine();
    assert_eq!(
        desc.materials[0].bsdf,
        BsdfDesc::Diffuse {
            reflectance: ColorTex::Const([0.0; 3])
        }
    );
    assert_eq!(desc.materials[0].normal_map, None);
    let emission = desc.primitives[0].emission.as_ref().unwrap();
    assert_eq!(emission.radiance, ColorTex::Const([0.5, 0.25, 0.0]));
}

#[test]
fn samplers_transforms_and_sets() {
    let mut m = Model::triangle();
    m.picture();
    let info = json!({"index": 0, "texCoord": 0, "extensions": {
        "KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [2, 4], "texCoord": 1}}});
    let m = m
        .with("/extensionsUsed", json!(["KHR_texture_transform"]))
        .with(
            "/samplers",
            json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9987}]),
        )
        .with("/textures/0/sampler", 0.into())
        .material(json!({"pbrMetallicRoughness": {"baseColorTexture": info,
                         "metallicRoughnessTexture": {"index": 0}}}));
    let desc = m.fine();
    // Textures in the order of use: metal and roughness with set 0 first, then base colour with set 1.
    let maps: Vec<_> = desc
        .textures
        .iter()
        .map(|t| match t {
            Texture::Image {
                map, wrap, nearest, ..
            } => {
                assert_eq!((*wrap, *nearest), ((Wrap::Clamp, Wrap::Mirror), true));
                map.clone()
            }
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(maps[0], UvMap::default());
    // u' = 2 u + 1/4; with v down v' = 4 v + 1/2, so V' = 1 - 4 (1 - V) - 1/2 = 4 V - 3.5.
    assert_eq!(
        maps[1],
        UvMap::Uv {
            set: 1,
            matrix: [2.0, 0.0, 0.25, 0.0, 4.0, -3.5]
        }
    );
    assert_eq!(mesh(&desc).uvs.len(), 2);
}

#[test]
fn pictures_lie_in_buffers_data_uris_and_files() {
    let mut m = Model::triangle();
    m.picture();
    let inside = m.clone_with_material();
    assert!(inside.fine().images[0].bytes.is_some());
    let png = inside.fine().images[0].bytes.clone().unwrap();
    let uri = inside.with("/images", json!([{"uri": data_uri(&png)}]));
    let desc = uri.fine();
    assert_eq!(desc.images[0].bytes.as_deref(), Some(&*png));
    assert_eq!(desc.images[0].path, "m.gltf#/images/0");
    let named = uri.with("/images", json!([{"uri": "a%20b.png"}]));
    let files = MemorySource::new()
        .with("m.gltf", named.text())
        .unwrap()
        .with("a b.png", &*png)
        .unwrap();
    let loaded = crate::load_with_files("m.gltf", &files, &Overrides::default()).unwrap();
    assert_eq!(
        (
            loaded.desc.images[0].path.as_str(),
            &loaded.desc.images[0].bytes
        ),
        ("a b.png", &None)
    );
    assert!(loaded.files.contains("a b.png"));
    // A WebP that an extension names wins over the fallback.
    let webp = named
        .with(
            "/extensionsUsed",
            json!(["EXT_texture_webp", "KHR_texture_basisu"]),
        )
        .with("/images/1", json!({"uri": data_uri(&png)}))
        .with(
            "/textures/0/extensions",
            json!({"EXT_texture_webp": {"source": 1}}),
        );
    assert!(webp.fine().images[0].bytes.is_some());
    // A KTX2 picture is no loss where there is another.
    let basis = webp.with(
        "/textures/0",
        json!({"source": 1, "extensions": {"KHR_texture_basisu": {"source": 0}}}),
    );
    assert!(basis.fine().images[0].bytes.is_some());
    // And it is read where there is none.
    let mut ktx = crate::picture::KTX2.to_vec();
    for word in [0, 1, 4, 4, 0, 0, 1] {
        ktx.extend(u32::to_le_bytes(word));
    }
    let alone = basis
        .with(
            "/images/0",
            json!({"uri": data_uri(&ktx), "mimeType": "image/ktx2"}),
        )
        .with(
            "/textures/0",
            json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}),
        )
        .with("/extensionsRequired", json!(["KHR_texture_basisu"]));
    assert_eq!(alone.fine().images[0].bytes.as_deref(), Some(&*ktx));
}

impl Model {
    fn clone_with_material(&self) -> Model {
        Model {
            json: self.json.clone(),
            bytes: self.bytes.clone(),
        }
        .material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}))
    }
}

#[test]
fn materials_of_one_name_are_told_apart() {
    let mut m = Model::triangle();
    m.json["materials"] = json!([{"name": "a"}, {"name": "a"}]);
    m.json["meshes"][0]["primitives"] = json!([
        {"attributes": {"POSITION": 0}, "material": 0}, {"attributes": {"POSITION": 0}, "material": 1}
    ]);
    let (desc, said) = m.load().unwrap();
    let names: Vec<&str> = desc.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["a", "a (2)"]);
    assert!(
        said.iter()
            .any(|s| s.contains("another material is called \"a\" too")),
        "{said:?}"
    );
}
