//! Runs a computation with the GIL released, on the threads asked for, so that Ctrl-C is heard.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cgroup::{Error, Execution};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{CgroupError, InputError, to_python};

/// Time between two looks for a signal.
const POLL: Duration = Duration::from_millis(50);

/// Time that an interrupted computation gets to end by itself before it is left to end in the background.
const GRACE: Duration = Duration::from_millis(500);

/// Pools by process and number of threads.
type Pools = HashMap<(u32, usize), Arc<ThreadPool>>;

/// How the caller wants a computation to run; read from a `cgroup.types.RunOptions`.
#[derive(FromPyObject)]
pub struct RunOptions {
    threads: Option<usize>,
    max_memory: usize,
    progress: Option<Py<PyAny>>,
}

/// Runs `work` on a pool of the threads asked for, and returns what it returns.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    options: &RunOptions,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    let pool = pool(options.threads)?;
    let execution = Arc::new(Execution::new(options.max_memory));
    let (sender, receiver) = channel();
    let shared = Arc::clone(&execution);
    pool.spawn(move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(&shared)));
        // The receiver is gone where the caller was interrupted and did not wait.
        drop(sender.send(outcome));
    });
    let watched = &execution;
    let outcome = py.detach(move || {
        loop {
            match receiver.recv_timeout(POLL) {
                Ok(outcome) => return Ok(outcome),
                Err(RecvTimeoutError::Disconnected) => return Err(None),
                Err(RecvTimeoutError::Timeout) => {
                    if let Err(signal) = Python::attach(|py| look_around(py, options, watched)) {
                        watched.interrupt();
                        drop(receiver.recv_timeout(GRACE));
                        return Err(Some(signal));
                    }
                }
            }
        }
    });
    match outcome {
        Ok(Ok(result)) => result.map_err(|error| to_python(&error)),
        Err(Some(signal)) => Err(signal),
        Ok(Err(_)) | Err(None) => Err(CgroupError::new_err(
            "the computation failed inside cgroup; please report this with the input",
        )),
    }
}

/// Raises a pending signal, and tells the caller how far the work is.
fn look_around(py: Python<'_>, options: &RunOptions, execution: &Execution) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = &options.progress {
        progress.call1(py, (execution.progress(),))?;
    }
    Ok(())
}

/// The pool of that many threads; one is kept for each number, and for each process, as threads do not
/// survive a fork.
fn pool(threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    static POOLS: Mutex<Option<Pools>> = Mutex::new(None);
    let threads = match threads {
        Some(0) => return Err(InputError::new_err("threads: got 0; give at least 1, or None for all cores")),
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let mut guard = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let pools = guard.get_or_insert_default();
    let key = (std::process::id(), threads);
    if let Some(pool) = pools.get(&key) {
        return Ok(Arc::clone(pool));
    }
    let builder = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("cgroup-{i}"));
    let failed = |error| CgroupError::new_err(format!("threads: could not start {threads} threads: {error}"));
    let pool = Arc::new(builder.build().map_err(failed)?);
    pools.insert(key, Arc::clone(&pool));
    Ok(pool)
}
