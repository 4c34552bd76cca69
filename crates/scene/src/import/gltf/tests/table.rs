//! The table of extensions in `docs/formats.md` is the importer's own.

use crate::import::gltf::{EXTENSIONS, Support};
use std::path::Path;

const BEGIN: &str =
    "<!-- the rows below are generated: BROLLY_BLESS=1 cargo test -p brolly-scene -->\n";
const END: &str = "<!-- end -->\n";

fn table() -> String {
    let mut out = String::from("| extension | support | how |\n|---|---|---|\n");
    for e in EXTENSIONS {
        let support = match e.support {
            Support::Full => "full",
            Support::Partly => "in part",
            Support::Metadata => "metadata",
        };
        out += &format!("| {} | {support} | {} |\n", e.name, e.note);
    }
    out
}

#[test]
fn the_documented_extensions_are_the_known_ones() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/formats.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(BEGIN).expect("the place of the table");
    let (committed, after) = rest.split_once(END).expect("the end of the table");
    let fresh = table();
    if std::env::var_os("BROLLY_BLESS").is_some() {
        std::fs::write(&path, format!("{before}{BEGIN}{fresh}{END}{after}")).unwrap();
    } else {
        assert!(
            committed == fresh,
            "docs/formats.md is stale: run the tests with BROLLY_BLESS=1"
        );
    }
    let names: Vec<&str> = EXTENSIONS.iter().map(|e| e.name).collect();
    assert!(
        names.windows(2).all(|pair| pair[0] < pair[1]),
        "sorted: {names:?}"
    );
    // What the code asks a material for is in the table.
    for name in crate::import::gltf::extensions::OF_MATERIALS {
        assert!(names.contains(name), "{name}");
    }
}
