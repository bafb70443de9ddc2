"""The filters on maps: which states are looked at, how the belief is kept, and what is estimated from it.

To be read in this order:

    map_filter                          what all of them share: the way of a reading
    states, placement                   weighted states, and the pose that they stand for
    grid, binned, histogram             bins; the paper's histogram filter
    particle, particle_kernels          the paper's particle filters
    cells, coarse_bounds, refined       the best bins, halved again: the default
    trust, trust_kernels                how much many readings count
    motion, clouds, moving              an object that moves between touches
    open_set                            "none of these"
    active_touch                        where to touch next

What a reading says of a state is the likelihoods' matter.
"""
