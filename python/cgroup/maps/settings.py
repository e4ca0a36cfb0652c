"""Tuned numbers of maps. Lengths are in voxels unless another unit is named."""

import numpy as np

# --- preparation: prepared_map
CELL = 8.0  # edge length of the cells of a map
STEP = 2**0.5  # from the voxel of one level to the next
SPACINGS = 4.0  # of the map's points in the finest voxel
COARSEST = 2000  # voxels of a map from which no coarser level is made
BETWEEN_POINTS = 1 / 3  # as the fine surface needs them
AT_ONCE = 50_000  # voxels that are compared at a time
CELL_PARTS = 4  # of a cell, that radii are rounded to

# --- places: locate
SCAN_VOXELS = 1200  # approximate number of voxels of a scan
COMPARED, COMPARISONS = (100, 400), 10**8  # least and most descriptors of a scan; approximate comparisons
WHOLE = 10_000  # largest number of voxels of a map that is registered as a whole
AT_A_TIME, FROM_ABOVE, ALIKE_PLACES = 2, 4, 8  # places at a time; most places from above, and by descriptors
SURE = 0.9  # probability that ends the search among places
ENOUGH = 4  # number of tried places from which an accepted pose suffices; before, it must be sure
SLACK = 2.0  # allowed distance of the origin beyond the radius
WITHIN = 0.9  # share of a scan's voxels within its radius
AROUND, PLACES_APART, COMPARED_WITHIN = 1.5, 0.5, 0.7  # radii of a scan: around a place, between, compared

# --- the view from above: plan_view
FLAT, STEEP = 0.9, 0.3  # cosines of normals with the axis: of floors from, of walls up to
LEAST_FLAT, LEAST_WALLS = 0.15, 30  # share of flat voxels, and number of wall voxels, that a plan needs
TURNS, TURN_PARTS = 72, 3  # tried turns, and their subdivision in the fine search
COARSE = 2  # edge length of a coarse cell
OPEN = 0.7  # weight of open floor
CLOSELY = 300  # placements in the fine search
DIRECTION_ROUNDS = 5  # of the search for the main direction of normals
MARGIN = 2  # cells between a map and the border
APART, TURNED = 3.0, np.radians(17.0)  # voxels or angle between places
FLOOR_WITHIN = 10.0  # from a place
LEAST_FLOOR, MOST_FLOORS = 0.2, 4  # share of the largest floor's voxels that another has
RIVALS = 6  # other poses that share the probability
