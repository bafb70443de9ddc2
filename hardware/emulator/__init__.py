"""A pad without hardware: it speaks a codec's bytes on a pty or a TCP port, faults included on request.

What presses on it is a function from time to pressures that the caller brings; nothing here knows physics.
"""

from hardware.emulator.devices import Emulated, emulate
from hardware.emulator.faults import Faults
from hardware.emulator.serve import serve_pty, serve_tcp

__all__ = ["Emulated", "Faults", "emulate", "serve_pty", "serve_tcp"]
