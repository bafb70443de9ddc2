"""Analysis by synthesis: an estimator that presses the known shapes itself, by the forward model.

`synthesis` is the estimator; `pose_bank` finds where to begin, `modes` follow from there.
"""
