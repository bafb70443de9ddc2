"""The filters: which states are looked at, how the belief is kept, and what is estimated from it.

Lives here: one file an estimator, and what several of them share. Does not live here: what a reading says.
"""
