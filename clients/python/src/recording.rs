//! Recordings as bytes of messages.

use crate::{ThetabusError, bytes};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use thetabus::node::monitor::Label;
use thetabus::recording::{Entry, ReadError, RecordingReader, RunInfo, Span};

/// Everything of a recording, message behind message.
struct Content {
    info: RunInfo,
    samples: Vec<u8>,
    estimates: Vec<u8>,
    statuses: Vec<u8>,
    loss: Option<String>,
}

fn read(path: &std::path::Path, span: Span) -> Result<Content, ReadError> {
    let mut reader = RecordingReader::open(path, span)?;
    let mut content = Content {
        info: reader.info().clone(),
        samples: Vec::new(),
        estimates: Vec::new(),
        statuses: Vec::new(),
        loss: None,
    };
    while let Some(entry) = reader.next_entry()? {
        match entry {
            Entry::Sample { sample, .. } => bytes::append(&mut content.samples, *sample),
            Entry::Estimate { estimate, .. } => bytes::append(&mut content.estimates, *estimate),
            Entry::Status { status, .. } => bytes::append(&mut content.statuses, *status),
            Entry::Recorder(_) => {}
        }
    }
    let loss = reader.loss();
    content.loss = (loss != Default::default()).then(|| loss.to_string());
    Ok(content)
}

/// The run, and samples, estimates and status behind each other.
type Parts<'py> = (
    Bound<'py, PyDict>,
    Bound<'py, PyBytes>,
    Bound<'py, PyBytes>,
    Bound<'py, PyBytes>,
);

/// What was recorded: a dictionary of the run, and samples, estimates and status as bytes.
#[pyfunction]
pub(crate) fn recording<'py>(py: Python<'py>, path: PathBuf, from_ns: u64, to_ns: u64) -> PyResult<Parts<'py>> {
    let content = py
        .detach(|| read(&path, Span { from_ns, to_ns }))
        .map_err(|e| ThetabusError::new_err(e.to_string()))?;
    let run = &content.info;
    let labels = |labels: &[Label]| -> Vec<(String, String)> {
        labels.iter().map(|l| (l.name.clone(), l.unit.clone())).collect()
    };
    let info = PyDict::new(py);
    info.set_item("robot", &run.robot)?;
    info.set_item("model", &run.model)?;
    info.set_item("model_hash", run.model_hash)?;
    info.set_item("config_hash", run.config_hash)?;
    info.set_item("simulated", run.simulated)?;
    info.set_item("config", &run.config_toml)?;
    info.set_item("joints", run.joints)?;
    info.set_item("position_unit", &run.position_unit)?;
    info.set_item("input_unit", &run.input_unit)?;
    info.set_item("equations", run.equations.clone())?;
    info.set_item("parameters", labels(&run.parameters))?;
    info.set_item("derived", labels(&run.derived))?;
    info.set_item("loss", content.loss)?;
    Ok((
        info,
        PyBytes::new(py, &content.samples),
        PyBytes::new(py, &content.estimates),
        PyBytes::new(py, &content.statuses),
    ))
}
