"""The real pad: bytes to frames, ports, tare, recording, replay and an emulator.

Lives here: everything that stands between a device and a `Reading`. Does not live here: physics,
estimation or scoring; of `tactsim` it sees only the data types.

A reading's way: `port` moves bytes, a codec (`codecs`) makes frames of them, `stream` joins the
frames of all parts of a pad to readings, `calibration` corrects them. A `Source` (`sources`) hides
which of a port, a recording or a plug-in stands behind.
"""
