"""The real pad: bytes to frames, ports, tare, recording, replay and an emulator.

Lives here: everything that stands between a device and a `Reading`. Does not live here: physics,
estimation or scoring; of `tactsim` it sees only the data types.
"""
