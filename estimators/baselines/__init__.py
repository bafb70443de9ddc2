"""Baselines: what remembering readings, or looking at each alone, would do. None has a map.

One file each; `reading_classifier` is what those share that name each reading by itself.
"""
