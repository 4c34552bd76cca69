//! Every file of the fuzzers' corpus, seeds and findings alike, still keeps every promise.

use fuzzing::TARGETS;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz")
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.starts_with('.'))
        .collect()
}

#[test]
fn the_corpus_is_answered() {
    for target in TARGETS {
        let folder = root().join("corpus").join(target.name);
        let files = names(&folder);
        assert!(!files.is_empty(), "{} has no seed", target.name);
        for file in files {
            let bytes = std::fs::read(folder.join(&file)).unwrap();
            // A panic names no file.
            println!("{}/{file}", target.name);
            (target.run)(&bytes);
        }
    }
}

#[test]
fn every_target_has_a_fuzzer_and_a_corpus() {
    let expected: BTreeSet<String> = TARGETS.iter().map(|t| t.name.to_owned()).collect();
    assert_eq!(names(&root().join("corpus")), expected);
    let fuzzers = names(&root().join("fuzz_targets"));
    let fuzzers: BTreeSet<String> = fuzzers
        .iter()
        .map(|name| name.trim_end_matches(".rs").to_owned())
        .collect();
    assert_eq!(fuzzers, expected);
}

/// A seed that everything refuses teaches a fuzzer nothing.
#[test]
fn no_input_is_larger_than_it_need_be() {
    let mut total = 0;
    for target in TARGETS {
        let folder = root().join("corpus").join(target.name);
        for file in names(&folder) {
            total += folder.join(file).metadata().unwrap().len();
        }
    }
    assert!(
        total < 300_000,
        "{total} bytes of corpus; the limit is 300,000"
    );
}
