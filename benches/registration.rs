//! Registration of two overlapping parts of a bumpy closed surface, with the voxel that is chosen for them.
//!
//! `fresh` includes the preparation of both clouds, `prepared` does not.

use std::f64::consts::PI;
use std::hint::black_box;
use std::sync::Arc;

use cgroup::registration::{Options, Prepared, Suited, register, suit_voxel};
use cgroup::{Cloud, Error, Execution, Result};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Rotation3, Vector3};

/// Points of a golden-angle lattice on a bumpy ellipsoid, between two fractions of the way from one pole to the other.
fn part(count: u32, first: f64, last: f64, turn: f64) -> Result<Arc<Cloud>> {
    let place = |i: u32| {
        let z = 1.0 - 2.0 * (first + (last - first) * (f64::from(i) + 0.5) / f64::from(count));
        let angle = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let flat = (1.0 - z * z).sqrt();
        let d = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        let bumps = 0.12 * (5.0 * d.x + 1.0).sin() * (4.0 * d.y).cos() + 0.1 * (7.0 * d.z + 3.0 * d.x).sin();
        let point = d.component_mul(&Vector3::new(1.3, 0.9, 0.7)) * (1.0 + bumps);
        (Rotation3::from_euler_angles(0.2, turn, -turn) * point).into()
    };
    Ok(Arc::new(Cloud::from_rows("part", &(0..count).map(place).collect::<Vec<_>>())?))
}

fn prepare(clouds: &[Arc<Cloud>; 2], execution: &Execution) -> Result<[Prepared; 2]> {
    let Suited::Voxel(voxel) = suit_voxel(&[&clouds[0], &clouds[1]], execution)? else {
        return Err(Error::invalid("clouds", "two sizes", "give clouds of one size"));
    };
    let [source, target] = clouds.each_ref().map(|cloud| Prepared::of(Arc::clone(cloud), voxel, None));
    Ok([source?, target?])
}

fn pair(criterion: &mut Criterion, count: u32) -> Result<()> {
    let (execution, options) = (Execution::default(), Options::default());
    let clouds = [part(count, 0.0, 0.6, 0.0)?, part(count, 0.3, 0.9, 0.7)?];
    let ready = prepare(&clouds, &execution)?;
    let mut group = criterion.benchmark_group("registration");
    group.sample_size(10);
    group.bench_function(BenchmarkId::new("fresh", count), |bencher| {
        bencher.iter(|| {
            let [source, target] = prepare(&clouds, &execution)?;
            register(&source, &target, &options, &execution).map(black_box)
        });
    });
    group.bench_function(BenchmarkId::new("prepared", count), |bencher| {
        bencher.iter(|| register(&ready[0], &ready[1], &options, &execution).map(black_box));
    });
    group.finish();
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    for count in [5_000, 40_000] {
        if let Err(error) = pair(criterion, count) {
            criterion.bench_function(&format!("skipped: {error}"), |bencher| bencher.iter(|| ()));
        }
    }
}

criterion_group!(registration, benches);
criterion_main!(registration);
