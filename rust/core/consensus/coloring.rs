//! Vertex colouring: connected vertices have different colours, so no clique has more members than there are
//! colours.
//!
//! Greedy, class after class: the first remaining vertex, then the first one after it that is not connected
//! to it, and so on (San Segundo et al., *An exact bit-parallel algorithm for the maximum clique problem*,
//! 2011).

use crate::compatibility::graph::AgreementGraph;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::simd;

/// A vertex, and the number of its colour, from 1 on.
pub type Colored = (u32, u32);

/// Colours the vertices that are bits of `left`, and clears `left`; writes those whose colour is above
/// `least`, by colour, and returns the number of colours. `class` is working space as long as `left`.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn color(
    graph: &AgreementGraph,
    left: &mut [u64],
    class: &mut [u64],
    least: u32,
    colored: &mut Vec<Colored>,
) -> Result<u32> {
    let mut number = 0;
    let mut start = 0;
    while let Some(skipped) = left[start..].iter().position(|&word| word != 0) {
        start += skipped;
        number += 1;
        class[start..].copy_from_slice(&left[start..]);
        let mut word = start;
        while word < class.len() {
            if class[word] == 0 {
                word += 1;
                continue;
            }
            let bit = class[word].trailing_zeros();
            left[word] &= !(1 << bit);
            class[word] &= !(1 << bit);
            let vertex = word as u32 * u64::BITS + bit;
            clear_joined(&mut class[word..], &graph.row(vertex as usize)[word..]);
            if number > least {
                memory::push(colored, (vertex, number))?;
            }
        }
    }
    Ok(number)
}

fn clear_joined(class: &mut [u64], row: &[u64]) {
    simd::run(
        #[inline(always)]
        || {
            for (class, row) in class.iter_mut().zip(row) {
                *class &= !row;
            }
        },
    );
}

/// Number of colours of a graph, its vertices in their order.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn count_colors(graph: &AgreementGraph, execution: &Execution) -> Result<u32> {
    execution.check()?;
    let mut left = all(graph.len())?;
    let mut class = memory::copied(&left)?;
    color(graph, &mut left, &mut class, u32::MAX, &mut Vec::new())
}

/// Bit set of `len` vertices, all set.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn all(len: usize) -> Result<Vec<u64>> {
    let mut bits = memory::filled(u64::MAX, len.div_ceil(64))?;
    if let Some(last) = bits.last_mut()
        && !len.is_multiple_of(64)
    {
        *last = (1 << (len % 64)) - 1;
    }
    Ok(bits)
}

#[cfg(test)]
mod tests {
    use super::super::cores::tests::graph;
    use super::*;

    #[test]
    fn connected_vertices_differ_in_color() -> Result<()> {
        for n in [0, 1, 63, 64, 65, 200] {
            let graph = graph(n, 0.3)?;
            let (mut left, mut colored) = (all(n)?, Vec::new());
            let mut class = left.clone();
            let number = color(&graph, &mut left, &mut class, 0, &mut colored)?;
            assert_eq!(number, count_colors(&graph, &Execution::default())?);
            assert_eq!(colored.len(), n);
            assert!(left.iter().all(|&word| word == 0) && colored.is_sorted_by_key(|&(_, color)| color));
            for (a, b) in colored.iter().flat_map(|a| colored.iter().map(move |b| (a, b))) {
                assert!(a.1 != b.1 || !graph.joined(a.0 as usize, b.0 as usize));
            }
            // Each vertex is connected to one of every colour before its own.
            for &(vertex, color) in &colored {
                let joined = |k: u32| {
                    colored.iter().any(|&(v, c)| c == k && graph.joined(v as usize, vertex as usize))
                };
                assert!((1..color).all(joined));
            }
            let mut left = all(n)?;
            let mut high = Vec::new();
            color(&graph, &mut left, &mut class, 2, &mut high)?;
            colored.retain(|&(_, color)| color > 2);
            assert_eq!(high, colored);
        }
        Ok(())
    }
}
