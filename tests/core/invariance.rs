//! A group is invariant to order, rigid motion and scale.

use crate::common::{Motion, Uniform, methods, problem};
use cgroup::Execution;
use cgroup::grouping::geometric_consistency::{GeometricConsistency, Ties};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// The same draws in every run, unless `PROPTEST_RNG_SEED` sets another seed, as `make test-random` does.
fn config() -> ProptestConfig {
    let given = ProptestConfig::default();
    let rng_seed = if given.rng_seed == RngSeed::Random { RngSeed::Fixed(0) } else { given.rng_seed };
    ProptestConfig { cases: 24, rng_seed, ..given }
}

fn fails(error: impl std::fmt::Display) -> TestCaseError {
    TestCaseError::fail(error.to_string())
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn rigid_motion_of_either_side(seed in 0_u64..10_000, n in 3_usize..120, share in 0.1..0.9) {
        let still = problem(seed, n, share, 0.5);
        for (name, method) in methods() {
            // The Hough grid is aligned with the target's axes, and TEASER++ votes for a translation along
            // each of them.
            let target = if ["3dhv", "teaser"].contains(&name) { Motion::translation(seed + 1) } else { Motion::random(seed + 1) };
            let moved = still.moved(&Motion::random(seed + 2), &target);
            let expected = method.group(&still.correspondences().map_err(fails)?, &Execution::default());
            let got = method.group(&moved.correspondences().map_err(fails)?, &Execution::default());
            prop_assert_eq!(expected.map_err(fails)?.mask, got.map_err(fails)?.mask, "{}", name);
        }
    }

    #[test]
    fn common_scale(seed in 0_u64..10_000, n in 3_usize..120, exponent in -12_i32..12) {
        let still = problem(seed, n, 0.4, 0.5);
        // A power of two, so that no length is rounded.
        let scaled = still.scaled(2.0_f64.powi(exponent));
        for (name, method) in methods() {
            let expected = method.group(&still.correspondences().map_err(fails)?, &Execution::default());
            let got = method.group(&scaled.correspondences().map_err(fails)?, &Execution::default());
            prop_assert_eq!(expected.map_err(fails)?.mask, got.map_err(fails)?.mask, "{}", name);
        }
    }

    #[test]
    fn order_of_the_input(seed in 0_u64..10_000, n in 3_usize..120) {
        let plain = problem(seed, n, 0.4, 0.5);
        let mut random = Uniform::new(seed + 3);
        let mut order: Vec<(f64, usize)> = (0..n).map(|i| (random.next(), i)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let order: Vec<usize> = order.into_iter().map(|(_, i)| i).collect();
        let shuffled = plain.reordered(&order);
        // Two contradictory correspondences tie, so there are at least three. Some methods depend on the
        // order: RANSAC samples rows by number, GC takes the largest star of the lowest row, TEASER++
        // proceeds from row to row, CLIPPER starts from a random number per row, and TurboReg finds a
        // triangle from its two lowest rows and takes the first of the best.
        let mut methods = methods();
        methods.retain(|(name, _)| !["ransac", "gc", "teaser", "clipper", "turboreg"].contains(name));
        let every_star = GeometricConsistency { ties: Ties::Union, ..GeometricConsistency::default() };
        methods.push(("gc", Box::new(every_star)));
        for (name, method) in methods {
            let expected = method.group(&plain.correspondences().map_err(fails)?, &Execution::default());
            let got = method.group(&shuffled.correspondences().map_err(fails)?, &Execution::default());
            let expected = expected.map_err(fails)?.mask;
            let reordered: Vec<bool> = order.iter().map(|&i| expected[i]).collect();
            prop_assert_eq!(reordered, got.map_err(fails)?.mask, "{}", name);
        }
    }
}

#[test]
fn noise_free_inliers_are_all_selected() -> cgroup::Result<()> {
    let input = problem(5, 60, 1.0, 0.0).correspondences()?;
    for (name, method) in methods() {
        if ["ss", "nnsr", "cv"].contains(&name) {
            continue;
        }
        let group = method.group(&input, &Execution::default())?;
        assert_eq!(group.size(), 60, "{name}");
    }
    Ok(())
}
