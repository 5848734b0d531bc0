//! Identification off line: samples in, estimates out, by the very node that the identifier runs.

use crate::linear::LinearModel;
use crate::{ThetabusError, bytes};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use thetabus::config::{Catalog, Config, ConfigError, Source};
use thetabus::messages::{Message as _, Sample};
use thetabus::node::model::SharedModel;

/// Description, estimates and last status.
struct Outcome {
    description: Vec<u8>,
    estimates: Vec<u8>,
    status: Vec<u8>,
}

/// The same for Python.
type Handed<'py> = (Bound<'py, PyBytes>, Bound<'py, PyBytes>, Bound<'py, PyBytes>);

impl Outcome {
    fn handed_over<'py>(&self, py: Python<'py>) -> Handed<'py> {
        (
            PyBytes::new(py, &self.description),
            PyBytes::new(py, &self.estimates),
            PyBytes::new(py, &self.status),
        )
    }
}

/// The models that a program in Python does not have: those of robots from a URDF, and a Rust
/// program's own.
const OTHER_MODELS: &str = "thetabus.identify has no such model: robots from a URDF are identified by the command `thetabus identify \
     RECORDING|LOG.csv --config ROBOT.toml`, and a model of your own by its own program";

/// Errors of a configuration in words. If it is for a model that is not available here, only that is
/// said: every key of that model would be unknown.
fn in_words(error: &ConfigError) -> String {
    let of_kind: Vec<String> = error
        .problems
        .iter()
        .filter(|problem| problem.key == "model.kind")
        .map(|problem| format!("{problem}; {OTHER_MODELS}"))
        .collect();
    match of_kind.is_empty() {
        true => error.to_string(),
        false => of_kind.join("\n"),
    }
}

fn run(catalog: &Catalog, sources: &[Source], arguments: &[String], samples: &[u8]) -> Result<Outcome, String> {
    let config = Config::load_for(catalog, sources, arguments).map_err(|e| in_words(&e))?;
    config.limit_recorded_memory().map_err(|e| e.to_string())?;
    let mut node = config.identifier().map_err(|e| e.to_string())?;
    let mut estimates = Vec::new();
    for chunk in samples.chunks_exact(Sample::LAYOUT.size) {
        let sample = bytes::read(chunk).map_err(|e| format!("{e:?}"))?;
        node.on_sample(&sample, &mut |estimate| bytes::append(&mut estimates, *estimate));
    }
    Ok(Outcome {
        description: bytes::of(config.description()),
        estimates,
        status: bytes::of(node.status()),
    })
}

/// Identifies samples, given as bytes behind each other, with a file or the text of a recorded
/// configuration, and overrides `section.key=value`.
#[pyfunction]
pub(crate) fn identify<'py>(
    py: Python<'py>,
    file: Option<PathBuf>,
    recorded: Option<String>,
    overrides: Vec<String>,
    samples: &[u8],
) -> PyResult<Handed<'py>> {
    let mut sources = Vec::new();
    if let Some(text) = recorded {
        let name = "the configuration in the recording".to_owned();
        sources.push(Source::Recorded { name, text });
    }
    sources.extend(file.map(Source::File));
    if sources.is_empty() {
        return Err(PyValueError::new_err("config: arrays need a configuration file"));
    }
    let outcome = py
        .detach(|| run(&Catalog::default(), &sources, &overrides, samples))
        .map_err(ThetabusError::new_err)?;
    Ok(outcome.handed_over(py))
}

/// What a program with a plant of its own starts from, as far as it holds for rows that are given.
const LINEAR: &str = "[identifier]\nrows = \"pointwise\"\n\n[estimator]\nnoise_floor = []\n";

/// Identifies a machine that is linear in its parameters (name, unit, start), from rows: `phi` and
/// `y` in bytes, with `equations` rows per sample. `file` and `overrides` may set what the
/// estimator does.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the parts of a model, by name")]
pub(crate) fn identify_linear<'py>(
    py: Python<'py>,
    parameters: Vec<(String, String, f64)>,
    y_unit: String,
    equations: usize,
    phi: &[u8],
    y: &[u8],
    file: Option<PathBuf>,
    overrides: Vec<String>,
    samples: &[u8],
) -> PyResult<Handed<'py>> {
    let sources: Vec<Source> = Config::embedded("own_plant")
        .into_iter()
        .chain([Source::Embedded {
            name: "built-in settings of linear machines".to_owned(),
            text: LINEAR.to_owned(),
        }])
        .chain(file.map(Source::File))
        .collect();
    let model =
        LinearModel::new(parameters, y_unit, equations, numbers(phi), numbers(y)).map_err(PyValueError::new_err)?;
    let catalog = Catalog::default().with_model(SharedModel::new(model));
    let outcome = py
        .detach(|| run(&catalog, &sources, &overrides, samples))
        .map_err(ThetabusError::new_err)?;
    Ok(outcome.handed_over(py))
}

fn numbers(bytes: &[u8]) -> Vec<f64> {
    let (numbers, _) = bytes.as_chunks::<8>();
    numbers.iter().map(|number| f64::from_ne_bytes(*number)).collect()
}
