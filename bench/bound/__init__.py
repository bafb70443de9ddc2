"""How near the best possible: the Cramer-Rao bound of the pose, and exact Bayes with the simulator itself.

`response` presses around the test poses, `pose_information` turns that into Fisher information, `cramer_rao` into a
distance, and `scan_information` does both for a scan and its trials. `exact_bayes` is the estimator that knows the
press, on the trials that every estimator gets. `efficiency` puts the bound beside a run.
"""
