"""Show a pad while it is read: pressures, force and counters, and what an estimator makes of each touch.

Lives here: one state that a reader thread keeps up to date, and two ways to show it, the terminal and a page on
localhost. Does not live here: ports and codecs (`tactsim.hardware`), and what an estimator believes
(`tactsim.estimators`).
"""
