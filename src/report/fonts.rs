//! The font of figures and pages, built in.

/// Families by preference; the first is embedded in the program and in the page.
pub(super) const FONT: &str = "Roboto, 'Helvetica Neue', Arial, sans-serif";
/// For text.
pub(super) const REGULAR: &[u8] = include_bytes!("../../assets/fonts/Roboto-Regular-subset.ttf");
/// For titles.
pub(super) const MEDIUM: &[u8] = include_bytes!("../../assets/fonts/Roboto-Medium-subset.ttf");
