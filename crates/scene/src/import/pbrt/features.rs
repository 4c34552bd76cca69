//! The table of features (`features.txt`) is checked against the importer, line by line, and becomes
//! docs/formats-pbrt.md.

use super::directives::DIRECTIVES;
use super::params::asked;
use super::{frame, lights, materials, media, shapes, textures};
use crate::assets::MemorySource;
use crate::{Overrides, load};
use std::collections::BTreeSet;
use std::fmt::Write;

const TABLE: &str = include_str!("features.txt");
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/formats-pbrt.md");

#[derive(Clone, Copy, Debug, PartialEq)]
enum Support {
    Yes,
    Approximated,
    No,
    /// It means nothing here.
    None,
}

#[derive(Debug)]
struct Entry {
    group: &'static str,
    /// Type.
    name: &'static str,
    /// What the type needs to be valid.
    needs: &'static str,
    /// Declaration and example of a parameter; the type itself has none.
    param: Option<(&'static str, &'static str)>,
    support: Support,
    how: &'static str,
}

fn entries() -> Vec<Entry> {
    let mut out: Vec<Entry> = Vec::new();
    let (mut group, mut name, mut type_needs) = ("", "", "");
    for line in TABLE.lines() {
        let inside = line.starts_with(' ');
        let text = line.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        if let Some(head) = text.strip_prefix('[') {
            group = head.trim_end_matches(']');
            continue;
        }
        let cells: Vec<&str> = text.split('|').map(str::trim).collect();
        let (word, how) = cells[2].split_once(": ").unwrap_or((cells[2], ""));
        let support = match word {
            "yes" => Support::Yes,
            "approximated" => Support::Approximated,
            "no" => Support::No,
            "none" => Support::None,
            other => panic!("{other:?} in {line:?}"),
        };
        let (needs, param) = if inside {
            let extra = cells.get(3).copied().unwrap_or_default();
            (extra, Some((cells[0], cells[1])))
        } else {
            (name, type_needs) = (cells[0], cells[1]);
            ("", None)
        };
        out.push(Entry {
            group,
            name,
            needs: if inside { needs } else { type_needs },
            param,
            support,
            how,
        });
    }
    out
}

fn source(text: &str) -> MemorySource {
    let picture = |width, height| {
        let mut out = std::io::Cursor::new(Vec::new());
        let picture = image::DynamicImage::new_rgb8(width, height);
        picture.write_to(&mut out, image::ImageFormat::Png).unwrap();
        out.into_inner()
    };
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1 0 0 0 1 0 3 0 1 2\n";
    let draft = |name, value| {
        crate::import::nanovdb::testing::Draft::new(name).filled([0; 3], [3; 3], |_| value)
    };
    let drafts = [draft("density", 1.0), draft("temperature", 900.0)];
    [
        ("square.png", picture(4, 4)),
        ("wide.png", picture(4, 2)),
        ("t.ply", ply.into()),
        ("lens.dat", b"50 5 1.5 20 -50 40 1 20".to_vec()),
        ("a.nvdb", crate::import::nanovdb::testing::file(&drafts, 0)),
    ]
    .into_iter()
    .fold(MemorySource::new(), |all, (path, bytes)| {
        all.with(path, bytes).unwrap()
    })
    .with("s.pbrt", text)
    .unwrap()
}

