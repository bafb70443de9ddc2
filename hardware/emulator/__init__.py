"""A pad without hardware: it sends a codec's bytes on a pty or a TCP port, with faults on request.

Lives here: emulated devices, their faults, the hand that presses them, and how they are served. Does not live
here: physics. The caller passes the pressures on the pad as a function of time.
"""

from tactsim.hardware.emulator.emulated import Emulated, Faults, emulate, serve_pty, serve_tcp

__all__ = ["Emulated", "Faults", "emulate", "serve_pty", "serve_tcp"]
