//! Runs a computation with the GIL released, on the requested threads, so that Ctrl-C works.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use cgroup::execution::DEFAULT_MAX_MEMORY;
use cgroup::{Error, Execution};
use pyo3::prelude::*;
use rayon::ThreadPoolBuildError;

use crate::background::{Failure, compute, give_back, take_pool};
use crate::error::{CgroupError, OutOfMemoryError, to_python};

/// Options of a run; read from a `cgroup._checks.run_options.RunOptions`.
#[derive(FromPyObject)]
pub struct RunOptions {
    threads: Option<usize>,
    max_memory: usize,
    progress: Option<Py<PyAny>>,
    max_seconds: Option<f64>,
}

impl RunOptions {
    /// One thread, without reports of progress.
    pub fn single() -> Self {
        Self { threads: Some(1), max_memory: DEFAULT_MAX_MEMORY, progress: None, max_seconds: None }
    }

    /// Time at which a search that supports it has to end early; `None` if never.
    fn deadline(&self) -> Option<Instant> {
        Instant::now().checked_add(Duration::try_from_secs_f64(self.max_seconds?).ok()?)
    }

    fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
    }
}

/// Runs `work` on a pool of the requested threads, and returns its result.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    options: &RunOptions,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    let threads = options.threads();
    let pool = take_pool(threads).map_err(|error| too_few_threads(threads, &error))?;
    let execution = Arc::new(Execution::new(options.max_memory));
    let look_around = || Python::attach(|py| look_around(py, options, &execution));
    match py.detach(|| compute(&pool, &execution, options.deadline(), work, look_around)) {
        Err(Failure::Interrupted(signal)) => Err(signal),
        Err(Failure::Lost) => Err(internal_error()),
        Err(Failure::Panicked) => {
            give_back(pool);
            Err(internal_error())
        }
        Ok(outcome) => {
            give_back(pool);
            outcome.map_err(|error| to_python(&error))
        }
    }
}

/// Runs `work`, which takes microseconds, on the calling thread with the GIL released.
pub fn run_inline<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let outcome = py.detach(|| catch_unwind(AssertUnwindSafe(|| work(&Execution::default()))));
    outcome.map_err(|_| internal_error())?.map_err(|error| to_python(&error))
}

fn too_few_threads(threads: usize, error: &ThreadPoolBuildError) -> PyErr {
    let instead = if threads > 1 { "give threads=1, or " } else { "" };
    OutOfMemoryError::new_err(format!(
        "the system does not start {threads} thread{} ({error}); {instead}allow the process more threads or more memory",
        if threads > 1 { "s" } else { "" }
    ))
}

fn internal_error() -> PyErr {
    CgroupError::new_err("the computation failed inside cgroup; please report this with the input")
}

/// Raises a pending signal, and reports the progress to the caller.
fn look_around(py: Python<'_>, options: &RunOptions, execution: &Execution) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = &options.progress {
        progress.call1(py, (execution.progress(),))?;
    }
    Ok(())
}
