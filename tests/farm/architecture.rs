//! Who may depend on whom.

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand, PackageId};
use std::collections::{BTreeMap, BTreeSet};

/// Everything that a crate links, tests aside.
fn linked(metadata: &Metadata, name: &str) -> BTreeSet<String> {
    let names: BTreeMap<&PackageId, String> = metadata
        .packages
        .iter()
        .map(|package| (&package.id, package.name.to_string()))
        .collect();
    let resolve = metadata.resolve.as_ref().expect("a resolved graph");
    let edges: BTreeMap<&PackageId, Vec<&PackageId>> = resolve
        .nodes
        .iter()
        .map(|node| {
            let normal = node
                .deps
                .iter()
                .filter(|dep| {
                    dep.dep_kinds
                        .iter()
                        .any(|kind| kind.kind == DependencyKind::Normal)
                })
                .map(|dep| &dep.pkg)
                .collect();
            (&node.id, normal)
        })
        .collect();
    let root = names
        .iter()
        .find(|(_, other)| *other == name)
        .map(|(id, _)| *id)
        .unwrap_or_else(|| panic!("no crate {name}"));
    let mut found = BTreeSet::new();
    let mut open = vec![root];
    while let Some(id) = open.pop() {
        for &dep in edges.get(id).into_iter().flatten() {
            if found.insert(dep) {
                open.push(dep);
            }
        }
    }
    found.into_iter().map(|id| names[id].clone()).collect()
}

#[test]
fn dependencies_point_one_way() {
    let metadata = MetadataCommand::new()
        .manifest_path(concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml"))
        .other_options(vec![
            "--filter-platform".to_owned(),
            "x86_64-unknown-linux-gnu".to_owned(),
        ])
        .exec()
        .expect("cargo metadata");
    let check = |from: &str, never: &[&str]| {
        let linked = linked(&metadata, from);
        for other in never {
            assert!(!linked.contains(*other), "{from} links {other}");
        }
    };
    let service = ["tokio", "axum", "reqwest", "hyper", "rusqlite"];
    check(
        "brolly-coordinator",
        &["brolly-tracer", "brolly-worker", "brolly-client", "obvhs"],
    );
    check("brolly-store", &["brolly-tracer", "brolly-coordinator"]);
    check(
        "brolly-tracer",
        &["brolly-protocol", "brolly-client", "brolly-store"],
    );
    check("brolly-tracer", &service);
    check(
        "brolly-film",
        &["brolly-scene", "brolly-tracer", "brolly-protocol"],
    );
    check("brolly-film", &service);
    check(
        "brolly-scene",
        &["brolly-film", "brolly-tracer", "brolly-protocol"],
    );
    check("brolly-scene", &service);
    check(
        "brolly-protocol",
        &["brolly-tracer", "brolly-client", "tokio", "axum", "reqwest"],
    );
    check(
        "brolly-client",
        &["brolly-tracer", "brolly-worker", "brolly-coordinator"],
    );
    check("brolly-worker", &["brolly-coordinator", "brolly-store"]);
    // The test must be able to fail.
    assert!(linked(&metadata, "brolly-worker").contains("brolly-tracer"));
    assert!(linked(&metadata, "brolly-coordinator").contains("tokio"));
}
