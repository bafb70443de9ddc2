"""The harness: command line, trials, scores, sweeps, results and reports.

Lives here: what compares estimators, and all that a user types or looks at. Does not live here: physics,
maps or filters, which belong to the other rooms.
"""
