//! "Did you mean": the known name nearest to one that is not.

/// `; did you mean "wall"?`, or nothing where no known name is near.
pub(crate) fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let lower = name.to_ascii_lowercase();
    let best = known
        .into_iter()
        .map(|candidate| {
            (
                strsim::damerau_levenshtein(&lower, &candidate.to_ascii_lowercase()),
                candidate,
            )
        })
        .min();
    match best {
        Some((distance, candidate)) if distance <= 1 + name.chars().count() / 4 => {
            format!("; did you mean {candidate:?}?")
        }
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn only_near_names_are_suggested() {
        let known = ["wall", "floor"];
        assert_eq!(
            super::did_you_mean("wal", known),
            "; did you mean \"wall\"?"
        );
        assert_eq!(
            super::did_you_mean("Flor", known),
            "; did you mean \"floor\"?"
        );
        assert_eq!(super::did_you_mean("ceiling", known), "");
        assert_eq!(super::did_you_mean("x", []), "");
    }
}
