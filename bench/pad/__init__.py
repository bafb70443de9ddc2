"""A person and a real pad: guided recording, sheets to press by, and how far the simulation agrees with a recording.

Lives here: leading a person through the presses of a session or of a run's trials, the template that is printed for
it, and `bench validate`. Does not live here: the pad's bytes and its calibration, which are `tactsim.hardware`'s.
"""
