//! pbrt's spectra as three numbers: what they are used for decides how.

use super::Importer;
use super::params::{Kind, Param, Params};
use crate::color;
use crate::context::Issue;
use crate::model::Rgb;

/// What a spectrum describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Light: numbers of an rgb are kept, everything else gives hue at luminance 1.
    Emission,
    /// A fraction.
    Albedo,
    /// Optical constants.
    Unbounded,
}

/// The primaries that `rgb` numbers refer to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum ColorSpace {
    #[default]
    Srgb,
    Rec2020,
    DciP3,
    Aces,
}

impl ColorSpace {
    pub fn named(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "srgb" => ColorSpace::Srgb,
            "rec2020" => ColorSpace::Rec2020,
            "dci-p3" => ColorSpace::DciP3,
            "aces2065-1" => ColorSpace::Aces,
            _ => return None,
        })
    }

    /// To linear Rec. 709, whites kept (for ACES by Bradford adaptation from its white, D60); what
    /// lies outside the gamut is cut.
    pub fn to_rec709(self, [r, g, b]: [f64; 3]) -> [f64; 3] {
        let m: [[f64; 3]; 3] = match self {
            ColorSpace::Srgb => return [r, g, b],
            ColorSpace::Rec2020 => [
                [1.660_491, -0.587_641, -0.072_850],
                [-0.124_550, 1.132_900, -0.008_349],
                [-0.018_151, -0.100_579, 1.118_730],
            ],
            ColorSpace::DciP3 => [
                [1.224_940, -0.224_940, 0.0],
                [-0.042_057, 1.042_057, 0.0],
                [-0.019_638, -0.078_636, 1.098_274],
            ],
            ColorSpace::Aces => [
                [2.521_686, -1.134_131, -0.387_555],
                [-0.276_480, 1.372_719, -0.096_239],
                [-0.015_378, -0.152_975, 1.168_353],
            ],
        };
        m.map(|row| (row[0] * r + row[1] * g + row[2] * b).max(0.0))
    }
}

/// Any type that describes a spectrum.
pub(super) const SPECTRUM: [Kind; 3] = [Kind::Rgb, Kind::Blackbody, Kind::Spectrum];

/// eta and k of metals by channel. Found by fitting: per channel, the pair whose Fresnel reflectance
/// at normal incidence and at cosine 0.2 is that of the measured spectrum (tables of refractiveindex.info
/// as pbrt-v4 names them), seen under D65 through the CIE 1931 functions and Rec. 709 primaries.
/// Gold's red lies outside the gamut (reflectance 1.02); there the weighted means of eta and k stand.
const METALS: [(&str, Rgb, Rgb); 7] = [
    ("Ag", [0.1318, 0.1227, 0.1509], [4.1497, 3.3159, 2.4087]),
    ("Al", [1.4380, 0.9303, 0.5923], [7.7656, 6.6090, 5.3690]),
    ("Au", [0.0800, 0.4101, 1.5680], [3.3900, 2.3563, 1.7197]),
    ("Cu", [0.1602, 0.9762, 1.2103], [3.6044, 2.6208, 2.3658]),
    ("CuZn", [0.4628, 0.5225, 1.1227], [4.2836, 2.6659, 1.8097]),
    ("MgO", [1.7337, 1.7409, 1.7535], [0.0; 3]),
    ("TiO2", [2.8603, 2.9569, 3.1857], [0.0; 3]),
];

/// Indices of refraction at the sodium line, 589.3 nm; `F5` to `F11` are pbrt's names for SF5 to SF11.
const GLASSES: [(&str, f32); 10] = [
    ("BK7", 1.5167),
    ("BAF10", 1.6699),
    ("FK51A", 1.4865),
    ("LASF9", 1.8500),
    ("SF5", 1.6725),
    ("SF10", 1.7281),
    ("SF11", 1.7845),
    ("F5", 1.6725),
    ("F10", 1.7281),
    ("F11", 1.7845),
];

