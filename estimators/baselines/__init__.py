"""Baselines: what remembering readings, or looking at each alone, would do. None has a map.

`nearest` holds those that name each reading by itself, `whole_image` those that look at whole presses.
"""
