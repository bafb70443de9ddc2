"""What a reading says of a state: occupancy maps, and the measurement models learned on them.

Lives here: the classifier of eq. 3, maps, mosaics, and the measurement models (likelihoods), which `likelihood.py`
lists and whose face it says. Does not live here: any belief; what a likelihood knows is a table over the object's
plane.
"""
