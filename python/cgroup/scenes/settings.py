"""Tuned numbers of scenes. Lengths are in voxels, angles in radians, evidence in nats."""

import numpy as np

# --- pairs: partners, building
ALL_PAIRS = 20  # largest number of scans of which every pair is tried
FIRST_PARTNERS, MORE_PARTNERS = 6, 2  # partners of each scan at first, and in each further round
BUDGET = 8  # largest number of pairs per scan
HOPELESS = 0.01  # probability at coarse voxels below which a pair is not registered at fine ones
GAUSSIANS, DIMENSIONS = 64, 16  # of the mixture that describes scans
TRAINING, TRAINING_OF_EACH = 20_000, 1500  # descriptors that it is fitted to: of all scans, and of one
MIXTURE_ROUNDS, LEAST_VARIANCE = 15, 0.05  # of expectation maximization
ODOMETRY_TURN, ODOMETRY_SHIFT = np.radians(3.0), 2.0  # standard deviations of odometry

# --- consistency: agreement, decide
DISAGREES = 22.46  # squared error above which poses differ: .999 of chi-squared with 6 degrees of freedom
LEAST_TURN, LEAST_SHIFT = np.radians(1.0), 0.5  # deviations beyond the covariance, at the source's middle
CLOSED_BY_CHANCE = 0.02  # share of the triangles of wrong poses that close
SUREST, LEAST_SURE = 0.99, 0.01  # bounds of probabilities
BELIEF_ROUNDS = 10  # of loopy belief propagation
FIRM = 0.9  # least joint probability of the links between two parts that connects them
LARGEST_CHANCE = 1 - 1e-6  # above, an edge would be trusted against all others
MOST_NATS = 10.0  # largest evidence for a link from the others
REJECTED = 0.05  # probability of a pose on the surfaces below which its link is rejected

# --- unions: join
JOIN_ROUNDS = 3  # of joining components
IN_A_UNION = 8  # number of scans in a union around one scan
LEAST_CHANCE = 0.005  # of a pose that is proposed
NEAR, ALIKE = 3.0, np.radians(5)  # within which two poses agree
AGREEING = 0.1  # weight of a pose that agrees with another, beside its chance
FINEST = 1 / 3  # between the points of a union, as its fine surface needs them
PROPOSED = 3  # poses of a union
TELLING = 0.3  # overlap from which a pair that does not fit counts against a join
MOST_NATS_AGAINST, MOST_NATS_OF_UNIONS = 2.0, 10.0  # evidence of one pair, and of two unions

# --- refinement: refine, building
UNION_ROUNDS = 3  # of refining each scan on the others
REFINED_PARTNERS = 6  # largest number of partners of each scan, by overlap
CELL = 3.0  # within which two scans overlap
LEAST_DEVIATION = 0.01  # of the residuals of a pair
HELD = 1e-4  # share of the weight of all pairs that holds open motions
LEAST_SHARED, LEAST_FITNESS = 0.15, 0.1  # shares of cells and of the surface that partners have in common
EXACT = 0.2  # share of the least deviations of links after joint refinement
