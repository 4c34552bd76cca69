//! Pictures: textures and light maps, and the files that `brolly compare` takes.

use scene::model::Encoding;
use tracer::texture::image::Image;

/// A picture of a scene: its header is checked where the scene is read, its pixels where the scene
/// is prepared. The name says TGA, which counts only where the content leaves the kind open.
pub fn picture(bytes: &[u8]) {
    const NAME: &str = "picture.tga";
    let Ok(info) = scene::picture::probe_bytes(NAME, bytes) else {
        return;
    };
    assert!(info.width.max(info.height) <= scene::limits::MAX_SIDE);
    let pixels = u64::from(info.width) * u64::from(info.height);
    assert!((1..=scene::limits::MAX_PIXELS).contains(&pixels));
    // Most of the time would go into clearing memory for pixels that are not there.
    if pixels > 1 << 22 {
        return;
    }
    if let Ok(image) = Image::decode(NAME, bytes, Encoding::Auto) {
        assert_eq!((image.width, image.height), (info.width, info.height));
        for (x, y) in [(0, 0), (image.width - 1, image.height - 1)] {
            let texel = image.texel(x as usize, y as usize);
            assert!(texel.iter().all(|v| v.is_finite()), "{texel:?}");
        }
    }
}

/// A picture that is compared with another one.
pub fn compared(bytes: &[u8]) {
    if let Ok(picture) = film::read_picture(bytes) {
        assert_eq!(picture.rgb.len(), picture.width * picture.height);
        // Never more than a picture of ours may have.
        assert!(picture.width.max(picture.height) <= 65_536);
    }
}
