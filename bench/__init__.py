"""The harness: command line, trials, scores, sweeps, results and reports.

Lives here: whatever compares estimators, and all that a user types or looks at. Does not live here:
physics, maps or filters; what the other folders compute is asked of them.
"""
