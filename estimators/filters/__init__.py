"""The filters: which states are looked at, how the belief is kept, and what is estimated from it.

Lives here: the estimators, what several of them share, and what wraps them: open set and active touch. Does
not live here: what a reading says of a state.
"""
