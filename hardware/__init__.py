"""The real pad: bytes to frames, ports, tare, recording, replay and an emulator.

Lives here: everything between a device and a `Reading`. Does not live here: physics, estimation or
scoring; of the other rooms it sees `core` alone.

A reading's way: `port` moves bytes, a codec (`codecs`) makes frames of them, `stream` joins the
frames of all parts of a pad to readings, and `calibration` corrects them. `sources` opens a port, a
recording or a plug-in by its name; each is a `tactsim.core.source.Source`.
"""
