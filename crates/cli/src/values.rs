//! Values as people write them: durations, sizes, memory, vectors, frames.

use std::time::Duration;

/// `90s`, `10m`, `1h30m`, `250ms`; a bare number is refused because it could mean anything.
pub fn duration(text: &str) -> Result<Duration, String> {
    let bad = || format!("'{text}' is no duration; write 90s, 10m or 1h30m");
    let mut rest = text.trim();
    if rest.is_empty() {
        return Err(bad());
    }
    let mut seconds = 0.0;
    while !rest.is_empty() {
        let digits = rest
            .find(|c: char| !c.is_ascii_digit() && c != '.')
            .ok_or_else(bad)?;
        let number: f64 = rest[..digits].parse().map_err(|_| bad())?;
        rest = &rest[digits..];
        let letters = rest
            .find(|c: char| !c.is_ascii_alphabetic())
            .unwrap_or(rest.len());
        let factor = match &rest[..letters] {
            "ms" => 0.001,
            "s" => 1.0,
            "m" | "min" => 60.0,
            "h" => 3600.0,
            "d" => 86_400.0,
            _ => return Err(bad()),
        };
        rest = &rest[letters..];
        seconds += number * factor;
    }
    if seconds <= 0.0 {
        return Err("a duration has to be longer than nothing".into());
    }
    Duration::try_from_secs_f64(seconds).map_err(|_| bad())
}

/// `1920x1080`.
pub fn size(text: &str) -> Result<[u32; 2], String> {
    let bad = || format!("'{text}' is no size; write WIDTHxHEIGHT, such as 1920x1080");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(bad)?;
    let parse = |side: &str| side.trim().parse::<u32>().map_err(|_| bad());
    let size = [parse(width)?, parse(height)?];
    if size.contains(&0) {
        return Err("a picture has at least one pixel each way".into());
    }
    Ok(size)
}

/// `8G`, `512M`, `1.5GiB`, or bytes. Units are powers of 1024.
pub fn memory(text: &str) -> Result<u64, String> {
    let bad = || format!("'{text}' is no size of memory; write 8G or 512M");
    let text = text.trim();
    let letters = text
        .find(|c: char| c.is_ascii_alphabetic())
        .unwrap_or(text.len());
    let number: f64 = text[..letters].trim().parse().map_err(|_| bad())?;
    let shift = match text[letters..]
        .to_ascii_lowercase()
        .trim_end_matches("ib")
        .trim_end_matches('b')
    {
        "" => 0,
        "k" => 10,
        "m" => 20,
        "g" => 30,
        "t" => 40,
        _ => return Err(bad()),
    };
    let bytes = number * (1u64 << shift) as f64;
    if !(1.0..9e15).contains(&bytes) {
        return Err(bad());
    }
    Ok(bytes as u64)
}

/// `x,y,z`.
pub fn vector(text: &str) -> Result<[f64; 3], String> {
    let bad = || format!("'{text}' is no vector; write x,y,z");
    let mut parts = text.split(',').map(|part| {
        part.trim()
            .parse::<f64>()
            .ok()
            .filter(|number| number.is_finite())
            .ok_or_else(bad)
    });
    let mut next = || parts.next().ok_or_else(bad)?;
    let vector = [next()?, next()?, next()?];
    match parts.next() {
        None => Ok(vector),
        Some(_) => Err(bad()),
    }
}

/// `7` or `1-24`, inclusive.
pub fn frames(text: &str) -> Result<[u32; 2], String> {
    let bad = || format!("'{text}' names no frames; write 7 or 1-24");
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let first: u32 = first.trim().parse().map_err(|_| bad())?;
    let last: u32 = last.trim().parse().map_err(|_| bad())?;
    if first > last {
        return Err(format!("frames {first}-{last} run backwards"));
    }
    Ok([first, last])
}

/// Samples per pixel.
pub fn spp(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(spp) if (1..=film::unit::SPP_MAX).contains(&spp) => Ok(spp),
        _ => Err(format!(
            "'{text}' is no number of samples from 1 to {}",
            film::unit::SPP_MAX
        )),
    }
}

/// A number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err(format!("'{text}' is no number above zero")),
    }
}

/// A file that a picture can be written to.
pub fn picture_path(text: &str) -> Result<std::path::PathBuf, String> {
    let lower = text.to_ascii_lowercase();
    if lower.ends_with(".png") || lower.ends_with(".exr") {
        Ok(text.into())
    } else {
        Err(format!("'{text}' ends in neither .png nor .exr"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        let check = |text: &str, millis: u64| {
            assert_eq!(duration(text), Ok(Duration::from_millis(millis)), "{text}")
        };
        check("90s", 90_000);
        check("10m", 600_000);
        check("1h30m", 5_400_000);
        check("250ms", 250);
        check("1.5s", 1500);
        for bad in ["", "90", "s", "-5s", "1x", "0s", "1s2", "1e99h", ".s"] {
            assert!(duration(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_memory_vectors_frames() {
        assert_eq!(size("1920x1080"), Ok([1920, 1080]));
        for bad in [
            "",
            "x",
            "1920",
            "0x5",
            "5x0",
            "-1x5",
            "1x2x3",
            "99999999999x1",
        ] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(memory("8G"), Ok(8 << 30));
        assert_eq!(memory("1.5GiB"), Ok(3 << 29));
        assert_eq!(memory("4096"), Ok(4096));
        assert_eq!(memory("512mb"), Ok(512 << 20));
        for bad in ["", "G", "-1G", "1Q", "0", "nan", "1e30"] {
            assert!(memory(bad).is_err(), "{bad}");
        }
        assert_eq!(vector("-1,2.5,3e2"), Ok([-1.0, 2.5, 300.0]));
        for bad in ["", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "inf,0,0"] {
            assert!(vector(bad).is_err(), "{bad}");
        }
        assert_eq!(frames("7"), Ok([7, 7]));
        assert_eq!(frames("1-24"), Ok([1, 24]));
        for bad in ["", "-", "5-1", "a-b", "-1-2"] {
            assert!(frames(bad).is_err(), "{bad}");
        }
        assert!(spp("0").is_err() && spp("16777217").is_err() && spp("16777216").is_ok());
        assert!(picture_path("a.png").is_ok() && picture_path("a.jpg").is_err());
    }
}
