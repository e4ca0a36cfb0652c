//! Runs the fuzz targets of `fuzz/` on their corpus, and on seeded mutations of it: `make fuzz` searches
//! further.

mod targets;

use std::path::{Path, PathBuf};
use std::{fs, io};

use cgroup::consensus::counter_rng::random_words;
use targets::TARGETS;

/// Mutated inputs per file of the corpus.
const MUTATIONS: u64 = 12;

/// Most memory of the whole process, in KiB: inputs have a few hundred points.
const MOST_MEMORY: usize = 512 << 10;

#[test]
fn targets_accept_their_corpus_and_mutations() -> io::Result<()> {
    for (name, target) in TARGETS {
        let files = corpus(name)?;
        assert!(files.len() >= 10, "{name}: a corpus of {}", files.len());
        for (seed, path) in files.iter().enumerate() {
            let input = fs::read(path)?;
            target(&input);
            (0..MUTATIONS).for_each(|i| target(&mutated(&input, seed as u64, i)));
        }
    }
    let peak = peak_memory();
    assert!(peak.is_none_or(|peak| peak < MOST_MEMORY), "peak memory: {peak:?} KiB");
    Ok(())
}

fn corpus(target: &str) -> io::Result<Vec<PathBuf>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz_targets/corpus").join(target);
    let mut files = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    files.sort();
    Ok(files)
}

/// The input with up to four bytes changed, and sometimes truncated.
fn mutated(input: &[u8], seed: u64, i: u64) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for word in random_words(seed, i) {
        let place = (word >> 8) as usize % bytes.len().max(1);
        if let Some(byte) = bytes.get_mut(place) {
            *byte = word as u8;
        }
        if word % 13 == 0 {
            bytes.truncate(place);
        }
    }
    bytes
}

/// Peak memory of this process, in KiB, if the system reports it.
fn peak_memory() -> Option<usize> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches(" kB").parse().ok()
}
