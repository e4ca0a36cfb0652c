//! The same input, options and seed give the same bits on any number of threads and in any memory.

use crate::common::{methods, problem};
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::grouping::{BoxedMethod, GroupingMethod};
use cgroup::{Error, Execution, Grouping, Result};
use rayon::ThreadPoolBuilder;

fn group_all(threads: usize, max_memory: usize, n: usize) -> Result<Vec<Grouping>> {
    group_each(&methods(), threads, max_memory, n)
}

fn group_each(
    methods: &[(&str, BoxedMethod)],
    threads: usize,
    max_memory: usize,
    n: usize,
) -> Result<Vec<Grouping>> {
    let input = problem(11, n, 0.2, 0.5).correspondences()?;
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| Error::invalid("threads", threads, error.to_string()))?;
    let group = |(_, method): &(_, BoxedMethod)| method.group(&input, &Execution::new(max_memory));
    pool.install(|| methods.iter().map(group).collect())
}

#[test]
fn threads_change_nothing() -> Result<()> {
    let one = group_all(1, usize::MAX, 700)?;
    for threads in [2, 3] {
        assert_eq!(one, group_all(threads, usize::MAX, 700)?);
    }
    Ok(())
}

#[test]
fn memory_changes_nothing() -> Result<()> {
    // 4,100 correspondences exceed the size from which pair scores are stored in f32.
    let mut methods = methods();
    methods.truncate(9); // the paper's; the others keep a graph, and use fewer vertices if it does not fit
    for n in [300, 4_100] {
        assert_eq!(group_each(&methods, 2, usize::MAX, n)?, group_each(&methods, 2, 0, n)?);
    }
    Ok(())
}

#[test]
fn too_little_memory_for_the_graph_is_refused() -> Result<()> {
    let input = problem(1, 500, 0.2, 0.5).correspondences()?;
    let lc = LikelihoodConsensus::default();
    let bytes = 500 * 8 * 8;
    assert!(lc.group(&input, &Execution::new(bytes)).is_ok());
    let refused = lc.group(&input, &Execution::new(bytes - 1));
    assert!(matches!(refused, Err(Error::InvalidInput { what, .. }) if what == "max_memory"));
    Ok(())
}

#[test]
fn an_interrupted_run_is_an_error() -> Result<()> {
    let input = problem(1, 500, 0.2, 0.5).correspondences()?;
    for (name, method) in methods() {
        if ["ss", "nnsr", "3dhv"].contains(&name) {
            continue; // these take microseconds
        }
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(method.group(&input, &execution), Err(Error::Interrupted), "{name}");
    }
    Ok(())
}
