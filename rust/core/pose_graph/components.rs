//! Connected components of the nodes.

use crate::error::Result;
use crate::memory;

/// Disjoint sets of nodes (union-find).
pub struct Sets {
    parent: Vec<usize>,
}

impl Sets {
    /// Sets of one node each.
    pub fn new(nodes: usize) -> Result<Self> {
        Ok(Self { parent: memory::collect(0..nodes)? })
    }

    /// The lowest node of a node's set.
    pub fn find(&mut self, mut node: usize) -> usize {
        while self.parent[node] != node {
            self.parent[node] = self.parent[self.parent[node]];
            node = self.parent[node];
        }
        node
    }

    /// Merges the sets of two nodes; returns false if they are the same.
    pub fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b)] = a.min(b);
        a != b
    }
}

/// The nodes of each component in ascending order; components in the order of their first nodes.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn components(nodes: usize, edges: impl Iterator<Item = (usize, usize)>) -> Result<Vec<Vec<usize>>> {
    let mut sets = Sets::new(nodes)?;
    edges.for_each(|(a, b)| _ = sets.join(a, b));
    let mut number = memory::filled(0, nodes)?;
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for node in 0..nodes {
        let first = sets.find(node);
        if first == node {
            number[node] = parts.len();
            memory::push(&mut parts, Vec::new())?;
        }
        memory::push(&mut parts[number[first]], node)?;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_separated() -> Result<()> {
        let edges = [(5, 2), (2, 0), (3, 3), (4, 1), (0, 5)];
        assert_eq!(components(6, edges.into_iter())?, [vec![0, 2, 5], vec![1, 4], vec![3]]);
        assert_eq!(components(0, std::iter::empty())?, Vec::<Vec<usize>>::new());
        Ok(())
    }
}
