//! Tables and figures from estimates: the result table, figures as SVG and, with feature `png`, as
//! PNG, and a self-contained page.

mod axes;
mod data;
mod figures;
mod fonts;
mod hover;
mod inputs;
mod labels;
mod layers;
mod page;
mod plot;
#[cfg(feature = "png")]
mod raster;
mod summary;
mod tracking;
mod words;

pub use data::{Inputs, Notes, RunData, Timing, Trace};
pub use figures::figures;
pub use page::page;
pub use plot::Figure;
#[cfg(feature = "png")]
pub use raster::{RasterError, png};
pub use summary::{ChangeSummary, DerivedSummary, ParameterSummary, SampleCounts, Summary};
pub use tracking::{TrackingPanel, tracking_figure};
pub use words::{DERIVED_USABLE, Known, Rounded, headline, pretty_unit, symbol, with_unit};

use crate::files;
use std::io;
use std::path::{Path, PathBuf};

/// Name of the page.
pub const REPORT_HTML: &str = "report.html";
/// Name of the directory with the figures.
pub const FIGURES: &str = "figures";
/// Files that may be next to the page, for its links.
const BESIDE: [&str; 4] = ["recording.mcap", "estimates.csv", "summary.json", "config.toml"];
#[cfg(feature = "png")]
/// Pixels of a PNG per unit of its SVG.
const PNG_SCALE: f32 = 2.0;

/// Writes `report.html` and `figures/NAME.svg` into a directory, with feature `png` also
/// `figures/NAME.png`; returns the path of the page. `look` is called with the share of the figures
/// written.
///
/// # Errors
/// If the directory cannot be written.
pub fn write_report(dir: &Path, run: &RunData, summary: &Summary, mut look: impl FnMut(f64)) -> io::Result<PathBuf> {
    let figures = figures(run);
    let figures_dir = dir.join(FIGURES);
    std::fs::create_dir_all(&figures_dir)?;
    for (index, figure) in figures.iter().enumerate() {
        look(index as f64 / figures.len() as f64);
        let svg = figure.svg();
        files::write(&figures_dir.join(&figure.name).with_extension("svg"), svg.as_bytes())?;
        #[cfg(feature = "png")]
        {
            let png = png(&svg, PNG_SCALE).map_err(io::Error::other)?;
            files::write(&figures_dir.join(&figure.name).with_extension("png"), &png)?;
        }
    }
    let path = dir.join(REPORT_HTML);
    let beside: Vec<&str> = BESIDE.into_iter().filter(|name| dir.join(name).exists()).collect();
    files::write(&path, page(run, summary, &figures, &beside).as_bytes())?;
    Ok(path)
}