/// Hues of the standard illuminants at luminance 1, from pbrt-v4's own tables. Its D50 has less red than
/// the CIE's (85 instead of 98 at 650 nm), whose hue would be 1.1764, 0.9758, 0.7216: files made with
/// pbrt expect the former.
const ILLUMINANTS: [(&str, Rgb); 16] = [
    ("stdillum-A", [1.8450, 0.8261, 0.2334]),
    ("stdillum-D50", [1.0866, 0.9995, 0.7497]),
    ("stdillum-D65", [1.0, 1.0, 1.0]),
    ("illum-acesD60", [1.0469, 0.9946, 0.9155]),
    ("stdillum-F1", [0.9543, 1.0193, 0.9437]),
    ("stdillum-F2", [1.3401, 0.9430, 0.5629]),
    ("stdillum-F3", [1.5764, 0.8911, 0.3809]),
    ("stdillum-F4", [1.8063, 0.8342, 0.2671]),
    ("stdillum-F5", [0.9154, 1.0362, 0.8903]),
    ("stdillum-F6", [1.3161, 0.9578, 0.4865]),
    ("stdillum-F7", [1.0003, 1.0002, 0.9974]),
    ("stdillum-F8", [1.1767, 0.9757, 0.7201]),
    ("stdillum-F9", [1.3768, 0.9314, 0.5694]),
    ("stdillum-F10", [1.1776, 0.9756, 0.7184]),
    ("stdillum-F11", [1.4121, 0.9247, 0.5316]),
    ("stdillum-F12", [1.7684, 0.8451, 0.2708]),
];

/// eta of copper, k of copper: pbrt's metal where nothing is said.
pub(super) const COPPER: (Rgb, Rgb) = (METALS[3].1, METALS[3].2);

fn named(name: &str) -> Option<Rgb> {
    if let Some(metal) = name.strip_prefix("metal-") {
        let (metal, eta) = match metal.strip_suffix("-eta") {
            Some(metal) => (metal, true),
            None => (metal.strip_suffix("-k")?, false),
        };
        return METALS
            .iter()
            .find(|(n, ..)| *n == metal)
            .map(|(_, e, k)| if eta { *e } else { *k });
    }
    if let Some(glass) = name.strip_prefix("glass-") {
        return GLASSES
            .iter()
            .find(|(n, _)| *n == glass)
            .map(|(_, ior)| [*ior; 3]);
    }
    ILLUMINANTS
        .iter()
        .find(|(n, _)| *n == name)
        .map(|(_, rgb)| *rgb)
}

impl Importer<'_, '_> {
    /// The spectrum of a parameter as a colour.
    pub(super) fn color(
        &mut self,
        params: &Params,
        param: &Param,
        role: Role,
    ) -> Result<Rgb, Issue> {
        match param.kind {
            Kind::Rgb => {
                let rgb = param.three()?;
                if rgb.iter().any(|&c| c < 0.0) {
                    return param.fail("has a negative component");
                }
                let rgb = params.space.to_rec709(rgb).map(|c| c as f32);
                if rgb.iter().any(|c| !c.is_finite()) {
                    return param.fail("has a number that is too large");
                }
                if role == Role::Albedo && rgb.iter().any(|&c| c > 1.0) {
                    self.cx.warn(
                        &param.place,
                        format!("{:?} has a component above 1: it is cut to 1", param.name),
                    );
                    return Ok(rgb.map(|c| c.min(1.0)));
                }
                Ok(rgb)
            }
            Kind::Blackbody => {
                let kelvin = param.one()?;
                match color::blackbody(kelvin).filter(|_| (100.0..=1e6).contains(&kelvin)) {
                    Some(rgb) => Ok(rgb),
                    None => param.fail(format!(
                        "has a temperature of {kelvin} K; 100 to 1000000 is meant"
                    )),
                }
            }
            Kind::Spectrum => match param.texts() {
                [name] => match named(name) {
                    Some(rgb) if role == Role::Albedo => Ok(rgb.map(|c| c.min(1.0))),
                    Some(rgb) => Ok(rgb),
                    None if name.contains('.') => {
                        let table = self.number_file(param, name)?;
                        self.tabulated(param, &table, role)
                    }
                    None => param.fail(format!("names the unknown spectrum {name:?}")),
                },
                [] => self.tabulated(param, param.numbers(), role),
                texts => param.fail(format!("needs one name, has {}", texts.len())),
            },
            _ => param.fail("is no spectrum"),
        }
    }

