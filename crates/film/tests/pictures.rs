//! Picture files: the same bytes for the same film, and what readers find in them.

mod support;

use exr::prelude::*;
use film::layer::channel;
use film::{
    ENGINE_VERSION, Film, Layer, LayerSample, Look, PictureInfo, Receipt, SampleRange, TileGrid,
    ToneMap, Unit, UnitResult, write_exr, write_png,
};
use support::unit;

const GRID: TileGrid = TileGrid {
    width: 130,
    height: 70,
};

fn film(units: &[(u32, u32, u32)]) -> Film {
    let mut film = Film::new(GRID, 0);
    for &(tile, begin, end) in units {
        let samples = SampleRange { begin, end };
        merge(
            &mut film,
            unit(
                GRID,
                Unit {
                    frame: 0,
                    tile,
                    samples,
                },
            ),
        );
    }
    film
}

fn merge(film: &mut Film, result: UnitResult) {
    film.merge(
        &result,
        Receipt {
            digest: [0; 32],
            worker: "w".into(),
        },
    )
    .unwrap();
}

fn all_tiles(cuts: &[(u32, u32)]) -> Vec<(u32, u32, u32)> {
    (0..GRID.count())
        .flat_map(|t| cuts.iter().map(move |&(b, e)| (t, b, e)))
        .collect()
}

fn info(film: &Film) -> PictureInfo {
    PictureInfo::of(film, 7, "1.2.3", true)
}

#[test]
fn the_same_film_is_the_same_files() {
    let straight = film(&all_tiles(&[(0, 1), (1, 2), (2, 4)]));
    let mut units = all_tiles(&[(3, 4), (2, 3), (1, 2), (0, 1)]);
    units.reverse();
    units.swap(3, 9);
    let shuffled = film(&units);
    let exr = write_exr(&straight, &info(&straight)).unwrap();
    for _ in 0..3 {
        assert_eq!(write_exr(&shuffled, &info(&shuffled)).unwrap(), exr);
    }
    for layer in Layer::ALL {
        let look = Look {
            layer,
            ..Look::default()
        };
        let png = write_png(&straight, look, &info(&straight)).unwrap();
        assert_eq!(write_png(&shuffled, look, &info(&shuffled)).unwrap(), png);
    }
}

#[test]
fn exr_says_what_it_is() {
    let film = film(&all_tiles(&[(0, 1), (1, 2)]));
    let bytes = write_exr(&film, &info(&film)).unwrap();
    let image = read_all_flat_layers_from_file_bytes(&bytes);
    assert_eq!(image.layer_data.len(), 1);
    let part = &image.layer_data[0];
    let names: Vec<String> = part
        .channel_data
        .list
        .iter()
        .map(|c| c.name.to_string())
        .collect();
    assert_eq!(
        names.join(" "),
        "A B G R albedo.B albedo.G albedo.R depth.Z normal.X normal.Y normal.Z samples.N \
         variance.B variance.G variance.R"
    );
    for (name, layer, c) in [
        ("G", Layer::Beauty, 1),
        ("depth.Z", Layer::Depth, 0),
        ("variance.R", Layer::Variance, 0),
    ] {
        let found = part
            .channel_data
            .list
            .iter()
            .find(|c| c.name == *name)
            .unwrap();
        let FlatSamples::F32(values) = &found.sample_data else {
            panic!("{name} is not float")
        };
        assert_eq!(*values, channel(&film, layer, c), "{name}");
    }
    assert_eq!(
        image.attributes.chromaticities.unwrap().green,
        Vec2(0.30, 0.60)
    );
    let text = |name: &str| match part.attributes.other.get(&Text::from(name)) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(text("brolly.digest"), film::output::hex(&film.digest()));
    assert_eq!(
        (text("brolly.spp"), text("brolly.seed")),
        ("2".into(), "7".into())
    );
    assert_eq!(
        (text("Software"), text("brolly.biased")),
        ("Brolly 1.2.3".into(), "true".into())
    );
    assert_eq!(text("brolly.error_kind"), "estimate");
    assert!(text("brolly.error").parse::<f64>().unwrap() > 0.0);
}

fn read_all_flat_layers_from_file_bytes(bytes: &[u8]) -> FlatImage {
    let reader = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels();
    reader
        .all_layers()
        .all_attributes()
        .from_buffered(std::io::Cursor::new(bytes))
        .unwrap()
}

