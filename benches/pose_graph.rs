//! Pose graphs of a back-and-forth walk over a square grid, with loops to earlier rows: 10,000 nodes and
//! about 50,000 edges.

use cgroup::geometry::rigid::Rigid;
use cgroup::pose_graph::{Edge, Start, optimize};
use cgroup::{Execution, Result};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};

const LOOPS: [(usize, usize); 4] = [(0, 1), (1, 1), (2, 1), (0, 2)];

fn walk(side: usize) -> (Vec<Rigid>, Vec<Edge>) {
    let place = |row: usize, column: usize| {
        row * side + if row.is_multiple_of(2) { column } else { side - 1 - column }
    };
    let mut poses = vec![Rigid { rotation: Matrix3::identity(), translation: Vector3::zeros() }; side * side];
    let mut edges = Vec::new();
    for row in 0..side {
        for column in 0..side {
            poses[place(row, column)].translation = Vector3::new(row as f64, column as f64, 0.0);
        }
    }
    let mut measure = |from: usize, to: usize, probability: f64| {
        let k = edges.len() as f64;
        let noise = Vector3::new((1.3 * k).sin(), (2.1 * k).sin(), (3.7 * k).sin()) * 0.02;
        let measurement = Rigid {
            rotation: *Rotation3::new(noise * 0.5).matrix(),
            translation: poses[to].translation - poses[from].translation + noise,
        };
        edges.push(Edge { from, to, measurement, information: Matrix6::identity() * 2500.0, probability });
    };
    (1..side * side).for_each(|node| measure(node - 1, node, 1.0));
    for row in 0..side {
        for column in 0..side {
            for (across, along) in LOOPS {
                if row + along < side && column + across < side {
                    measure(place(row, column), place(row + along, column + across), 0.5);
                }
            }
        }
    }
    (poses, edges)
}

fn optimization(criterion: &mut Criterion) {
    let (poses, edges) = walk(100);
    let mut group = criterion.benchmark_group("pose graph");
    group.sample_size(10);
    for robust in [false, true] {
        group.bench_function(BenchmarkId::new("optimize", robust), |b| {
            b.iter(|| -> Result<_> {
                optimize(&poses, &edges, Start::Chordal, robust, &Execution::default())
            });
        });
    }
    group.finish();
}

criterion_group!(benches, optimization);
criterion_main!(benches);
