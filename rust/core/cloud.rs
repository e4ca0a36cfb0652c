//! A prepared cloud: its points, with cached searches and resolution.
//!
//! All steps of the front end query the same few neighbourhoods. A search that one step builds is kept for
//! the next.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::geometry::neighbors::NearestNeighbors;
use crate::geometry::own_axes::OwnFrame;
use crate::geometry::resolution;
use crate::points::Points;

/// Number of ball searches kept, the latest ones; a detector and a descriptor use two.
const MOST_KEPT: usize = 3;

/// Points and their cached searches. Threads may share it.
///
/// What it keeps takes up to 264 bytes per point.
#[derive(Debug, Default)]
pub struct Cloud {
    points: Points,
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    nearest: Option<Arc<NearestNeighbors>>,
    /// The latest last.
    balls: Vec<BallSearch>,
    resolution: Option<f64>,
    own: Option<Arc<Own>>,
}

/// The frame of a cloud's own axes, and its points in that frame.
pub type Own = (OwnFrame, Points);

impl Cloud {
    /// Cloud of points that are already validated.
    pub fn new(points: Points) -> Self {
        Self { points, kept: Mutex::default() }
    }

    /// Cloud of rows of coordinates; `name` is used in the error message.
    ///
    /// # Errors
    /// As [`Points::from_rows`].
    pub fn from_rows(name: &str, rows: &[[f64; 3]]) -> Result<Self> {
        Points::from_rows(name, rows).map(Self::new)
    }