fn decode_png(bytes: &[u8]) -> (png::OutputInfo, Vec<u8>, Vec<(String, String)>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
        .read_info()
        .unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut data).unwrap();
    let texts = &reader.info().uncompressed_latin1_text;
    let texts = texts
        .iter()
        .map(|t| (t.keyword.clone(), t.text.clone()))
        .collect();
    (info, data, texts)
}

#[test]
fn unfinished_parts_are_transparent() {
    let film = film(&[(1, 0, 1)]);
    let bytes = write_png(&film, Look::default(), &info(&film)).unwrap();
    let (shape, data, texts) = decode_png(&bytes);
    assert_eq!(
        (shape.color_type, shape.width, shape.height),
        (png::ColorType::Rgba, 130, 70)
    );
    assert_eq!(data[..4], [0; 4]);
    assert_eq!(data[64 * 4 + 3], 255);
    let get = |name: &str| texts.iter().find(|t| t.0 == name).map(|t| t.1.clone());
    assert_eq!(get("brolly.spp"), Some("0-1".into()));
    assert_eq!(
        (get("brolly.error"), get("brolly.engine")),
        (None, Some(ENGINE_VERSION.to_string()))
    );
    let look = Look {
        layer: Layer::Error,
        ..Look::default()
    };
    let (_, data, _) = decode_png(&write_png(&film, look, &info(&film)).unwrap());
    assert!(
        data.iter().all(|&byte| byte == 255),
        "an unknown error is white"
    );
    write_exr(&Film::new(GRID, 0), &info(&Film::new(GRID, 0))).unwrap();
}

/// A grid of one pixel with the mean of the given samples.
fn one_pixel(samples: &[LayerSample]) -> Film {
    let grid = TileGrid {
        width: 1,
        height: 1,
    };
    let mut film = Film::new(grid, 0);
    for (index, sample) in (0..).zip(samples) {
        let samples = SampleRange {
            begin: index,
            end: index + 1,
        };
        let mut one = unit(
            grid,
            Unit {
                frame: 0,
                tile: 0,
                samples,
            },
        );
        one.buffer = film::SampleBuffer::new(grid.tile(0), samples);
        one.buffer.add(0, 0, index, sample).unwrap();
        merge(&mut film, one);
    }
    film
}

#[test]
fn means_are_what_was_added() {
    let hit = LayerSample {
        beauty: [1.0, 0.5, 0.25],
        alpha: 1.0,
        albedo: [0.5, 0.25, 1.0],
        normal: [0.0, 0.0, 1.0],
        depth: 3.0,
    };
    let film = one_pixel(&[hit, LayerSample::EMPTY, hit, LayerSample::EMPTY]);
    let get = |layer, c| channel(&film, layer, c)[0];
    assert_eq!([0, 1, 2].map(|c| get(Layer::Beauty, c)), [0.5, 0.25, 0.125]);
    assert_eq!((get(Layer::Alpha, 0), get(Layer::Depth, 0)), (0.5, 3.0));
    assert_eq!((get(Layer::Samples, 0), get(Layer::Normal, 2)), (4.0, 0.5));
    assert_eq!(get(Layer::Variance, 0), 1.0 / 12.0);
    // PNG alpha is not premultiplied.
    let (_, data, _) = decode_png(&write_png(&film, Look::default(), &info(&film)).unwrap());
    assert_eq!(data, [255, 188, 137, 128]);
    let nothing = one_pixel(&[LayerSample::EMPTY]);
    assert_eq!(channel(&nothing, Layer::Depth, 0), [f32::INFINITY]);
}

#[test]
fn exposure_and_curves() {
    let grey = LayerSample {
        beauty: [0.25; 3],
        alpha: 1.0,
        ..LayerSample::EMPTY
    };
    let film = one_pixel(&[grey]);
    let byte = |exposure, tonemap| {
        let look = Look {
            exposure,
            tonemap,
            ..Look::default()
        };
        let (shape, data, _) = decode_png(&write_png(&film, look, &info(&film)).unwrap());
        assert_eq!(shape.color_type, png::ColorType::Rgb);
        data[0]
    };
    assert_eq!(byte(0.0, ToneMap::None), 137);
    assert_eq!(byte(1.0, ToneMap::None), 188);
    assert_eq!(byte(2.0, ToneMap::None), 255);
    assert_eq!(byte(2.0, ToneMap::Reinhard), 188);
    assert!(byte(2.0, ToneMap::Aces) < 255 && byte(2.0, ToneMap::Filmic) < 255);
}
