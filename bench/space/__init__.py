"""Objects in space: hide a solid at any pose, touch it from any side, recognise it, and score every touch.

Lives here: what is hidden and where it is touched, the trials, the distance between poses of a solid with symmetry, the
run with its folder, its pictures and its page. Does not live here: how a solid is pressed (`tactsim.press.space`) and
how it is recognised (`tactsim.estimators.space`).
"""
