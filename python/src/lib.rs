//! The native half of the Python package: texels as arrays, and commands run inside the Python process.

mod texel;

use numpy::{IntoPyArray, PyArray3};
use pyo3::exceptions::{PyKeyError, PyOSError, PyValueError};
use pyo3::prelude::*;

pyo3::create_exception!(
    vtex,
    Error,
    pyo3::exceptions::PyException,
    "A source, a texel or a landscape is not as it must be."
);

/// The Python exception for an error of the library: `OSError`s for the system's, `ValueError` for options, else [`Error`].
fn raised(error: vtex::Error) -> PyErr {
    match &error {
        vtex::Error::Io { path, source } => match source.raw_os_error() {
            // With a number Python picks the class: FileNotFoundError, PermissionError …
            Some(number) => PyOSError::new_err((number, without_number(source), path.display().to_string())),
            None => PyOSError::new_err(error.to_string()),
        },
        vtex::Error::Options(text) => PyValueError::new_err(text.trim_start_matches("error: ").trim_end().to_owned()),
        _ => Error::new_err(error.to_string()),
    }
}

/// What the system said, without the number that Rust puts behind it.
fn without_number(source: &std::io::Error) -> String {
    let text = source.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_owned()
}

/// Run a command of `vtex`, given as its words; returns what it would print. Other Python threads run meanwhile.
#[pyfunction]
fn run(py: Python<'_>, words: Vec<String>) -> PyResult<String> {
    py.detach(|| vtex::cli::run_inside(&words)).map_err(raised)
}

/// A picture file (EXR, PNG, …) as float32 (height, width, 4): linear Rec. 709 radiance and coverage.
#[pyfunction]
fn read_picture(py: Python<'_>, path: std::path::PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let image = py.detach(|| vtex::render::image_io::read(&path)).map_err(raised)?;
    let (height, width) = (image.height, image.width);
    let flat: Vec<f32> = image.rgba.into_iter().flatten().collect();
    Ok(numpy::ndarray::Array3::from_shape_vec((height, width, 4), flat)
        .map_err(|e| PyValueError::new_err(e.to_string()))?
        .into_pyarray(py))
}

/// The error for a channel that does not exist.
fn no_channel(name: &str) -> PyErr {
    PyKeyError::new_err(format!("{name}: the channels are {}", texel::CHANNELS.join(", ")))
}

#[pymodule]
fn _vtex(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<Error>())?;
    module.add("CHANNELS", texel::CHANNELS.to_vec())?;
    module.add_class::<texel::Texel>()?;
    module.add_class::<texel::Depth>()?;
    module.add_function(wrap_pyfunction!(run, module)?)?;
    module.add_function(wrap_pyfunction!(read_picture, module)?)?;
    Ok(())
}
