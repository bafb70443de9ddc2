"""How near the best possible: the Cramer-Rao bound of the pose, and exact Bayes with the simulator itself.

`response` presses around the test poses, `information` turns that into Fisher information, `cramer_rao` into a
distance, and `scan_information` does both for a scan and keeps the result. `exact_bayes` is the estimator that knows
the press, on the trials that every estimator gets. `bounded` puts the bound beside a run.
"""
