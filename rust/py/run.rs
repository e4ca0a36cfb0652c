//! Runs a computation with the GIL released, on the threads asked for, so that Ctrl-C is heard.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use cgroup::{Error, Execution};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{CgroupError, to_python};

/// Time between two looks for a signal.
const POLL: Duration = Duration::from_millis(50);

/// Time that an interrupted computation gets to end by itself before it is left to end in the background.
const GRACE: Duration = Duration::from_millis(500);

/// Pools of this process; threads do not survive a fork, so each process has its own.
#[derive(Default)]
struct Pools {
    process: u32,
    /// Pools that callers share, by number of threads.
    shared: HashMap<usize, Arc<ThreadPool>>,
    /// Pools of one thread that nobody uses at the moment: callers who ask for one thread run side by side.
    single: Vec<Arc<ThreadPool>>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// Idle pools of one thread that are kept.
const MOST_IDLE: usize = 64;

/// How the caller wants a computation to run; read from a `cgroup.types.RunOptions`.
#[derive(FromPyObject)]
pub struct RunOptions {
    threads: Option<usize>,
    max_memory: usize,
    progress: Option<Py<PyAny>>,
    max_seconds: Option<f64>,
}

impl RunOptions {
    /// When a search that may end early has to, if that time will come.
    fn deadline(&self) -> Option<Instant> {
        Instant::now().checked_add(Duration::try_from_secs_f64(self.max_seconds?).ok()?)
    }
}

/// Runs `work` on a pool of the threads asked for, and returns what it returns.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    options: &RunOptions,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    let pool = take_pool(options.threads)?;
    let execution = Arc::new(Execution::new(options.max_memory));
    // Room for the one outcome is made now, when there is some; `channel` makes it, and for thirty more, on sending.
    let (sender, receiver) = sync_channel(1);
    let shared = Arc::clone(&execution);
    pool.spawn(move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(&shared)));
        // The receiver is gone where the caller was interrupted and did not wait.
        drop(sender.send(outcome));
    });
    let watched = &execution;
    let mut deadline = options.deadline();
    let outcome = py.detach(move || {
        loop {
            let left = deadline.map_or(POLL, |end| end.saturating_duration_since(Instant::now()));
            match receiver.recv_timeout(left.min(POLL)) {
                Ok(outcome) => return Ok(outcome),
                Err(RecvTimeoutError::Disconnected) => return Err(None),
                Err(RecvTimeoutError::Timeout) => {
                    if deadline.take_if(|end| *end <= Instant::now()).is_some() {
                        watched.stop();
                    }
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
        Ok(outcome) => {
            give_back(pool);
            result_of(outcome)
        }
        Err(Some(signal)) => Err(signal),
        Err(None) => Err(internal_error()),
    }
}

/// Runs `work`, which takes microseconds, on the calling thread with the GIL released.
pub fn run_inline<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send,
) -> PyResult<T> {
    result_of(py.detach(|| catch_unwind(AssertUnwindSafe(|| work(&Execution::default())))))
}

fn result_of<T>(outcome: std::thread::Result<Result<T, Error>>) -> PyResult<T> {
    outcome.map_err(|_| internal_error())?.map_err(|error| to_python(&error))
}

fn internal_error() -> PyErr {
    CgroupError::new_err("the computation failed inside cgroup; please report this with the input")
}

/// Raises a pending signal, and tells the caller how far the work is.
fn look_around(py: Python<'_>, options: &RunOptions, execution: &Execution) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = &options.progress {
        progress.call1(py, (execution.progress(),))?;
    }
    Ok(())
}

/// A pool of that many threads, kept from an earlier call where there is one.
fn take_pool(threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let threads = threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let kept = with_pools(|pools| match threads {
        1 => pools.single.pop(),
        _ => pools.shared.get(&threads).map(Arc::clone),
    });
    if let Some(pool) = kept {
        return Ok(pool);
    }
    // Built outside the lock, which a fork in the meantime would leave locked for ever.
    let builder = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("cgroup-{i}"));
    let failed = |error| CgroupError::new_err(format!("threads: could not start {threads} threads: {error}"));
    Ok(Arc::new(builder.build().map_err(failed)?))
}

fn give_back(pool: Arc<ThreadPool>) {
    let threads = pool.current_num_threads();
    with_pools(|pools| {
        if threads > 1 {
            pools.shared.entry(threads).or_insert(pool);
        } else if pools.single.len() < MOST_IDLE {
            pools.single.push(pool);
        }
    });
}

fn with_pools<T>(work: impl FnOnce(&mut Pools) -> T) -> T {
    let mut guard = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let pools = guard.get_or_insert_default();
    let process = std::process::id();
    if pools.process != process {
        // The threads of a parent's pools are not here; joining them would wait for ever.
        std::mem::forget(std::mem::take(pools));
        pools.process = process;
    }
    work(pools)
}
