"""The log-likelihood as a field over states: tables on a lattice, the readings of a sequence, inner loops.

Lives here: what stands between a likelihood and the filters, and is the same for all of them. Does not live
here: what a table means (likelihoods), or which states are looked at (filters).
"""
