"""Plug-ins that fail, each in its own way, in the second reading of a trial."""

import os
import signal
import time

import numpy as np
from guess import Guess


class _Failing(Guess):
    readings = 0

    def update(self, reading, sensor_in_robot):
        super().update(reading, sensor_in_robot)
        self.readings += 1
        if self.readings == 2:
            self.fail()


class Crash(_Failing):
    """Raise an exception."""

    def fail(self):
        raise KeyError("a bug of the plug-in's")


class Leave(_Failing):
    """End the process without asking."""

    def fail(self):
        os._exit(0)


class Abort(_Failing):
    """Die as code in C does."""

    def fail(self):
        os.abort()


class Hang(_Failing):
    """Never answer; Ctrl-C is not heard either."""

    def fail(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        while True:
            time.sleep(0.01)


class Eat(_Failing):
    """Take all memory."""

    def fail(self):
        self.eaten = [np.ones(5_000_000) for _ in range(10_000)]


class Print(_Failing):
    """Print a lot, on both streams, and go on."""

    def fail(self):
        print('{"printed": true}' * 10_000)
        os.write(2, b"\x1b[31m\xff")