    /// The points, relative to their mean.
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// The points along the cloud's own axes, and the frame of these.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn own(&self) -> Result<Arc<Own>> {
        if let Some(known) = self.kept().and_then(|kept| kept.own.clone()) {
            return Ok(known);
        }
        let built = Arc::new(OwnFrame::of(&self.points)?);
        if let Some(mut kept) = self.kept() {
            kept.own = Some(Arc::clone(&built));
        }
        Ok(built)
    }

    /// Mean distance to the nearest other point (see [`resolution::mean_nearest_distance`]).
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for fewer than two points, or if every distance is ignored;
    /// [`crate::Error::Interrupted`].
    pub fn resolution(&self, ignore_zero: bool, execution: &Execution) -> Result<f64> {
        let known = self.kept().and_then(|kept| kept.resolution);
        if let (Some(known), false) = (known, ignore_zero) {
            return Ok(known);
        }
        let computed =
            resolution::mean_nearest_distance(self.nearest(execution)?.as_ref(), ignore_zero, execution)?;
        if let (Some(mut kept), false) = (self.kept(), ignore_zero) {
            kept.resolution = Some(computed);
        }
        Ok(computed)
    }

    /// The search for nearest neighbours.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn nearest(&self, execution: &Execution) -> Result<Arc<NearestNeighbors>> {
        if let Some(known) = self.kept().and_then(|kept| kept.nearest.clone()) {
            return Ok(known);
        }
        let built = Arc::new(NearestNeighbors::new(&self.points, execution)?);
        if let Some(mut kept) = self.kept() {
            kept.nearest = Some(Arc::clone(&built));
        }
        Ok(built)
    }

    /// The search for all points within `radius`, on a grid made for this radius: the order of a ball, and so
    /// the bits of sums over it, do not depend on earlier searches.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] unless the radius is positive.
    pub fn balls(&self, radius: f64) -> Result<BallSearch> {
        self.find(radius, |search| search.is_made_for(radius))
    }

    /// As [`Self::balls`] in any order, which allows to reuse the grid of a somewhat larger radius.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] unless the radius is positive.
    pub fn unordered_balls(&self, radius: f64) -> Result<BallSearch> {
        self.find(radius, |search| search.serves(radius))
    }

    fn find(&self, radius: f64, is_usable: impl Fn(&BallSearch) -> bool) -> Result<BallSearch> {
        let known = self.kept().and_then(|kept| kept.balls.iter().find(|&search| is_usable(search)).cloned());
        if let Some(known) = known {
            return Ok(known.narrowed(radius));
        }
        // Built without the lock: a fork in the meantime would leave the lock held for ever.
        let built = BallSearch::new(&self.points, radius)?;
        if let Some(mut kept) = self.kept() {
            if kept.balls.len() == MOST_KEPT {
                kept.balls.remove(0);
            }
            kept.balls.push(built.clone());
        }
        Ok(built)
    }

    /// The cache; `None` while another thread uses it: building anew is faster than waiting, and a forked
    /// process may find the lock held for ever.
    fn kept(&self) -> Option<MutexGuard<'_, Kept>> {
        match self.kept.try_lock() {
            Ok(kept) => Some(kept),
            Err(TryLockError::Poisoned(error)) => Some(PoisonError::into_inner(error)),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered() -> Result<Cloud> {
        let rows: Vec<[f64; 3]> =
            (0..500).map(|i| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin())).collect();
        Cloud::from_rows("points", &rows)
    }

    fn sums(search: &BallSearch) -> Result<Vec<f64>> {
        search.map_points(&Execution::default(), |_, ball| ball.squared_distances().iter().sum::<f64>())
    }

    #[test]
    fn cached_searches_are_reused() -> Result<()> {
        let execution = Execution::default();
        let cloud = scattered()?;
        assert!(Arc::ptr_eq(&cloud.nearest(&execution)?, &cloud.nearest(&execution)?));
        assert!(cloud.balls(0.5)?.shares_grid(&cloud.balls(0.5)?));
        assert!(cloud.unordered_balls(0.4)?.shares_grid(&cloud.balls(0.5)?));
        assert!(!cloud.balls(0.4)?.shares_grid(&cloud.balls(0.5)?));
        Ok(())
    }

    #[test]
    fn only_the_latest_searches_are_kept() -> Result<()> {
        let cloud = scattered()?;
        let first = cloud.balls(0.1)?;
        for radius in [0.2, 0.3, 0.4] {
            cloud.balls(radius)?;
        }
        assert!(!cloud.balls(0.1)?.shares_grid(&first));
        Ok(())
    }

    #[test]
    fn earlier_searches_change_no_bit() -> Result<()> {
        let (fresh, used) = (scattered()?, scattered()?);
        for radius in [0.5, 0.45] {
            used.unordered_balls(radius)?;
            used.balls(radius)?;
        }
        assert_eq!(sums(&fresh.balls(0.4)?)?, sums(&used.balls(0.4)?)?);
        let execution = Execution::default();
        let first = used.resolution(false, &execution)?;
        assert!((used.resolution(false, &execution)? - first).abs() == 0.0);
        assert!((fresh.resolution(false, &execution)? - first).abs() == 0.0);
        Ok(())
    }

    #[test]
    fn a_held_lock_makes_a_search_build_anew() -> Result<()> {
        let cloud = scattered()?;
        let search = cloud.balls(0.5)?;
        let held = cloud.kept.lock();
        assert!(!cloud.balls(0.5)?.shares_grid(&search));
        assert_eq!(sums(&cloud.balls(0.5)?)?, sums(&search)?);
        assert!(cloud.resolution(false, &Execution::default())? > 0.0);
        drop(held);
        assert!(cloud.balls(0.5)?.shares_grid(&search));
        Ok(())
    }

    #[test]
    fn resolutions_with_and_without_duplicates_are_cached_separately() -> Result<()> {
        let cloud = Cloud::from_rows("points", &[[0.0; 3], [0.0; 3], [2.0, 0.0, 0.0]])?;
        let execution = Execution::default();
        for _ in 0..2 {
            assert!((cloud.resolution(false, &execution)? - 2.0 / 3.0).abs() < 1e-15);
            assert!((cloud.resolution(true, &execution)? - 2.0).abs() < 1e-15);
        }
        Ok(())
    }
}
