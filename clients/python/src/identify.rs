//! Identification off line: samples in, estimates out, by the very node that the identifier runs.

use crate::{ThetabusError, bytes};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use thetabus::config::{Config, Source};
use thetabus::messages::{Message as _, Sample};

/// Description, estimates and last status.
struct Outcome {
    description: Vec<u8>,
    estimates: Vec<u8>,
    status: Vec<u8>,
}

fn run(sources: &[Source], arguments: &[String], samples: &[u8]) -> Result<Outcome, String> {
    let config = Config::load(sources, arguments).map_err(|e| e.to_string())?;
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

/// Identifies samples, given as bytes behind each other, with a file or the text of a recorded configuration, and overrides `section.key=value`.
#[pyfunction]
pub(crate) fn identify<'py>(
    py: Python<'py>,
    file: Option<PathBuf>,
    recorded: Option<String>,
    overrides: Vec<String>,
    samples: &[u8],
) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>, Bound<'py, PyBytes>)> {
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
        .detach(|| run(&sources, &overrides, samples))
        .map_err(ThetabusError::new_err)?;
    Ok((
        PyBytes::new(py, &outcome.description),
        PyBytes::new(py, &outcome.estimates),
        PyBytes::new(py, &outcome.status),
    ))
}
