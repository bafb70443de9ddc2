"""A command on a pseudo-terminal: what a person sees and types."""

import fcntl
import os
import pty
import select
import signal
import struct
import termios
import time


class Terminal:
    """A command that runs in a terminal of `columns` x `rows`."""

    def __init__(self, words, folder, environment, columns=80, rows=24):
        self._pid, self._end = pty.fork()
        if self._pid == 0:
            os.chdir(folder)
            kept = {name: value for name, value in environment.items() if name not in ("COLUMNS", "NO_COLOR")}
            os.execve(
                words[0], list(map(str, words)), kept | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
            )
        fcntl.ioctl(self._end, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.said = ""
        self.status = None

    def type(self, keys):
        """Type keys; "\\x03" is Ctrl-C."""
        os.write(self._end, keys.encode())

    def wait_for(self, words, seconds=60):
        """Wait until the command has written `words` since the last call; gives what it wrote till then."""
        until = time.monotonic() + seconds
        while words not in self.said:
            assert time.monotonic() < until, self.said[-2000:]
            assert self._listen(), self.said[-2000:]
        before, _, self.said = self.said.partition(words)
        return before

    def end(self, seconds=60):
        """Wait for the command's end; gives what it wrote last."""
        until = time.monotonic() + seconds
        while self._listen():
            assert time.monotonic() < until, self.said[-2000:]
        self.status = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        os.close(self._end)
        return self.said

    def kill(self):
        """End the command if it still runs."""
        if self.status is None:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)
            os.close(self._end)

    def _listen(self):
        if not select.select([self._end], [], [], 0.1)[0]:
            return True
        try:
            data = os.read(self._end, 1 << 16)
        except OSError:  # the other end is closed
            return False
        self.said += data.decode(errors="replace")
        return bool(data)