/// A scene in which a type appears, with some parameters.
fn scene(group: &str, name: &str, params: &str) -> String {
    let before = matches!(
        group,
        "Camera" | "Film" | "PixelFilter" | "Sampler" | "Integrator"
    );
    let frame = if before {
        format!("{group} \"{name}\" {params}")
    } else {
        String::new()
    };
    let float = params.starts_with("float ") || matches!(name, "fbm" | "windy" | "wrinkled");
    let (params, kind) = match params.strip_prefix("float ") {
        Some(rest) if group == "Texture" => (rest, "float"),
        _ if float && group == "Texture" => (params, "float"),
        _ => (params, "spectrum"),
    };
    let world = match group {
        _ if before => String::new(),
        "Texture" => format!("Texture \"x\" \"{kind}\" \"{name}\" {params}"),
        "MakeNamedMedium" => format!("MakeNamedMedium \"m\" \"string type\" \"{name}\" {params}"),
        _ => format!("{group} \"{name}\" {params}"),
    };
    format!(
        "{frame}\nWorldBegin\nLightSource \"infinite\"
        Texture \"float\" \"float\" \"imagemap\" \"string filename\" \"square.png\"
        Texture \"color\" \"spectrum\" \"imagemap\" \"string filename\" \"square.png\"
        MakeNamedMaterial \"a\" \"string type\" \"diffuse\" MakeNamedMaterial \"b\" \"string type\" \"diffuse\"
        {world}\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]\n"
    )
}

/// Errors, warnings, and the names of parameters that were asked for.
fn outcome(text: &str) -> (Vec<String>, Vec<String>, BTreeSet<String>) {
    asked::start();
    let result = load("s.pbrt", &source(text), &Overrides::default());
    let names = asked::stop();
    let all = match result {
        Ok((_, found)) => (found.iter().map(|d| d.to_string()).collect(), vec![]),
        Err(error) => (
            vec![],
            error.diagnostics.iter().map(|d| d.to_string()).collect(),
        ),
    };
    (all.1, all.0, names)
}

#[test]
fn the_table_names_what_the_importer_knows() {
    let known: [(&str, &[&str]); 12] = [
        ("Directive", &DIRECTIVES),
        ("Shape", &shapes::SHAPES),
        ("Material", &materials::MATERIALS),
        ("Texture", &textures::CLASSES),
        ("LightSource", &lights::LIGHTS),
        ("AreaLightSource", &["diffuse"]),
        ("MakeNamedMedium", &media::MEDIA),
        ("Camera", &frame::CAMERAS),
        ("Film", &frame::FILMS),
        ("PixelFilter", &frame::FILTERS),
        ("Sampler", &frame::SAMPLERS),
        ("Integrator", &frame::INTEGRATORS),
    ];
    let entries = entries();
    for (group, names) in known {
        let listed: BTreeSet<&str> = entries
            .iter()
            .filter(|e| e.group == group && e.param.is_none())
            .map(|e| e.name)
            .collect();
        assert_eq!(listed, names.iter().copied().collect(), "{group}");
    }
    let groups: BTreeSet<&str> = entries.iter().map(|e| e.group).collect();
    assert_eq!(groups.len(), known.len());
}

/// `yes` and `none` go through without a word, the rest with a warning or an error.
#[test]
fn the_table_says_what_happens() {
    let mut wrong = String::new();
    for entry in entries().iter().filter(|e| e.group != "Directive") {
        let type_needs = entries()
            .into_iter()
            .find(|e| e.group == entry.group && e.name == entry.name)
            .map_or("", |e| e.needs);
        let params = match entry.param {
            None => type_needs.to_owned(),
            // A parameter that the type needs anyway is not written twice.
            Some((declaration, example)) => {
                let (kind, name) = declaration.split_once(' ').unwrap();
                let given = type_needs.contains(&format!("{kind} {name}\""));
                let own = if given {
                    String::new()
                } else {
                    format!("\"{declaration}\" {example}")
                };
                let float = entry.needs == "float";
                let extra = if float { "" } else { entry.needs };
                let before = if float { "float " } else { "" };
                format!("{before}{type_needs} {own} {extra}")
            }
        };
        let text = scene(entry.group, entry.name, &params);
        let (errors, warnings, _) = outcome(&text);
        let fine = match entry.support {
            Support::Yes | Support::None => errors.is_empty() && warnings.is_empty(),
            // What a subsurface material does differently is not worth a warning in each scene.
            Support::Approximated if entry.name == "subsurface" => errors.is_empty(),
            // A flat patch is exact.
            Support::Approximated if entry.name == "bilinearmesh" => errors.is_empty(),
            Support::Approximated => errors.is_empty() && !warnings.is_empty(),
            Support::No => !(errors.is_empty() && warnings.is_empty()),
        };
        if !fine {
            let _ = writeln!(
                wrong,
                "{} {} {:?} {:?}: errors {errors:?}, warnings {warnings:?}",
                entry.group, entry.name, entry.param, entry.support
            );
        }
    }
    assert_eq!(wrong, "");
}

