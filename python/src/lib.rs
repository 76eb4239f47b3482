//! The library for Python: what `python/dynid` imports as `dynid._dynid`.
//!
//! Each class stands for a type of the library and holds it; results are handed on as the JSON that the program prints, of which the
//! Python side makes objects. Work is done without Python's lock (`work.rs`); errors are `dynid.Error` with the library's words.

mod arrays;
mod arrow;
mod device;
mod effect;
mod errors;
mod experiment;
mod given;
mod kernel;
mod model;
mod program;
mod residuals;
mod verbs;
mod work;

use pyo3::prelude::*;

/// What `python/dynid` is made of.
#[pymodule]
fn _dynid(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<errors::Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<device::Device>()?;
    module.add_class::<effect::Effect>()?;
    module.add_class::<experiment::Experiment>()?;
    module.add_class::<kernel::Kernel>()?;
    module.add_class::<model::Model>()?;
    module.add_class::<residuals::Residuals>()?;
    for function in [
        wrap_pyfunction!(arrow::columns_of, module)?,
        wrap_pyfunction!(arrow::names_in, module)?,
        wrap_pyfunction!(device::add_effects, module)?,
        wrap_pyfunction!(device::shipped, module)?,
        wrap_pyfunction!(device::tour, module)?,
        wrap_pyfunction!(program::main, module)?,
        wrap_pyfunction!(verbs::check, module)?,
        wrap_pyfunction!(verbs::compare, module)?,
        wrap_pyfunction!(verbs::diagnose, module)?,
        wrap_pyfunction!(verbs::fit, module)?,
        wrap_pyfunction!(verbs::ladder, module)?,
        wrap_pyfunction!(verbs::report, module)?,
        wrap_pyfunction!(verbs::simulate, module)?,
    ] {
        module.add_function(function)?;
    }
    Ok(())
}
