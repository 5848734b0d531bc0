//! Converts SVG to PNG with the embedded fonts only, independent of the system.

use super::fonts::{FONT, MEDIUM, REGULAR};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};
use std::sync::{Arc, LazyLock};

/// Why a figure cannot be turned into pixels.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RasterError {
    /// Not an SVG document.
    #[error("the figure is no SVG: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// Too large, or no area at all.
    #[error("a picture of {width} x {height} pixels cannot be made")]
    Size {
        /// Pixels.
        width: f32,
        /// Pixels.
        height: f32,
    },
    /// The PNG cannot be encoded.
    #[error("cannot encode the PNG: {0}")]
    Png(String),
}

static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(REGULAR.to_vec());
    fonts.load_font_data(MEDIUM.to_vec());
    fonts.set_sans_serif_family("Roboto");
    Arc::new(fonts)
});

/// Draws an SVG document at `scale` pixels per unit.
///
/// # Errors
/// If the text is not SVG, or the picture would be too large.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>, RasterError> {
    let options = Options {
        fontdb: FONTS.clone(),
        font_family: FONT.into(),
        ..Options::default()
    };
    let tree = Tree::from_str(svg, &options)?;
    let size = tree.size();
    let (width, height) = (size.width() * scale, size.height() * scale);
    let mut pixels =
        Pixmap::new(width.ceil() as u32, height.ceil() as u32).ok_or(RasterError::Size { width, height })?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| RasterError::Png(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_text_is_drawn_with_the_embedded_font_alone() {
        let svg = |text: &str| {
            format!(
                r##"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="40" font-family="{FONT}"><rect width="200" height="40" fill="#fff"/><text x="5" y="25">{text}</text></svg>"##
            )
        };
        let blank = png(&svg(""), 1.0).unwrap();
        assert_eq!(&blank[1..4], b"PNG");
        for text in ["mass", "θ₉", "10⁻³", "\u{2212}0.5"] {
            assert_ne!(png(&svg(text), 1.0).unwrap(), blank, "{text}");
        }
        assert!(png("<p>", 1.0).is_err());
    }
}