    /// The numbers of a text file, with comments after `#`.
    pub(super) fn number_file(&mut self, param: &Param, name: &str) -> Result<Vec<f64>, Issue> {
        let path = self.cx.path(&param.place, name)?;
        let bytes = self.cx.read(&param.place, &path)?;
        self.cx.release(bytes.len() as u64);
        let text = std::str::from_utf8(&bytes)
            .map_err(|_| Issue::new(&param.place, format!("{path}: not text")))?;
        let mut table = Vec::new();
        for line in text
            .lines()
            .map(|line| line.split('#').next().unwrap_or_default())
        {
            for word in line.split_ascii_whitespace() {
                match word.parse::<f64>() {
                    Ok(value) if value.is_finite() => table.push(value),
                    _ => {
                        return Err(Issue::new(
                            &param.place,
                            format!("{path}: {word:?} is no number"),
                        ));
                    }
                }
            }
        }
        Ok(table)
    }

    /// Pairs of wavelength and value.
    fn tabulated(&mut self, param: &Param, pairs: &[f64], role: Role) -> Result<Rgb, Issue> {
        let (rows, rest) = pairs.as_chunks::<2>();
        if rows.is_empty() || !rest.is_empty() {
            return param.fail("needs pairs of a wavelength and a value");
        }
        let table: Vec<(f64, f64)> = rows.iter().map(|&[l, v]| (l, v)).collect();
        if table.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return param.fail("has wavelengths that do not rise");
        }
        if table.iter().any(|&(_, v)| v < 0.0) {
            return param.fail("has a negative value");
        }
        let spectrum = |lambda: f64| color::interpolate(&table, lambda);
        match role {
            Role::Emission => Ok(color::emission_hue(spectrum).unwrap_or([0.0; 3])),
            Role::Albedo => Ok(color::weighted(spectrum).map(|c| c.min(1.0))),
            Role::Unbounded => Ok(color::weighted(spectrum)),
        }
    }

    /// An emission colour times a factor, black where the parameter is absent: none.
    pub(super) fn emission(&mut self, params: &Params, name: &str) -> Result<Option<Rgb>, Issue> {
        match params.find(name, &SPECTRUM)? {
            Some(param) => self.color(params, param, Role::Emission).map(Some),
            None => Ok(None),
        }
    }

    /// One index of refraction: a number, or the mean of a spectrum, in which case dispersion is lost.
    pub(super) fn ior(&mut self, params: &Params, name: &str) -> Result<f32, Issue> {
        let kinds = [Kind::Float, Kind::Rgb, Kind::Blackbody, Kind::Spectrum];
        let Some(param) = params.find(name, &kinds)? else {
            return Ok(1.5);
        };
        let ior = if param.kind == Kind::Float {
            param.one()? as f32
        } else {
            let rgb = self.color(params, param, Role::Unbounded)?;
            self.cx.warn(
                &param.place,
                format!("{name:?} varies with the wavelength: one index of refraction stands for all, without dispersion"),
            );
            (rgb[0] + rgb[1] + rgb[2]) / 3.0
        };
        if !(0.01..=100.0).contains(&ior) {
            return param.fail(format!("is an index of refraction of {ior}"));
        }
        Ok(ior)
    }
}
