"""Plug-ins that fail, each in its own way, in the second reading of a trial."""

import os
import signal
import sys
import time

import numpy as np
from guess import Guess

from tactsim.estimators import Estimate


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


class Exit(_Failing):
    """Ask for the end of the process."""

    def fail(self):
        sys.exit(0)


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


class Fork(_Failing):
    """Start a process."""

    def fail(self):
        os.fork()


class Program(_Failing):
    """Start a program."""

    def fail(self):
        os.system("touch started")


class Quietly(_Failing):
    """Try to start a program, and do without."""

    def fail(self):
        import subprocess

        try:
            subprocess.run(["touch", "started"], check=True)
        except PermissionError:
            self.readings = 10**6


class Kill(_Failing):
    """End the other process."""

    def fail(self):
        os.kill(os.getppid(), signal.SIGKILL)


class Network(_Failing):
    """Ask somebody else."""

    def fail(self):
        import urllib.request

        urllib.request.urlopen("http://127.0.0.1:1/")


class Boast(_Failing):
    """Give probabilities that are none."""

    def fail(self):
        self.estimate = lambda: Estimate(self.letters[0], {self.letters[0]: 1.5}, np.zeros(3))


class Forge(_Failing):
    """Write nonsense where the answers go."""

    def fail(self):
        os.write(int(sys.argv[1]), b"\xff" * 100)
        time.sleep(60)
