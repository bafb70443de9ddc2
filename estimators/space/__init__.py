"""Objects in space: maps of their surfaces on sparse voxels, and what a touch from any side says of a pose in SE(3)."""
