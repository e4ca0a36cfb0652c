//! Initial poses from the edges alone: rotations by linear least squares over all 3x3 matrices, then
//! orthonormalized; then translations (Carlone, Tron, Daniilidis, Dellaert, *Initialization Techniques for 3D
//! SLAM*, ICRA 2015).

use std::collections::VecDeque;

use nalgebra::Matrix3;

use super::components::Sets;
use super::conjugate::EXACT;
use super::system::System;
use super::{Link, motion};
use crate::error::Result;
use crate::geometry::rigid::{Rigid, rotation_from_covariance};
use crate::memory;

/// Initializes the nodes of one component, the first of which keeps its pose.
pub fn place(poses: &mut [Rigid], links: &[Link]) -> Result<()> {
    let links = memory::collect(links.iter().filter(|link| link.from != link.to).copied())?;
    if poses.len() < 2 {
        return Ok(());
    }
    let placed = turn_nodes(poses, &links)? && shift_nodes(poses, &links)?;
    if placed { Ok(()) } else { follow_tree(poses, &links) }
}

/// Estimates rotations: `X_j = R_ij' X_i` with the transposed rotation X of each node.
fn turn_nodes(poses: &mut [Rigid], links: &[Link]) -> Result<bool> {
    let unknowns = poses.len() - 1;
    let mut system = free_system(unknowns, 3, links)?;
    let rows = system.len();
    let mut sides = memory::filled(0.0, 3 * rows)?;
    for link in links {
        let weight = share(link, 0);
        let turn = link.edge.measurement.rotation.transpose() * weight;
        let held = poses[0].rotation.transpose();
        let mut add_held = |node: usize, known: Matrix3<f64>| {
            for column in 0..3 {
                for row in 0..3 {
                    sides[column * rows + 3 * (node - 1) + row] += known[(row, column)];
                }
            }
        };
        match (link.from, link.to) {
            (0, to) => add_held(to, turn * held),
            (from, 0) => add_held(from, turn.transpose() * held),
            (from, to) if from < to => add_below(&mut system, to, from, (-turn).as_slice()),
            (from, to) => add_below(&mut system, from, to, (-turn.transpose()).as_slice()),
        }
        let diagonal = Matrix3::identity() * weight;
        for node in [link.from, link.to].into_iter().filter(|&node| node > 0) {
            system.add_diagonal(node - 1, diagonal.as_slice());
        }
    }
    if !(system.factorize() && system.solve(&mut sides, EXACT)?) {
        return Ok(false);
    }
    for (node, pose) in poses.iter_mut().enumerate().skip(1) {
        let solved = Matrix3::from_fn(|row, column| sides[column * rows + 3 * (node - 1) + row]);
        pose.rotation = rotation_from_covariance(&solved);
    }
    Ok(true)
}

/// Estimates translations: `t_j = t_i + R_i t_ij`.
fn shift_nodes(poses: &mut [Rigid], links: &[Link]) -> Result<bool> {
    let unknowns = poses.len() - 1;
    let mut system = free_system(unknowns, 1, links)?;
    let mut sides = memory::filled(0.0, 3 * unknowns)?;
    for link in links {
        let weight = share(link, 3);
        let shift = poses[link.from].rotation * link.edge.measurement.translation;
        for (node, other, shift) in [(link.to, link.from, shift), (link.from, link.to, -shift)] {
            if node > 0 {
                system.add_diagonal(node - 1, &[weight]);
                let known = if other == 0 { shift + poses[0].translation } else { shift };
                (0..3).for_each(|axis| sides[axis * unknowns + node - 1] += weight * known[axis]);
            }
        }
        if link.from.min(link.to) > 0 {
            add_below(&mut system, link.from.max(link.to), link.from.min(link.to), &[-weight]);
        }
    }
    if !(system.factorize() && system.solve(&mut sides, EXACT)?) {
        return Ok(false);
    }
    for (node, pose) in poses.iter_mut().enumerate().skip(1) {
        (0..3).for_each(|axis| pose.translation[axis] = sides[axis * unknowns + node - 1]);
    }
    Ok(true)
}

/// Initializes the nodes along a maximum spanning tree of the edges' probabilities.
pub fn follow_tree(poses: &mut [Rigid], links: &[Link]) -> Result<()> {
    let mut order = memory::collect(0..links.len())?;
    order.sort_by(|&a, &b| links[b].edge.probability.total_cmp(&links[a].edge.probability));
    let mut sets = Sets::new(poses.len())?;
    let mut branches = memory::filled(Vec::new(), poses.len())?;
    for link in order.into_iter().map(|k| links[k]) {
        if sets.join(link.from, link.to) {
            let there = link.edge.measurement;
            memory::push(&mut branches[link.from], (link.to, there))?;
            memory::push(&mut branches[link.to], (link.from, motion::inverse(&there)))?;
        }
    }
    let mut reached = memory::filled(false, poses.len())?;
    let mut waiting = VecDeque::from([0]);
    while let Some(node) = waiting.pop_front() {
        reached[node] = true;
        for &(next, there) in branches[node].iter().filter(|(next, _)| !reached[*next]) {
            poses[next] = motion::compose(&poses[node], &there);
            waiting.push_back(next);
        }
    }
    Ok(())
}

fn free_system(unknowns: usize, size: usize, links: &[Link]) -> Result<System> {
    let free = links.iter().filter(|link| link.from.min(link.to) > 0);
    System::new(unknowns, size, free.map(|link| (link.from - 1, link.to - 1)), 3)
}

fn add_below(system: &mut System, row: usize, column: usize, block: &[f64]) {
    if let Some(place) = system.place(row - 1, column - 1) {
        system.add_below(place, block);
    }
}

/// Mean information of a link's rotation (first 0) or translation (first 3).
fn share(link: &Link, first: usize) -> f64 {
    link.edge.information.fixed_view::<3, 3>(first, first).trace() / 3.0
}
