"""A pad without hardware: it speaks a codec's bytes on a pty or a TCP port, faults included on request.

What presses on it is a function from time to pressures that the caller brings; nothing here knows physics.
"""

from tactsim.hardware.emulator.emulated import Emulated, emulate
from tactsim.hardware.emulator.faults import Faults
from tactsim.hardware.emulator.serve import serve_pty, serve_tcp

__all__ = ["Emulated", "Faults", "emulate", "serve_pty", "serve_tcp"]
