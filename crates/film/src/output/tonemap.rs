//! From scene light to display light. Plain clipping is the default; the curves are for looking.

use crate::layer::UnknownName;

/// A curve from [0, inf) to [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ToneMap {
    /// Clip at 1.
    #[default]
    None,
    /// Film-like shoulder and toe: J. Hable, *Uncharted 2: HDR Lighting*, GDC 2010, white at 11.2.
    Filmic,
    /// Like the ACES display transform: K. Narkowicz' rational fit of 2016.
    Aces,
    /// x / (1 + x): Reinhard et al., *Photographic Tone Reproduction*, 2002, equation 3.
    Reinhard,
}

impl ToneMap {
    /// All of them.
    pub const ALL: [ToneMap; 4] = [
        ToneMap::None,
        ToneMap::Filmic,
        ToneMap::Aces,
        ToneMap::Reinhard,
    ];

    /// As in addresses.
    pub fn name(self) -> &'static str {
        match self {
            ToneMap::None => "none",
            ToneMap::Filmic => "filmic",
            ToneMap::Aces => "aces",
            ToneMap::Reinhard => "reinhard",
        }
    }

    /// Of one channel.
    pub fn apply(self, x: f32) -> f32 {
        let x = x.clamp(0.0, 1e6); // NaN stays; the byte encoder makes it 0
        let mapped = match self {
            ToneMap::None => x,
            ToneMap::Filmic => hable(2.0 * x) / hable(11.2),
            ToneMap::Aces => x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14),
            ToneMap::Reinhard => x / (1.0 + x),
        };
        mapped.clamp(0.0, 1.0)
    }
}

/// (x(Ax + CB) + DE) / (x(Ax + B) + DF) - E/F with shoulder A, linear B, C and toe D, E, F.
fn hable(x: f32) -> f32 {
    const A: f32 = 0.15;
    const B: f32 = 0.5;
    const C: f32 = 0.1;
    const D: f32 = 0.2;
    const E: f32 = 0.02;
    const F: f32 = 0.3;
    (x * (A * x + C * B) + D * E) / (x * (A * x + B) + D * F) - E / F
}

impl std::fmt::Display for ToneMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for ToneMap {
    type Err = UnknownName;
    fn from_str(name: &str) -> Result<ToneMap, UnknownName> {
        ToneMap::ALL
            .into_iter()
            .find(|map| map.name() == name)
            .ok_or_else(|| UnknownName::new(name, &ToneMap::ALL.map(ToneMap::name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white() {
        for map in ToneMap::ALL {
            assert_eq!(map.name().parse(), Ok(map));
            assert!(
                map.apply(0.0) < 1e-6 && map.apply(f32::INFINITY) > 0.99,
                "{map}"
            );
            let values: Vec<f32> = (0..400).map(|i| map.apply(i as f32 * 0.05)).collect();
            assert!(values.is_sorted(), "{map}");
        }
        let error = "agx".parse::<ToneMap>().unwrap_err().to_string();
        assert_eq!(error, "'agx' is not one of none, filmic, aces, reinhard");
    }
}