/// The importer asks for no parameter of a type that the table does not list.
#[test]
fn the_table_lists_what_is_asked_for() {
    let entries = entries();
    let mut wrong = String::new();
    for entry in entries
        .iter()
        .filter(|e| e.param.is_none() && e.group != "Directive")
    {
        let params: Vec<&Entry> = entries
            .iter()
            .filter(|e| e.group == entry.group && e.name == entry.name && e.param.is_some())
            .collect();
        let mut listed: BTreeSet<&str> = params
            .iter()
            .filter_map(|e| e.param?.0.split_once(' ').map(|(_, name)| name))
            .collect();
        listed.extend(
            entry
                .needs
                .split('"')
                .filter_map(|word| Some(word.split_once(' ')?.1)),
        );
        // Of every kind of material, texture with a 2D mapping, and named thing.
        listed.extend(["type"]);
        if entry.group == "Material" {
            listed.extend(["displacement", "normalmap"]);
        }
        let mapped = ["bilerp", "checkerboard", "dots", "imagemap"];
        if entry.group == "Texture" && mapped.contains(&entry.name) {
            listed.extend([
                "v1", "v2", "uscale", "vscale", "udelta", "vdelta", "mapping",
            ]);
        }
        if matches!(entry.group, "Camera") {
            listed.extend([
                "lensradius",
                "focaldistance",
                "frameaspectratio",
                "screenwindow",
            ]);
        }
        let (_, _, base) = outcome(&scene("Shape", "sphere", ""));
        let (_, _, with) = outcome(&scene(entry.group, entry.name, entry.needs));
        let mut extra = BTreeSet::new();
        for name in with.difference(&base) {
            if !listed.contains(name.as_str()) {
                extra.insert(name.clone());
            }
        }
        if !extra.is_empty() {
            let _ = writeln!(wrong, "{} {}: {extra:?}", entry.group, entry.name);
        }
    }
    assert_eq!(wrong, "");
}

fn page() -> String {
    let mut out = String::from(
        "# pbrt-v4 scenes: what is read\n\n\
         Generated from `crates/scene/src/import/pbrt/features.txt`, each line of which a test holds against the\n\
         importer: do not edit. *Approximated* and *no* come with a warning or an error that names the place and says\n\
         what is done instead; *-* means that the parameter has no meaning here. Colours may be written as `rgb`,\n\
         `blackbody`, or `spectrum` (a name, numbers, or a file); they become linear Rec. 709. What is not listed is\n\
         warned about and left out.\n",
    );
    let word = |entry: &Entry| {
        let word = match entry.support {
            Support::Yes => "yes",
            Support::Approximated => "approximated",
            Support::No => "no",
            Support::None => "-",
        };
        match entry.how {
            "" => word.to_owned(),
            how => format!("{word}: {how}"),
        }
    };
    let mut group = "";
    for entry in entries() {
        if entry.group != group {
            group = entry.group;
            let _ = write!(
                out,
                "\n## {group}\n\n| type | parameter | |\n|---|---|---|\n"
            );
        }
        let (name, param) = match entry.param {
            None => (format!("**{}**", entry.name), String::new()),
            Some((declaration, _)) => (String::new(), format!("`{declaration}`")),
        };
        let _ = writeln!(out, "| {name} | {param} | {} |", word(&entry));
    }
    out
}

#[test]
fn the_page_is_fresh() {
    let page = page();
    if std::env::var_os("BROLLY_BLESS").is_some() {
        std::fs::write(PAGE, &page).unwrap();
    }
    let written = std::fs::read_to_string(PAGE).unwrap_or_default();
    assert!(
        written == page,
        "docs/formats-pbrt.md is stale: run the tests with BROLLY_BLESS=1"
    );
}
