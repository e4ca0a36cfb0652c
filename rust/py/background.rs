//! Runs work on its own threads while the caller waits and polls; independent of Python, so that
//! `tests/background.rs` can test it under the thread sanitizer.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use cgroup::Execution;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// Time between two polls.
const POLL: Duration = Duration::from_millis(50);

/// Time for interrupted work to end by itself before it is left to end in the background.
const GRACE: Duration = Duration::from_millis(500);

/// Pools of this process; threads do not survive a fork, so each process has its own.
#[derive(Default)]
struct Pools {
    process: u32,
    /// Pools shared by callers, by number of threads.
    shared: HashMap<usize, Arc<ThreadPool>>,
    /// Idle pools of one thread: callers that request one thread run side by side.
    single: Vec<Arc<ThreadPool>>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// Most idle pools of one thread.
const MOST_IDLE: usize = 64;

/// Reason for a missing result.
#[derive(Debug)]
pub enum Failure<E> {
    /// The work panicked.
    Panicked,
    /// Polling failed; the work was asked to stop.
    Interrupted(E),
    /// The thread is gone, which should not happen.
    Lost,
}

/// Runs `work` on the pool and returns its result. Meanwhile it polls `look_around`, which may end the wait;
/// at the deadline it asks the work to end early.
pub fn compute<T: Send + 'static, E>(
    pool: &ThreadPool,
    execution: &Arc<Execution>,
    deadline: Option<Instant>,
    work: impl FnOnce(&Execution) -> T + Send + 'static,
    look_around: impl FnMut() -> Result<(), E>,
) -> Result<T, Failure<E>> {
    // Memory for the one outcome is allocated now, while there is some; `channel` would allocate on sending,
    // for thirty more.
    let (sender, receiver) = sync_channel(1);
    let shared = Arc::clone(execution);
    pool.spawn(move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(&shared)));
        // The receiver is gone if the caller was interrupted and did not wait.
        drop(sender.send(outcome));
    });
    wait(&receiver, execution, deadline, look_around)?.map_err(|_| Failure::Panicked)
}

fn wait<T, E>(
    receiver: &Receiver<T>,
    execution: &Execution,
    mut deadline: Option<Instant>,
    mut look_around: impl FnMut() -> Result<(), E>,
) -> Result<T, Failure<E>> {
    loop {
        let left = deadline.map_or(POLL, |end| end.saturating_duration_since(Instant::now()));
        match receiver.recv_timeout(left.min(POLL)) {
            Ok(outcome) => return Ok(outcome),
            Err(RecvTimeoutError::Disconnected) => return Err(Failure::Lost),
            Err(RecvTimeoutError::Timeout) => {
                if deadline.take_if(|end| *end <= Instant::now()).is_some() {
                    execution.stop();
                }
                if let Err(reason) = look_around() {
                    execution.interrupt();
                    drop(receiver.recv_timeout(GRACE));
                    return Err(Failure::Interrupted(reason));
                }
            }
        }
    }
}

/// A pool with that many threads, reused from an earlier call if there is one.
pub fn take_pool(threads: usize) -> Result<Arc<ThreadPool>, ThreadPoolBuildError> {
    let kept = with_pools(|pools| match threads {
        1 => pools.single.pop(),
        _ => pools.shared.get(&threads).map(Arc::clone),
    });
    if let Some(pool) = kept {
        return Ok(pool);
    }
    // Built outside the lock: a fork in the meantime would leave it locked for ever.
    let builder = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("cgroup-{i}"));
    Ok(Arc::new(builder.build()?))
}

/// Keeps a pool for later calls.
pub fn give_back(pool: Arc<ThreadPool>) {
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
        // The threads of a parent process's pools do not exist here; joining them would wait for ever.
        std::mem::forget(std::mem::take(pools));
        pools.process = process;
    }
    work(pools)
}
