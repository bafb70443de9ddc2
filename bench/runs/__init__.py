"""Finished runs: how they are called, pooled over their seeds and drawn, and what their readings are worth.

Lives here: what the terminal, the report and the leaderboard say of runs alike. Does not live here: `Run` itself and
its folder, which are `tactsim.bench.results`', and metrics, which are `tactsim.bench.score`'s.
"""
