//! The native part of the Python package `thetabus`: ports on the bus, and messages as bytes.
//! Everything that a user sees is in `python/thetabus`.

mod bytes;
mod confined;
mod control;
mod controller;
mod identify;
mod linear;
mod machine;
mod reader;
mod recording;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;
use std::time::Duration;
use thetabus::bus::BusError;
use thetabus::messages::{Kind, Layout, Per, SCHEMA_VERSION, layouts};

pyo3::create_exception!(
    _thetabus,
    ThetabusError,
    PyRuntimeError,
    "Something on the bus went wrong: the message says which topic, what was expected and what to do."
);

pub(crate) fn failed(error: BusError) -> PyErr {
    match error {
        BusError::Machine { problem } => PyValueError::new_err(problem),
        error => ThetabusError::new_err(error.to_string()),
    }
}

pub(crate) fn closed() -> PyErr {
    PyValueError::new_err("it is closed")
}

/// A limit in seconds; `None` for ever.
pub(crate) fn limit(seconds: Option<f64>) -> PyResult<Duration> {
    match seconds {
        None => Ok(Duration::MAX),
        Some(seconds) if seconds >= 0.0 => Ok(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)),
        Some(other) => Err(PyValueError::new_err(format!(
            "timeout: expected seconds from 0 or None, got {other}"
        ))),
    }
}

/// One table of fields: name, type name, size, and per field name, numpy type or the inner table,
/// length or None, what it runs over, unit, meaning, offset.
fn table<'py>(py: Python<'py>, layout: &'static Layout) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyList::empty(py);
    for field in layout.fields {
        let kind = match field.kind {
            Kind::U8 if field.per == Per::Text => format!("S{}", field.len).into_pyobject(py)?.into_any(),
            Kind::U8 => "u1".into_pyobject(py)?.into_any(),
            Kind::U32 => "u4".into_pyobject(py)?.into_any(),
            Kind::U64 => "u8".into_pyobject(py)?.into_any(),
            Kind::F64 => "f8".into_pyobject(py)?.into_any(),
            Kind::Struct(inner) => table(py, inner)?,
        };
        let len = (field.is_array && field.per != Per::Text).then_some(field.len);
        let per = format!("{:?}", field.per).to_lowercase();
        let entry = (field.name, kind, len, per, field.unit, field.meaning, field.offset);
        fields.append(entry.into_pyobject(py)?)?;
    }
    let table = (layout.name, layout.type_name, layout.size, fields);
    Ok(table.into_pyobject(py)?.into_any())
}

/// The tables of fields of all messages.
#[pyfunction]
fn tables(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyAny>>> {
    layouts().into_iter().map(|layout| table(py, layout)).collect()
}

/// CLOCK_MONOTONIC in ns, the clock of a machine's samples.
#[pyfunction]
fn monotonic_ns() -> u64 {
    thetabus::bus::monotonic_ns()
}

#[pymodule]
fn _thetabus(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("ThetabusError", module.py().get_type::<ThetabusError>())?;
    module.add("SCHEMA_VERSION", SCHEMA_VERSION)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(tables, module)?)?;
    module.add_function(wrap_pyfunction!(monotonic_ns, module)?)?;
    module.add_function(wrap_pyfunction!(recording::recording, module)?)?;
    module.add_function(wrap_pyfunction!(identify::identify, module)?)?;
    module.add_function(wrap_pyfunction!(identify::identify_linear, module)?)?;
    module.add_class::<reader::Reader>()?;
    module.add_class::<machine::Machine>()?;
    module.add_class::<control::Control>()?;
    module.add_class::<controller::Controller>()?;
    Ok(())
}
