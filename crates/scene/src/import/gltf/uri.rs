//! URIs of buffers and pictures: data URIs, and names of files relative to the scene.

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

/// What a URI stands for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Uri {
    /// The bytes themselves.
    Data(Vec<u8>),
    /// A file, with its escapes resolved; whether the path is allowed is for the asset source to say.
    File(String),
}

/// Missing padding is common and does no harm.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Takes a URI apart.
pub(super) fn parse(uri: &str) -> Result<Uri, String> {
    let is_data = uri
        .get(..5)
        .is_some_and(|s| s.eq_ignore_ascii_case("data:"));
    if !is_data {
        let path = percent_encoding::percent_decode_str(uri)
            .decode_utf8()
            .map_err(|_| "a file name whose escapes are not UTF-8".to_owned())?;
        return Ok(Uri::File(path.into_owned()));
    }
    let Some((head, data)) = uri[5..].split_once(',') else {
        return Err("a data URI without a comma".into());
    };
    let base64 = head
        .rsplit(';')
        .next()
        .is_some_and(|last| last.trim().eq_ignore_ascii_case("base64"));
    if base64 {
        let bytes = BASE64.decode(data.trim_end());
        return bytes
            .map(Uri::Data)
            .map_err(|e| format!("damaged base64 data: {e}"));
    }
    Ok(Uri::Data(
        percent_encoding::percent_decode_str(data).collect(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_taken_apart() {
        let check = |uri: &str, expect: Result<Uri, &str>| match (parse(uri), expect.clone()) {
            (Ok(got), Ok(want)) => assert_eq!(got, want, "{uri}"),
            (Err(got), Err(want)) => assert!(got.contains(want), "{uri}: {got}"),
            (got, _) => panic!("{uri}: {got:?}, expected {expect:?}"),
        };
        let data = |bytes: &[u8]| Ok(Uri::Data(bytes.to_vec()));
        check("a%20b.bin", Ok(Uri::File("a b.bin".into())));
        check(
            "data:application/octet-stream;base64,AAEC",
            data(&[0, 1, 2]),
        );
        check("DATA:;base64,AAE=", data(&[0, 1]));
        check("data:;base64,AAE", data(&[0, 1]));
        check("data:text/plain,a%00b", data(b"a\0b"));
        check("data:;base64,A*", Err("damaged"));
        check("data:nothing", Err("comma"));
        check("%ff.bin", Err("UTF-8"));
    }
}
