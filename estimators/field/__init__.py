"""The log-likelihood of a sequence as a field over letters and poses: tables, terms of the readings, and sums.

Lives here: `LikelihoodField`, which stands between a likelihood and the filters, and the inner loops that sum
a state's terms. Does not live here: what a table means (likelihoods), or which states are looked at (filters).
"""
